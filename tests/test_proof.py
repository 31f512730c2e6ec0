"""The blind proof: sets are sealed and repeatable, marks are right, tables print from anything."""

from __future__ import annotations

import importlib
import json
import shutil
import sys
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mtpipe.experiment.description import ForceCourse, Line
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.tables import EFFECTS

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).parents[1]
CONCEALED = CHECKOUT / "sample_data" / "concealed"


@pytest.fixture(scope="module")
def proof():
    """name → module of the proof."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CHECKOUT / "workflows" / "proof"))
        yield importlib.import_module


@pytest.fixture(scope="module")
def short(proof):
    return proof("generate").Form(frames=512, plateaus=4)


# --- sealing ---------------------------------------------------------------------------------


def _sealed() -> dict[str, str]:
    return json.loads((CONCEALED / "sealed.json").read_text(encoding="utf-8"))


def test_bundled_answers_are_those_that_were_sealed(proof):
    answers = {
        name: proof("sealing").unsealed(CONCEALED / "answers" / f"{name}.json", digest)
        for name, digest in _sealed().items()
    }
    assert len(answers) == 6
    assert {answer["kind"] for answer in answers.values()} == {"clean", "single", "pair", "outside"}
    assert len({answer["salt"] for answer in answers.values()}) == 6


def test_an_answer_that_was_changed_is_noticed(proof, tmp_path):
    name, digest = next(iter(_sealed().items()))
    text = (CONCEALED / "answers" / f"{name}.json").read_text(encoding="utf-8")
    changed = tmp_path / "answer.json"
    changed.write_text(text.replace('"seed": 2', '"seed": 3'), encoding="utf-8")
    with pytest.raises(proof("sealing").BrokenSealError, match="not the answer"):
        proof("sealing").unsealed(changed, digest)


@pytest.mark.parametrize(
    "folder", sorted((CONCEALED / "recordings").iterdir()), ids=lambda f: f.name
)
def test_nothing_but_recording_and_setup_is_beside_a_recording(folder):
    assert {path.name for path in folder.iterdir()} == {"recording.csv.gz", "setup.toml"}
    assert (folder / "recording.csv.gz").stat().st_size < 150_000
    answer = json.loads((CONCEALED / "answers" / f"{folder.name}.json").read_text(encoding="utf-8"))
    listed = tomllib.loads((folder / "setup.toml").read_text(encoding="utf-8"))["model"]["effects"]
    assert not set(listed) & {one["effect"] for one in answer["effects"]}


def test_a_diagnosis_opens_no_answer(proof, tmp_path):
    """The recording is diagnosed where no answer is, and no file of that kind is asked for."""
    clean = next(
        name
        for name in _sealed()
        if '"clean"' in (CONCEALED / "answers" / f"{name}.json").read_text(encoding="utf-8")
    )
    shutil.copytree(CONCEALED / "recordings" / clean, tmp_path / clean)
    opened: list[str] = []
    watching = True

    def watch(event: str, what: tuple[Any, ...]) -> None:
        if watching and event == "open":
            opened.append(str(what[0]))

    sys.addaudithook(watch)
    outcome = proof("blind").diagnosed(tmp_path / clean)
    watching = False
    assert any(path.endswith("setup.toml") for path in opened)
    assert not [path for path in opened if "answers" in path or "sealed" in path]
    assert outcome["failure"] is None
    assert outcome["bead"]["verdict"] in ("consistent", "explained", "unexplained")
    assert len(outcome["bead"]["forces"]) == 4


# --- generation ------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_bytes_in_any_order(proof, short, tmp_path):
    generate = proof("generate")

    def written(seed: int, numbers: list[int], where: str) -> dict[str, bytes]:
        out = tmp_path / where
        for number in numbers:
            generate.write(generate.make(seed, number, short), out / "recordings", out / "answers")
        return {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}

    first = written(1, [3, 14], "first")
    assert len(first) == 6
    assert written(1, [14, 3], "again") == first
    other = written(2, [3], "other")
    assert all(content != first[name] for name, content in other.items())


def test_sets_are_mixed_as_they_say_and_every_effect_comes_in_every_strength(proof):
    plan, concealed = proof("plan"), proof("concealed")
    tasks = [plan.task(3, number) for number in range(300)]
    assert Counter(t.kind for t in tasks) == {
        "clean": 48,
        "usual errors": 24,
        "single": 120,
        "pair": 36,
        "several": 36,
        "outside": 36,
    }
    several = [t.names for t in tasks if t.kind == "several"]
    assert {len(names) for names in several} == {3, 4}
    for names in several:
        assert len({concealed.BY_NAME[name].kind for name in names}) == len(names)
    singles = Counter((t.names[0], t.strength) for t in tasks if t.kind == "single")
    assert len(singles) == 3 * len(concealed.EFFECTS)
    assert set(singles.values()) <= {1, 2}
    outside = Counter(t.names[0] for t in tasks if t.kind == "outside")
    assert set(outside.values()) == {4}


def test_what_can_be_concealed_is_what_can_be_named(proof):
    assert set(proof("concealed").BY_NAME) == set(EFFECTS)
    assert not set(proof("outside").EFFECTS) & set(EFFECTS)
    assert len(proof("outside").EFFECTS) >= 5


def test_usual_errors_are_those_of_laboratories_and_nothing_else_is_off(proof, short):
    generate, configurations = proof("generate"), proof("configurations")
    case = generate.make(5, 0, short, proof("plan").Task("usual errors"))
    stated = tomllib.loads(case.setup)
    assert not [
        key
        for table in stated.values()
        if isinstance(table, dict)
        for key in table
        if key.endswith("_stderr")
    ]
    assert case.answer["effects"] == []
    drawn = [
        configurations.with_usual_errors(
            configurations.draw(np.random.default_rng(1), 512).content, np.random.default_rng(seed)
        )[1]
        for seed in range(400)
    ]
    assert set(drawn[0]) == {
        "pixel_size_nm", "radius_nm", "contour_length_nm", "persistence_length_nm",
        "temperature_K", "viscosity_mPa_s", "exposure_s",
    }  # fmt: skip
    # 400 draws: their spread is within 10 % of the usual one with a probability of 0.995
    assert np.std([one["radius_nm"] for one in drawn]) == pytest.approx(0.03, rel=0.1)
    assert np.std([one["viscosity_mPa_s"] for one in drawn]) == pytest.approx(0.02, rel=0.1)


def test_a_setup_is_written_as_it_is_read(proof):
    configurations = proof("configurations")
    drawn = configurations.draw(np.random.default_rng(1), 2048)
    text = configurations.toml(drawn.content)
    assert parse_setup(tomllib.loads(text), where="test") == drawn.setup


@pytest.mark.parametrize(
    "name",
    [
        "fouling", "shortening", "flicker", "knocks", "outliers", "kink", "crosstalk", "smoothing",
        "digits",
    ],
)  # fmt: skip
def test_effects_outside_the_catalogue_are_in_the_bead_and_not_in_the_reference(
    proof, name, monkeypatch
):
    outside, configurations = proof("outside"), proof("configurations")
    drawn = configurations.draw(np.random.default_rng(4), 512, plateaus=4)
    monkeypatch.setattr(outside, "PIECES", 4)
    scene = outside.Scene(drawn.experiment, drawn.setup, "linear", 5)
    clean = scene.played()
    found = outside.EFFECTS[name](scene, np.random.default_rng(6))
    assert np.array_equal(
        found.recording.positions_nm["ref1"], clean.positions_nm["ref1"], equal_nan=True
    )
    before, after = clean.positions_nm["b1"], found.recording.positions_nm["b1"]
    changed = np.nanstd(after - before, axis=0) > 0
    where = "".join(found.axes) or "xyz"
    assert {"xyz"[i] for i in np.flatnonzero(changed)} <= set(where)
    assert changed.any()
    assert all(0 <= plateau < 4 for plateau in found.plateaus or ())


# --- strength --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def experiment(proof):
    return proof("configurations").draw(np.random.default_rng(2), 4096, plateaus=4).experiment


def test_what_fits_anyway_has_no_strength(proof, experiment):
    """Neither nothing nor other forces can be told from the configured experiment."""
    strength = proof("strength")
    stronger = replace(
        experiment,
        rests=tuple(replace(rest, force_pN=1.03 * rest.force_pN) for rest in experiment.rests),
    )
    assert strength.difference(experiment, experiment).nats < 1e-6
    assert strength.difference(stronger, experiment).nats < 1e-6


def test_a_course_of_the_force_has_no_strength_where_both_have_it(proof, experiment):
    """An effect that is concealed beside it got the course's strength for its own: 440 nats for a
    viscosity that was 1 % off.
    """
    strength, changes = proof("strength"), importlib.import_module("mtpipe.experiment.changes")
    still = ForceCourse()
    courses = (ForceCourse(-0.3, "ramp"), *[still] * (len(experiment.rests) - 1))
    drifting = replace(experiment, magnets=replace(experiment.magnets, courses=courses))
    assert strength.difference(drifting, experiment).nats > 100
    assert strength.difference(drifting, drifting).nats < 1e-6
    beside = strength.difference(changes.scaled_viscosity(drifting, 0.05), drifting).nats
    alone = strength.difference(changes.scaled_viscosity(experiment, 0.05), experiment).nats
    assert beside == pytest.approx(alone, rel=0.2)


def test_strength_grows_as_the_square_and_is_found_again(proof, experiment):
    strength, changes = proof("strength"), importlib.import_module("mtpipe.experiment.changes")

    def measure(size: float) -> float:
        return strength.difference(changes.scaled_viscosity(experiment, size), experiment).nats

    assert measure(0.04) / measure(0.02) == pytest.approx(4.0, rel=0.03)
    size, nats = strength.size_for(50.0, measure, (0.001, 1.0))
    assert nats == pytest.approx(50.0, rel=0.11)
    assert measure(size) == pytest.approx(nats)
    # what is out of reach is the nearest end
    assert strength.size_for(1e6, measure, (0.05, 0.1))[0] == pytest.approx(0.1)


def test_more_noise_than_usual_has_no_strength_where_noise_is_free(proof):
    strength = proof("strength")
    drawn = proof("configurations").draw(
        np.random.default_rng(2), 4096, plateaus=4, listed=("tracking_noise",)
    )
    loud = drawn.experiment
    x, y, z = loud.tracker.noise_nm
    louder = replace(loud, tracker=replace(loud.tracker, noise_nm=(1.2 * x, y, z)))
    assert strength.difference(louder, loud).nats < 0.05
    shaken = replace(loud, stage=replace(loud.stage, lines=(Line(11.0, (2.0, 0.0, 0.0)),)))
    assert strength.difference(shaken, loud).nats > 5


# --- marks -----------------------------------------------------------------------------------


def _answer(kind: str, *effects: str, strength: str | None = "clear", **where: Any) -> dict:
    place = {"axes": ["y"], "plateaus": None, "band_hz": None} | where
    return {
        "kind": kind,
        "strength": strength,
        "formula": "marko-siggia",
        "effects": [{"effect": name, "where": place} for name in effects],
        "plateaus": [{"magnet_mm": 1.0, "force_pN": 10.0}, {"magnet_mm": 2.0, "force_pN": 1.0}],
        "force_bias": [0.1, 0.001],
    }


def _outcome(verdict: str, *named: str, equivalent: tuple[str, ...] = (), **place: Any) -> dict:
    at = {"axis": "y", "plateaus": [0], "band_hz": [1.0, 2.0], "p_value": 1e-9} | place
    force = {"stderr_pN": 0.1, "plateau": 0, "magnet_mm": 1.0}
    return {
        "bead": {
            "verdict": verdict,
            "located": [] if verdict == "consistent" else [at | {"p_value": 0.1, "axis": "z"}, at],
            "effects": [{"effect": name, "equivalent": list(equivalent)} for name in named],
            "force_bound_percent": 12.0 if verdict == "unexplained" else 0.0,
            "forces": [
                force | {"force_pN": 10.05, "force_before_pN": 9.0},
                force | {"magnet_mm": 2.0, "force_pN": 1.2, "force_before_pN": 1.3},
            ],
        },
        "failure": None,
        "seconds": 12.0,
    }


@pytest.mark.parametrize(
    ("answer", "outcome", "marked"),
    [
        (_answer("clean"), _outcome("consistent"), "right"),
        (_answer("clean"), _outcome("unexplained"), "false alarm"),
        (_answer("clean"), _outcome("explained", "drift"), "false alarm"),
        (_answer("single", "drift"), _outcome("explained", "drift"), "exact"),
        (_answer("single", "drift"), _outcome("unexplained", "drift"), "partial"),
        (_answer("single", "drift"), _outcome("explained", "drift", "exposure"), "wrong"),
        (_answer("single", "drift"), _outcome("explained", "exposure"), "wrong"),
        (
            _answer("single", "drift"),
            _outcome("explained", "exposure", equivalent=("drift",)),
            "exact",
        ),
        (
            _answer("single", "drift"),
            _outcome("explained", "drift", "exposure", equivalent=("drift",)),
            "wrong",
        ),
        (_answer("single", "drift"), _outcome("unexplained"), "located"),
        (_answer("single", "drift"), _outcome("consistent"), "missed"),
        (_answer("pair", "drift", "exposure"), _outcome("explained", "exposure", "drift"), "exact"),
        (_answer("pair", "drift", "exposure"), _outcome("explained", "drift"), "partial"),
        (_answer("pair", "drift", "exposure"), _outcome("explained", "hopping", "drift"), "wrong"),
        (_answer("outside", "fouling"), _outcome("unexplained"), "right"),
        (_answer("outside", "fouling"), _outcome("unexplained", axis="x"), "located"),
        (_answer("outside", "fouling"), _outcome("unexplained", "drift"), "right"),
        (_answer("outside", "fouling"), _outcome("explained", "drift"), "wrong"),
        (_answer("outside", "fouling"), _outcome("consistent"), "missed"),
    ],
)  # fmt: skip
def test_marks(proof, answer, outcome, marked):
    assert proof("scoring").score(answer, outcome).outcome == marked


@pytest.mark.parametrize(
    ("where", "place", "right"),
    [
        ({}, {}, True),
        ({}, {"axis": "x"}, False),
        ({}, {"axis": "xy"}, True),
        ({"axes": ["xz", "x"]}, {"axis": "xz"}, True),
        ({"plateaus": [1]}, {"plateaus": [0]}, False),
        ({"plateaus": [1]}, {"plateaus": [0, 1]}, True),
        ({"band_hz": [1.5, 9.0]}, {}, True),
        ({"band_hz": [3.0, 9.0]}, {}, False),
        ({"band_hz": [3.0, 9.0]}, {"band_hz": None}, True),
    ],
)
def test_places(proof, where, place, right):
    answer = _answer("outside", "fouling", **where)
    outcome = _outcome("unexplained", **place)
    assert proof("scoring").score(answer, outcome).place is right


def test_forces_are_known_by_their_magnet(proof):
    forces = proof("scoring").score(_answer("single", "drift"), _outcome("consistent")).forces
    assert [force.before for force in forces] == pytest.approx([-0.1, 0.3])
    assert [force.after for force in forces] == pytest.approx([0.005, 0.2])
    assert [force.pull for force in forces] == pytest.approx([0.5, 2.0])
    tables = proof("tables")
    score = proof("scoring").score(_answer("single", "drift"), _outcome("consistent"))
    # only the first plateau is one that the effect biases
    assert tables.errors([score]) == pytest.approx((0.1, 0.005, 1))
    assert tables.covered([score]) == (1, 2)
    assert tables.covered([score], 2.1) == (2, 2)


def test_intervals_of_shares(proof):
    wilson = proof("scoring").wilson
    # Wilson 1927; e.g. Brown, Cai & DasGupta 2001
    assert wilson(0, 10) == pytest.approx((0.0, 0.2775), abs=1e-4)
    assert wilson(5, 10) == pytest.approx((0.2366, 0.7634), abs=1e-4)
    assert all(np.isnan(wilson(0, 0)))


# --- tables ----------------------------------------------------------------------------------


def _failed() -> dict[str, Any]:
    return {"bead": None, "failure": "it broke", "seconds": 1.0}


def test_tables_print_from_nothing_and_count_failures(proof):
    tables, score = proof("tables"), proof("scoring").score
    assert "0 recordings; 0 failed" in tables.everything([])
    failed = score(_answer("single", "drift"), _failed())
    good = score(_answer("single", "drift"), _outcome("explained", "drift"))
    text = tables.everything([failed, good])
    assert "2 recordings; 1 failed" in text
    assert "| drift | – | – | 1/2 |" in text
    # a clean recording that failed is no quiet one
    assert "100.0 % (21–100; 1 of 1)" in tables.alarms([score(_answer("clean"), _failed())])
    half = score(
        _answer("several", "drift", "exposure", "viscosity"), _outcome("unexplained", "drift")
    )
    assert "| drift + exposure + viscosity | clear | unexplained | drift |" in tables.several(
        [half]
    )
    assert tables._causes_named([half]).startswith("33.3 %")
    assert tables._causes_named([score(_answer("several", "drift"), _failed())]).startswith("0.0 %")


def test_what_is_recorded_prints_the_same_again_unless_it_was_changed(proof, tmp_path):
    command, sealing = proof("proof"), proof("sealing")
    about = {"seed": 1, "frames": 4096, "formula": "marko-siggia", "recordings": 3}
    about |= {"date": "2026-11-21", "mtpipe": "0.1.0"}
    answer = _answer("single", "drift") | {"name": "r0001", "number": 1}
    rows = [
        {
            "sha256": sealing.seal(answer),
            "answer": answer,
            "outcome": _outcome("explained", "drift") | {"name": "r0001"},
        }
    ]
    path = tmp_path / "results.jsonl"
    command.write_rows(path, about, rows)
    assert command.read_rows(path) == rows
    assert "2 of 3 recordings have not been run" in command.page_part(about, rows)
    assert "--plateaus" not in command.page_part(about, rows)
    assert "--plateaus 8" in command.page_part(about | {"plateaus": 8}, rows)
    here = {key: about[key] for key in ("seed", "frames", "formula")}
    (tmp_path / "about.json").write_text(json.dumps(here))
    command.put_back(path, tmp_path)
    assert command.unsealed_rows(tmp_path, range(3)) == rows
    for other in ({"seed": 2}, {"plateaus": 8}):
        (tmp_path / "about.json").write_text(json.dumps(here | other))
        with pytest.raises(SystemExit, match="another seed or form"):
            command.put_back(path, tmp_path)
    path.write_text(path.read_text(encoding="utf-8").replace('"clear"', '"faint"'))
    with pytest.raises(sealing.BrokenSealError):
        command.read_rows(path)


def test_limits_of_what_is_unexplained_are_held_against_the_truth(proof):
    score, tables = proof("scoring").score, proof("tables")
    left = score(_answer("outside", "drift"), _outcome("unexplained"))
    assert left.bound == pytest.approx(0.12)
    off = replace(left, forces=(proof("scoring").Force(0.3, 0.2, 5.0, 0.0),))
    assert not tables._limit_holds(off, 0.05)
    assert tables._limit_holds(off, 0.2)
    text = tables.by_verdict([left, score(_answer("clean"), _outcome("consistent"))])
    assert "| unexplained | 1 | 2 |" in text
    assert "| consistent | 1 | 2 |" in text

"""The magnet's curve on simulated days whose curve, spread and bad beads are known."""

import tomllib

import numpy as np
import pandas as pd
import pytest

from mtpipe.ground.errors import MtpipeError
from mtpipe.magnet_curve.curve import magnet_curve
from mtpipe.magnet_curve.measured import measured_forces
from mtpipe.pipeline import magnet_curve as files

SPREAD, BEADS, BAD = 0.06, 20, 2
POSITIONS = np.linspace(0.5, 6.0, 9)
AT = np.array([1.0, 3.0, 5.5])


def truth(position_mm):
    return np.logaddexp(np.log(30) - position_mm / 0.7, np.log(8) - position_mm / 2.5)


def table(seed, bad=BAD, beads=BEADS):
    """Forces with errors of 2 to 4 %; the first beads are bad: strong, steep, with a jump."""
    random = np.random.default_rng(seed)
    rows = []
    for bead in range(beads):
        at = np.sort(random.choice(POSITIONS, random.integers(4, 9), replace=False))
        logs = truth(at) + random.normal(0, SPREAD)
        if bead < bad:
            kind = (bead + seed) % 3
            logs = [logs + 0.7, logs + 0.25 * (logs - logs.mean()), logs + 0.4 * (at == at[2])][
                kind
            ]
        errors = 0.03 * random.uniform(0.7, 1.3, len(at))
        force = np.exp(logs + random.normal(0, errors))
        rows += [
            {"bead": f"b{bead}", "plateau": n, "magnet_mm": x, "force_pN": f,
             "force_stderr_pN": f * e, "force_status": "ok", "magnet_believed": True}
            for n, (x, f, e) in enumerate(zip(at, force, errors, strict=True))
        ]  # fmt: skip
    return pd.DataFrame(rows)


def test_intervals_hold_the_truth_and_bad_beads_are_named():
    """12 days: of 84 intervals of 68 %, seven of each day, at least 40 % hold it.

    The share of a day scatters by 0.31, that of 12 by 0.09: three standard errors, one choice of
    seeds in 700. workflows/magnet_curve measures the share itself.
    """
    held, named, sound = [], 0, 0
    for seed in range(12):
        curve = magnet_curve(measured_forces([("r", table(seed))]))
        middle, new = curve.curve(AT), curve.new_bead(AT)
        other = truth(AT) + np.random.default_rng(1000 + seed).normal(0, SPREAD)
        held.append([
            *((middle.low_pN < np.exp(truth(AT))) & (np.exp(truth(AT)) < middle.high_pN)),
            curve.fit.spread_low < SPREAD < curve.fit.spread_high,
            *((new.low_pN < np.exp(other)) & (np.exp(other) < new.high_pN)),
        ])  # fmt: skip
        named += int((~curve.kept[:BAD]).sum())
        sound += int((~curve.kept[BAD:]).sum())
    assert np.mean(held) > 0.4, np.mean(held, axis=0)
    assert named == 12 * BAD
    assert sound <= 2


def test_a_bead_of_one_force_borrows_the_curve():
    every = table(1, bad=0)
    few = pd.concat([every[every["bead"] != "b0"], every[every["bead"] == "b0"].head(1)])
    curve = magnet_curve(measured_forces([("r", few)]))
    number = curve.forces.beads.index(("r", "b0"))
    mine = curve.of_bead(number, POSITIONS)
    assert (mine.stderr_pN < curve.new_bead(POSITIONS).stderr_pN).all()


def test_what_is_not_ok_does_not_enter_and_too_few_beads_are_told():
    every = table(1)
    every.loc[every["bead"] != "b3", "force_status"] = "excluded"
    with pytest.raises(MtpipeError, match="needs 3 beads"):
        magnet_curve(measured_forces([("r", every)]))


def test_files_are_those_of_the_next_setup(tmp_path, monkeypatch):
    from types import SimpleNamespace

    monkeypatch.setattr(files, "read_marked_run", lambda _: SimpleNamespace(forces=table(2)))
    said = files.write_magnet_curve(tmp_path, {"r": tmp_path})
    assert "2 beads are unlike the others" in said
    magnets = tomllib.loads((tmp_path / files.TABLES).read_text())["magnet"]
    assert [one["position_mm"] for one in magnets] == pytest.approx(np.round(POSITIONS, 3))
    assert all(0 < one["force_pN_stderr"] < one["force_pN"] for one in magnets)
    assert list(pd.read_csv(tmp_path / files.TABLE).columns)[:3] == [
        "position_mm", "force_pN", "stderr_pN",
    ]  # fmt: skip

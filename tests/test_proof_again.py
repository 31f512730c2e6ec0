"""Recordings of the blind proof in which a fault was found, made again by their seed and number."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

import mtpipe

pytestmark = pytest.mark.slow

PROOF = Path(__file__).parents[1] / "workflows" / "proof"


@pytest.fixture
def diagnosed(tmp_path, monkeypatch):
    """Seed and number → what `mismatch.json` has of the bead, and its true forces in pN by the
    magnets' position in mm."""
    monkeypatch.syspath_prepend(str(PROOF))
    generate = importlib.import_module("generate")

    def made(seed, number):
        form = generate.Form(frames=4096, plateaus=None, formula=None)
        case = generate.make(seed, number, form)
        generate.write(case, tmp_path / "recordings", tmp_path / "answers")
        path = tmp_path / "recordings" / case.name / "recording.csv.gz"
        mismatch = mtpipe.diagnose(mtpipe.subtract_drift(mtpipe.load(path)), seed=1)
        true = {one["magnet_mm"]: one["force_pN"] for one in case.answer["plateaus"]}
        return mismatch.as_dict()["beads"]["b1"], true

    return made


def test_what_gains_nothing_on_other_time_takes_no_place(diagnosed):
    """A drift gains 61 nats where it is fitted, more than the changing force that is there, and
    nothing on time that was kept out: nothing was named.
    """
    bead, _ = diagnosed(630518079, 45)
    assert {one["effect"] for one in bead["effects"]} == {"force_drift", "vibration"}


def test_a_cause_too_weak_to_be_named_does_not_decide_the_formula_of_the_chain(diagnosed):
    """A scale of 1.04 makes the wrong formula likelier by 5 nats, by which forces were 10 % and 15
    standard errors off, and the bead consistent.
    """
    bead, true = diagnosed(630518079, 46)
    assert bead["verdict"] == "consistent"
    for row in bead["forces"]:
        assert abs(row["force_pN"] - true[row["magnet_mm"]]) < 4 * row["stderr_pN"]

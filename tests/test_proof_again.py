"""Recordings of the blind proof in which a fault was found, made again by their seed and number."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

import mtpipe

pytestmark = pytest.mark.slow

PROOF = Path(__file__).parents[1] / "workflows" / "proof"


def test_what_gains_nothing_on_other_time_takes_no_place(tmp_path, monkeypatch):
    """A drift gains 61 nats where it is fitted, more than the changing force that is there, and
    nothing on time that was kept out: nothing was named.
    """
    monkeypatch.syspath_prepend(str(PROOF))
    generate = importlib.import_module("generate")
    case = generate.make(630518079, 45, generate.Form(frames=4096, plateaus=None, formula=None))
    generate.write(case, tmp_path / "recordings", tmp_path / "answers")
    path = tmp_path / "recordings" / case.name / "recording.csv.gz"
    mismatch = mtpipe.diagnose(mtpipe.subtract_drift(mtpipe.load(path)), seed=1)
    bead = mismatch.as_dict()["beads"]["b1"]
    assert {one["effect"] for one in bead["effects"]} == {"force_drift", "vibration"}

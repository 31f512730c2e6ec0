"""Effects that are put by numbers into real recordings have the size they are said to have."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from mtpipe.effects.catalogue import OWN

PATH = Path(__file__).parents[1] / "workflows" / "injections" / "injections.py"
SPEC = importlib.util.spec_from_file_location("injections", PATH)
injections = importlib.util.module_from_spec(SPEC)
sys.modules["injections"] = injections
SPEC.loader.exec_module(injections)

FRAMES, RATE_HZ = 40_000, 100.0
TIME_S = np.arange(FRAMES) / RATE_HZ


def put(kind, strength):
    random = np.random.default_rng(1)
    before = random.normal((500.0, -300.0, 900.0), 30.0, (FRAMES, 3))
    return before, injections.INJECTIONS[kind].put(before, TIME_S, strength, random) - before


def test_a_scale_and_a_share_are_of_the_motion_and_not_of_the_place():
    before, added = put("scale", 0.08)
    assert np.std(added, axis=0) == pytest.approx([0, 0.08 * 30, 0], rel=0.02)
    assert np.mean(added) == pytest.approx(0.0, abs=1e-9)
    before, added = put("crosstalk", 0.16)
    assert np.std(added, axis=0) == pytest.approx([0, 0, 0.16 * 30], rel=0.02)
    assert np.corrcoef(added[:, 2], before[:, 0])[0, 1] == pytest.approx(1.0)


def test_motion_of_its_own_has_its_size():
    """Of 800 hops one standard error is 3.5 %."""
    _, line = put("line", 2.0)
    assert np.std(line, axis=0) == pytest.approx([0, 2 / np.sqrt(2), 0], rel=0.01)
    _, noise = put("noise", 4.0)
    assert np.std(noise, axis=0) == pytest.approx([4, 4, 4], rel=0.02)
    _, walk = put("drift", 2.0)
    steps = np.diff(walk, axis=0) * np.sqrt(RATE_HZ)
    assert np.std(steps, axis=0) == pytest.approx([2, 2, 2], rel=0.02)
    _, hops = put("hopping", 20.0)
    changes = np.abs(np.diff(hops[:, 2])) > 10
    assert set(np.round(np.unique(hops[:, 2]), 6)) == {0.0, 20.0}
    assert changes.sum() / TIME_S[-1] == pytest.approx(injections.HOPS_HZ, rel=0.15)


def test_frames_that_are_dropped_are_followed_by_the_next():
    """A fifth of 40 000 frames is known to 2 %."""
    before = np.arange(3.0 * FRAMES).reshape(FRAMES, 3)
    random = np.random.default_rng(1)
    after = injections.INJECTIONS["dropped"].put(before, TIME_S, 0.2, random)
    kept = after[~np.isnan(after).any(axis=1)]
    assert len(kept) == pytest.approx(0.8 * FRAMES, rel=0.02)
    assert np.isnan(after[len(kept) :]).all()
    assert (np.diff(kept[:, 0]) > 0).all()
    assert set(kept[:, 0]) <= set(before[:, 0])


def test_what_is_put_in_has_a_name_of_the_catalogue_or_none():
    names = {one.name for one in OWN} | {""}
    assert {one.effect for one in injections.INJECTIONS.values()} <= names
    assert all(
        sorted(one.strengths) == list(one.strengths) for one in injections.INJECTIONS.values()
    )

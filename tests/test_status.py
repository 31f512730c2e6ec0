"""What makes a number of a trace one to use, and what does not.

Simulated traces have fixed seeds. Drawn anew, a random walk is called "ok" in one or two of a
hundred traces, a tethered bead of 100 relaxation times anything else in one of a thousand.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from mtpipe import fit_by_method, fit_trace, sample_posterior
from mtpipe.calibration.bead_results import AxisResult, PlateauResult
from mtpipe.calibration.comparison import MethodResult
from mtpipe.ground.estimate import Estimate
from mtpipe.ground.status import LEAST_RELAXATIONS, P_POOR, status_of
from mtpipe.recording.recording import Plateau
from mtpipe.recording.traces import Trace

RATE_HZ, FRAMES, STEPS = 120.0, 2048, 16
KT_PN_NM, FRICTION = 4.114, 2.4e-5
KNOWN = {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ, "temperature_K": 298.0}
PRIOR = (FRICTION, 0.03 * FRICTION)


def blurred(steps: np.ndarray) -> np.ndarray:
    """(FRAMES,) means over frames of (FRAMES * STEPS,) positions."""
    return steps.reshape(FRAMES, STEPS).mean(axis=1)


def random_walk(random: np.random.Generator) -> np.ndarray:
    size = math.sqrt(2 * KT_PN_NM / FRICTION / RATE_HZ / STEPS)
    return blurred(np.cumsum(random.normal(0, size, FRAMES * STEPS)))


def tethered(random: np.random.Generator, relaxations: float) -> np.ndarray:
    """A trace of so many relaxation times, exact at its steps."""
    tau_steps = FRAMES * STEPS / relaxations
    stiffness = FRICTION * relaxations * RATE_HZ / FRAMES
    decay = math.exp(-1 / tau_steps)
    burn_in = int(8 * tau_steps)
    kicks = random.normal(size=FRAMES * STEPS + burn_in)
    motion = lfilter([1.0], [1.0, -decay], kicks)[burn_in:] * math.sqrt(1 - decay**2)
    return blurred(motion) * math.sqrt(KT_PN_NM / stiffness)


def estimate(value: float, low: float, high: float) -> Estimate:
    return Estimate(value, (high - low) / 2, (low, high), "pN", "made up")


def test_each_word_has_its_reason():
    sound = estimate(1.0, 0.9, 1.1)
    assert status_of(sound) == "ok"
    assert status_of(sound, p_value=2 * P_POOR, relaxations=2 * LEAST_RELAXATIONS) == "ok"
    assert status_of(sound, p_value=P_POOR / 2) == "unlike_model"
    assert status_of(sound, relaxations=LEAST_RELAXATIONS / 2) == "zero_force"
    assert status_of(estimate(0.1, 0.0, 0.3)) == "zero_force"
    # what is not known has no better word than that
    missing = Estimate.missing("pN", "made up")
    assert status_of(missing, p_value=0.0, relaxations=0.0) == "not_identified"


def test_an_interval_that_includes_nought_still_does_with_one_more_error():
    widened = replace(estimate(0.1, 0.0, 0.3), status="zero_force").widened(0.5)
    assert widened.interval[0] == 0.0
    assert widened.interval[1] > 0.3
    assert widened.status == "zero_force"


@pytest.mark.parametrize("options", [{}, {"friction": PRIOR}, {"tracking_noise_nm": "fit"}])
def test_a_random_walk_has_no_force(options):
    random = np.random.default_rng(1)
    words = [fit_trace(random_walk(random), **KNOWN, **options).stiffness.status for _ in range(60)]
    assert words.count("ok") <= 5
    assert {"zero_force", "not_identified"} <= set(words)


def test_how_fast_a_random_walk_diffuses_is_known_all_the_same():
    fit = fit_trace(random_walk(np.random.default_rng(4)), **KNOWN, friction=PRIOR)
    assert fit.relaxations < LEAST_RELAXATIONS
    assert fit.stiffness.status != "ok"
    assert fit.corner_frequency.status != "ok"
    assert fit.friction.status == "ok"


@pytest.mark.slow
@pytest.mark.parametrize("method", ["equipartition", "allan", "hadamard", "arctangent"])
def test_a_random_walk_has_no_force_by_other_methods_either(method):
    random = np.random.default_rng(2)
    words = [
        fit_by_method(method, random_walk(random), **KNOWN, friction=PRIOR).stiffness.status
        for _ in range(20)
    ]
    assert words.count("ok") <= 4


def test_a_tethered_bead_has_one():
    random = np.random.default_rng(3)
    fits = [fit_trace(tethered(random, 100.0), **KNOWN) for _ in range(40)]
    assert {fit.stiffness.status for fit in fits} == {"ok"}
    for method in ("equipartition", "allan"):
        by = fit_by_method(method, tethered(random, 100.0), **KNOWN, friction=PRIOR)
        assert by.stiffness.status == "ok"


def test_what_is_unlike_the_model_says_so_in_fit_and_posterior():
    trace = tethered(np.random.default_rng(5), 400.0)
    shaken = trace + 2 * trace.std() * np.sin(0.7 * np.arange(FRAMES))
    fit = fit_trace(shaken, **KNOWN)
    assert fit.p_value < P_POOR
    told = (fit.stiffness, fit.friction, fit.corner_frequency)
    assert {one.status for one in told} == {"unlike_model"}
    assert all(math.isfinite(one.value) for one in told)
    assert sample_posterior(fit, seed=1).stiffness.status == "unlike_model"
    assert sample_posterior(fit_trace(trace, **KNOWN), seed=1).stiffness.status == "ok"


@pytest.mark.parametrize("rate_hz", [1e9, 1e-3, 0.0, -120.0, math.nan, math.inf])
def test_a_frame_rate_that_no_camera_has_is_refused(rate_hz):
    trace = tethered(np.random.default_rng(6), 100.0)
    options = KNOWN | {"frame_rate_hz": rate_hz, "exposure_s": 1e-10}
    with pytest.raises(ValueError, match=r"frame_rate_hz = .* no camera's"):
        fit_trace(trace, **options)
    with pytest.raises(ValueError, match=r"frame_rate_hz = .* no camera's"):
        fit_by_method("allan", trace, **options)


def plateau(*axes: AxisResult, mixed: str = "") -> PlateauResult:
    trace = Trace(Plateau(0, 0, 4, 2.0), 0.0, np.zeros((4, 3)), 0, 0.0, 0.0)
    return PlateauResult(trace, 1000.0, 1.0, axes, mixed)


def axis(name: str, trace: np.ndarray, *, shared: bool = False) -> AxisResult:
    fit = fit_trace(trace, **KNOWN)
    return AxisResult(
        name, "made up", fit=fit, force=fit.stiffness.scaled(1000.0, "pN"), shares_force=shared
    )


def test_a_force_that_x_and_y_share_is_as_good_as_the_worse_of_both():
    sound = tethered(np.random.default_rng(7), 400.0)
    shaken = sound + 2 * sound.std() * np.sin(0.7 * np.arange(FRAMES))
    refused = AxisResult("y", "none", refusal="it is stuck")
    apart = plateau(axis("x", sound), axis("y", shaken))
    assert [apart.status(one) for one in apart.axes] == ["ok", "unlike_model"]
    assert apart.force_status == "ok"
    shared = plateau(axis("x", sound, shared=True), axis("y", shaken, shared=True))
    assert shared.force_status == "unlike_model"
    assert plateau(axis("x", sound), refused).force_status == "ok"
    assert plateau(axis("x", shaken), refused).force_status == "unlike_model"
    assert plateau(replace(refused, axis="x"), refused).force_status == "refused"
    assert plateau(axis("z", sound)).force_status == "refused"


def test_a_plateau_that_mixes_states_has_no_force_to_use():
    sound = tethered(np.random.default_rng(8), 400.0)
    refused = AxisResult("y", "none", refusal="it is stuck")
    mixed = plateau(axis("x", sound), refused, mixed="the mean steps by 30 nm at 12 s")
    assert [mixed.status(one) for one in mixed.axes] == ["not_one_state", "refused"]
    assert mixed.force_status == "not_one_state"
    by = MethodResult("b1", mixed, "x", "allan", fit_by_method("allan", sound, **KNOWN), None, "")
    assert by.status == "not_one_state"
    assert replace(by, plateau=plateau(axis("x", sound))).status == "ok"
    assert replace(by, fit=None).status == "refused"

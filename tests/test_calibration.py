"""Calibration of whole recordings: forces, friction, exposure, and what is refused."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats

import mtpipe
from mtpipe.calibration import refusal
from mtpipe.calibration.calibration import calibrate
from mtpipe.calibration.quality import trace_flags
from mtpipe.curves.tether_curves import extension_points, tether_curves
from mtpipe.physics.tether import Chain, mean_extension_nm
from mtpipe.pipeline.verdict import bead_verdict, bead_verdicts
from mtpipe.setup.setup import parse_setup
from tests import simulated
from tests.simulated import CHAIN, RATE_HZ, bead_nm, recording, setup_content

pytestmark = pytest.mark.slow


def calibrated(*args, **options):
    return calibrate(mtpipe.subtract_drift(recording(*args, **options)))


def verdict_of(calibration, setup):
    (bead,) = calibration.beads
    flags = tuple(
        notice
        for plateau in bead.plateaus
        for notice in trace_flags(calibration, bead, plateau, setup)
    )
    return bead_verdict(bead, flags, setup), {notice.code for notice in flags}


def test_forces_lie_within_their_errors():
    """Pulls of 30 forces: mean within 0.55 (3 sigma), standard deviation between 0.6 and 1.4."""
    forces, pulls = (0.4, 1.5, 5.0), []
    for seed in range(10):
        (bead,) = calibrated(forces, 2048, seed).beads
        for plateau, true in zip(bead.plateaus, forces, strict=True):
            x, y, _ = plateau.axes
            assert x.shares_force
            assert y.shares_force
            assert x.force == y.force
            assert x.force.status == "ok"
            pulls.append((x.force.value - true) / x.force.stderr)
    assert abs(np.mean(pulls)) < 0.55
    assert 0.6 < np.std(pulls) < 1.4


def test_the_joint_force_is_better_known_than_that_of_each_axis():
    """By a fourth on average; its errors, from samples, scatter by 3 to 12 % a plateau."""
    (bead,) = calibrated((0.4, 1.5, 5.0, 12.0), 4096).beads
    over_alone = []
    for plateau in bead.plateaus:
        x, y, _ = plateau.axes
        assert x.force.stderr < 1.05 * min(x.force_alone.stderr, y.force_alone.stderr)
        over_alone.append(x.force.stderr / x.force_alone.stderr)
    assert stats.gmean(over_alone) < 0.85


def test_an_uncertain_exposure_widens_fast_traces():
    camera = {"frame_rate_hz": RATE_HZ, "exposure_s": 1 / RATE_HZ}
    sure = calibrated((0.3, 8.0), setup=parse_setup(setup_content(camera=camera)))
    vague = {**camera, "exposure_s": 0.97 / RATE_HZ, "exposure_s_stderr": 0.03 / RATE_HZ}
    unsure = calibrated((0.3, 8.0), setup=parse_setup(setup_content(camera=vague)))
    slow, fast = (
        unsure.beads[0].plateaus[i].axes[0].force.stderr
        / sure.beads[0].plateaus[i].axes[0].force.stderr
        for i in (0, 1)
    )
    assert slow == pytest.approx(1, abs=0.15)
    assert fast > 1.2


def test_force_is_stiffness_times_lever():
    (bead,) = calibrated((1.0,), 8192).beads
    x, y, z = bead.plateaus[0].axes
    length = bead.plateaus[0].extension_nm
    assert length == pytest.approx(float(mean_extension_nm(CHAIN, 1.0)), abs=4)
    assert x.force.value == pytest.approx(x.posterior.stiffness.value * length, rel=5e-3)
    assert y.force.value == pytest.approx(
        y.posterior.stiffness.value * (length + simulated.RADIUS_NM), rel=5e-3
    )
    assert z.force is None
    assert z.fit is not None


def test_field_along_y_swaps_the_levers():
    setup = parse_setup(setup_content(field={"direction": "y"}))
    (bead,) = calibrated((1.0,), 8192, setup=setup).beads
    x, y, _ = bead.plateaus[0].axes
    length = bead.plateaus[0].extension_nm
    assert y.force.value == pytest.approx(y.posterior.stiffness.value * length, rel=5e-3)
    assert x.force.value / x.posterior.stiffness.value == pytest.approx(
        length + simulated.RADIUS_NM, rel=5e-3
    )


def test_friction_that_contradicts_the_setup_is_measured_and_said():
    """1.5 times the friction: a prior from the setup would pull the force at high force."""
    random = np.random.default_rng(4)
    forces = (0.3, 1.0, 4.0)
    beads = {"b1": np.vstack([bead_nm(f, 4096, random, friction=1.5) for f in forces])}
    raw = recording(forces, beads=beads)
    calibration = calibrate(mtpipe.subtract_drift(raw))
    (bead,) = calibration.beads
    assert bead.friction_contradicts
    assert bead.friction_ratio.value == pytest.approx(1.5, abs=5 * bead.friction_ratio.stderr)
    assert "measured on this bead" in bead.plateaus[0].axes[0].method
    for plateau, true in zip(bead.plateaus, forces, strict=True):
        force = plateau.axes[0].force
        assert abs(force.value - true) < 4 * force.stderr
    verdict, _ = verdict_of(calibration, raw.setup)
    assert verdict.verdict == "caution"
    assert "friction" in verdict.reasons[0]


def test_unknown_exposure_is_estimated_from_the_blur():
    random = np.random.default_rng(5)
    setup = parse_setup(setup_content(camera={"frame_rate_hz": RATE_HZ, "exposure_s": "unknown"}))
    forces = (2.0, 4.0, 6.0)
    half = 0.5 / RATE_HZ
    beads = {
        "b1": np.vstack([bead_nm(f, 8192, random, exposure_s=half, noise_nm=1.0) for f in forces])
    }
    calibration = calibrate(
        mtpipe.subtract_drift(recording(forces, 8192, setup=setup, beads=beads))
    )
    assert calibration.conditions.exposure_s == pytest.approx(half, rel=0.2)
    assert [n.code for n in calibration.notices] == ["exposure_estimated"]


def test_unknown_exposure_without_reference_bead_is_assumed_and_said():
    camera = {"frame_rate_hz": RATE_HZ, "exposure_s": "unknown"}
    beads = {"radius_nm": 500.0}
    raw = recording((2.0,), setup=parse_setup(setup_content(camera=camera, beads=beads)))
    alone = dataclasses.replace(raw, positions_nm={"b1": raw.positions_nm["b1"]})
    calibration = calibrate(mtpipe.subtract_drift(alone))
    assert calibration.conditions.exposure_s == pytest.approx(1 / RATE_HZ)
    assert "exposure_assumed" in [n.code for n in calibration.notices]


def test_unknown_temperature_viscosity_and_radius_are_said_and_lived_with():
    content = setup_content(
        buffer={"temperature_K": "unknown", "viscosity_mPa_s": "unknown"},
        beads={"radius_nm": "unknown", "reference": ["ref1"]},
    )
    calibration = calibrated((1.0,), setup=parse_setup(content))
    assert {n.code for n in calibration.notices} == {
        "temperature_assumed",
        "viscosity_assumed",
        "radius_unknown",
        "radius_estimated",
    }
    (bead,) = calibration.beads
    x, y, _ = bead.plateaus[0].axes
    assert x.force.value == pytest.approx(1.0, abs=4 * x.force.stderr)
    # x and y share the force, and the friction tells the radius
    assert y.force.value == pytest.approx(1.0, abs=4 * y.force.stderr)
    assert bead.radius.value == pytest.approx(simulated.RADIUS_NM, abs=4 * bead.radius.stderr)
    assert bead.radius.stderr < 100


def nothing_but(xyz):
    return recording((1.0,), len(xyz), beads={"b1": xyz})


def stuck(random):
    return 1.5 * random.normal(size=(6000, 3)) + [0.0, 0.0, 2.0]


def free(random):
    # the bulk diffusion of this bead, one step a frame
    return np.cumsum(60.0 * random.normal(size=(6000, 3)), axis=0)


def driven(random):
    angle = 2 * np.pi * 0.5 * np.arange(6000) / RATE_HZ
    circle = 300 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    return circle + 15 * random.normal(size=(6000, 3)) + [0.0, 0.0, 800.0]


def ring_at_changing_speed(random):
    angle = np.cumsum(0.3 * random.normal(size=6000) + 0.05)
    circle = 300 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    return circle + 40 * random.normal(size=(6000, 3)) + [0.0, 0.0, 800.0]


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (stuck, "stuck"),
        (free, "does not level off"),
        (driven, "circles"),
        (ring_at_changing_speed, "ring"),
    ],
)
def test_what_is_no_tethered_bead_is_refused_with_its_reason(motion, words):
    raw = nothing_but(motion(np.random.default_rng(3)))
    calibration = calibrate(raw)
    verdict, codes = verdict_of(calibration, raw.setup)
    assert verdict.verdict == "refused"
    assert words in " ".join(verdict.reasons)
    assert "refused" in codes
    for one in calibration.beads[0].plateaus[0].axes[:2]:
        assert one.force is None


def test_tethers_are_not_refused():
    """Negative control over forces, seeds and axes, 60 traces."""
    for seed in range(5):
        (bead,) = calibrated((0.1, 0.5, 2.0, 5.0, 10.0, 20.0), 2048, seed).beads
        assert not any(one.refusal for plateau in bead.plateaus for one in plateau.axes)


def test_no_z_gives_stiffness_and_no_force():
    raw = recording((1.0,))
    positions = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    for xyz in positions.values():
        xyz[:, 2] = np.nan
    flat = dataclasses.replace(raw, positions_nm=positions)
    calibration = calibrate(mtpipe.subtract_drift(flat))
    axes = calibration.beads[0].plateaus[0].axes
    assert [one.axis for one in axes] == ["x", "y"]
    assert all(one.force is None and one.posterior is not None for one in axes)
    verdict, codes = verdict_of(calibration, raw.setup)
    assert "no_extension" in codes
    assert verdict.verdict == "caution"


def test_mistracked_frames_are_found_and_harmless():
    raw = recording((1.0, 4.0), 4096)
    spoiled = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    rows = np.random.default_rng(1).choice(4096, 90, replace=False)
    spoiled["b1"][rows] += [900.0, -700.0, 30_000.0]
    bad = dataclasses.replace(raw, positions_nm=spoiled)
    calibration = calibrate(mtpipe.subtract_drift(bad))
    first = calibration.beads[0].plateaus[0]
    assert first.trace.mistracked == 90
    assert abs(first.axes[0].force.value - 1.0) < 4 * first.axes[0].force.stderr
    _, codes = verdict_of(calibration, raw.setup)
    assert "mistracked" in codes


def test_heavy_but_real_motion_is_not_mistracked():
    (bead,) = calibrated((0.05, 0.5), 8192, drift_nm_per_root_s=20.0).beads
    assert [plateau.trace.mistracked for plateau in bead.plateaus] == [0, 0]


def test_workers_and_order_change_nothing():
    raw = mtpipe.subtract_drift(recording((1.0,), 1024))
    two = dataclasses.replace(
        raw, positions_nm={"b2": raw.positions_nm["b1"][::-1].copy(), **raw.positions_nm}
    )
    alone = calibrate(raw).beads[0]
    spread = {bead.bead: bead for bead in calibrate(two, workers=2).beads}
    assert list(spread) == ["b2", "b1"]
    ours, theirs = alone.plateaus[0].axes[0].force, spread["b1"].plateaus[0].axes[0].force
    assert ours == theirs


def test_extension_longer_than_the_contour_is_flagged():
    raw = recording((4.0,))
    positions = dict(raw.positions_nm)
    positions["b1"] = positions["b1"] + [0.0, 0.0, 400.0]
    calibration = calibrate(mtpipe.subtract_drift(dataclasses.replace(raw, positions_nm=positions)))
    _, codes = verdict_of(calibration, raw.setup)
    assert "extension" in codes
    assert math.isfinite(calibration.beads[0].plateaus[0].axes[0].force.value)


def test_a_bead_that_circles_for_a_part_of_the_trace_is_refused():
    random = np.random.default_rng(8)
    still = bead_nm(1.0, 12_000, random)
    angle = 2 * np.pi * 0.6 * np.arange(6000) / RATE_HZ
    still[3000:9000, 0] += 300 * np.cos(angle)
    still[3000:9000, 1] += 300 * np.sin(angle)
    calibration = calibrate(nothing_but(still))
    # it moves far more while it circles: that part is a plateau of its own
    plateaus = calibration.beads[0].plateaus
    there = [p for p in plateaus if p.plateau.start < 6000 < p.plateau.stop]
    assert len(there) == 1
    for one in there[0].axes[:2]:
        assert "circles at 0." in one.refusal


@pytest.mark.parametrize("phase_degree", [94.0, 0.0])
def test_a_driven_bead_is_refused_in_a_short_and_coarse_trace(phase_degree):
    """240 frames at 20 Hz, driven at 3.3 Hz, between two ordinates of the spectrum."""
    random = np.random.default_rng(11)
    angle = 2 * np.pi * 3.3 * np.arange(240) / 20.0
    thermal = 40.0 * random.normal(size=(240, 2))
    drive = np.column_stack([np.cos(angle), np.cos(angle + np.radians(phase_degree))])
    assert refusal.driven(thermal, 1 / 20, 0.05) is None
    words = refusal.driven(thermal + 150.0 * drive, 1 / 20, 0.05)
    assert words is not None
    assert ("circles" if phase_degree else "swings") in words
    assert "at 3.3" in words or "at 3.29" in words


def test_forces_of_both_axes_are_averaged_by_their_relative_errors():
    """Absolute errors would pull the mean towards the axis that came out low."""
    calibration = calibrated((0.2,), 1024, seed=3)
    (bead,) = calibration.beads
    x, y, _ = (one.force for one in bead.plateaus[0].axes)
    points = extension_points(bead, calibration.conditions)
    weights = np.array([x.value / x.stderr, y.value / y.stderr]) ** 2
    expected = np.exp(weights @ np.log([x.value, y.value]) / weights.sum())
    assert points.force_pN[0] == pytest.approx(expected, rel=0.02)


def test_the_short_one_of_several_tethers_is_singled_out():
    random = np.random.default_rng(9)
    forces = (0.3, 1.0, 3.0, 8.0)
    beads = {
        name: np.vstack([bead_nm(force, 2048, random) for force in forces])
        for name in ("b1", "b2", "b3")
    }
    beads["short"] = np.vstack(
        [bead_nm(force, 2048, random, chain=Chain(500.0, 50.0, 298.15)) for force in forces]
    )
    raw = recording(forces, 2048, beads=beads)
    calibration = calibrate(mtpipe.subtract_drift(raw))
    curves = tether_curves(calibration)
    flags = {
        bead.bead: tuple(
            notice
            for plateau in bead.plateaus
            for notice in trace_flags(calibration, bead, plateau, raw.setup)
        )
        for bead in calibration.beads
    }
    verdicts = {v.bead: v for v in bead_verdicts(calibration, flags, curves, raw.setup)}
    assert "0.4" in verdicts["short"].reasons[0]
    assert "other beads" in verdicts["short"].reasons[0]
    assert all("other beads" not in " ".join(verdicts[b].reasons) for b in ("b1", "b2", "b3"))


def test_a_bead_refused_in_most_plateaus_gives_no_force_in_any():
    random = np.random.default_rng(11)
    step = 60.0 * random.normal(size=(6 * 2000, 3))
    raw = recording((1.0,) * 6, 2000, beads={"b1": np.cumsum(step, axis=0)})
    calibration = calibrate(raw)
    axes = [one for plateau in calibration.beads[0].plateaus for one in plateau.axes]
    assert all(one.refusal and one.force is None for one in axes)


def test_uncertain_temperature_widens_the_force():
    exact = calibrated((2.0,), 8192).beads[0].plateaus[0].axes[0].force
    buffer = {"temperature_K": 298.15, "temperature_K_stderr": 30.0, "viscosity_mPa_s": 0.9}
    warm = calibrated((2.0,), 8192, setup=parse_setup(setup_content(buffer=buffer)))
    force = warm.beads[0].plateaus[0].axes[0].force
    assert force.value == pytest.approx(exact.value, rel=0.03)
    expected = math.hypot(exact.stderr / exact.value, 30 / 298.15)
    assert force.stderr / force.value == pytest.approx(expected, rel=0.15)


def test_a_known_force_that_is_contradicted_is_said():
    magnet = [
        {"position_mm": 0.0, "force_pN": 2.0, "force_pN_stderr": 0.1},
        {"position_mm": 1.0, "force_pN": 40.0},
    ]
    setup = parse_setup(setup_content(magnet=magnet))
    calibration = calibrated((2.0, 4.0), setup=setup)
    (bead,) = calibration.beads
    named = [
        {n.code for n in trace_flags(calibration, bead, plateau, setup)}
        for plateau in bead.plateaus
    ]
    assert "known_force" not in named[0]
    assert "known_force" in named[1]
    # a position that the beads contradict says nothing of the force
    unbelieved = dataclasses.replace(calibration, unbelieved=frozenset({1}))
    codes = {n.code for n in trace_flags(unbelieved, bead, bead.plateaus[1], setup)}
    assert "known_force" not in codes


def test_a_reference_that_steps_between_plateaus_is_said():
    raw = recording((4.0, 4.0))
    positions = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    positions["ref1"][4096:, 2] += 500.0
    stepped = dataclasses.replace(raw, positions_nm=positions)
    calibration = calibrate(mtpipe.subtract_drift(stepped))
    (bead,) = calibration.beads
    codes = [
        {n.code for n in trace_flags(calibration, bead, plateau, raw.setup)}
        for plateau in bead.plateaus
    ]
    assert "reference_stepped" not in codes[0]
    assert "reference_stepped" in codes[1]


def test_a_bead_without_z_beside_a_reference_with_z():
    raw = recording((1.0,))
    positions = {name: xyz.copy() for name, xyz in raw.positions_nm.items()}
    positions["b1"][:, 2] = np.nan
    flat = dataclasses.replace(raw, positions_nm=positions)
    (bead,) = calibrate(mtpipe.subtract_drift(flat)).beads
    assert [one.axis for one in bead.plateaus[0].axes] == ["x", "y"]

"""The experiment that a setup describes, and a bead in it against closed forms."""

import dataclasses
import itertools
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.experiment.description import (
    Allowance,
    Bead,
    Experiment,
    Fluid,
    Magnets,
    Rest,
    Stage,
    Tracker,
)
from mtpipe.experiment.from_setup import experiment_of, magnets_mm
from mtpipe.experiment.state import bead_state, bead_states, expected_spectrum
from mtpipe.experiment.tethers import _tethers
from mtpipe.ground.errors import FitError, SetupError
from mtpipe.physics.camera import Camera, power_spectrum
from mtpipe.physics.modes import rotating_bead
from mtpipe.physics.tether import Chain, mean_extension_nm, moments
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm, turning_modes
from mtpipe.setup.setup import parse_setup
from tests.simulated import setup_content

FORCES = (0.3, 2.0, 15.0)


def experiment(radius_nm=500.0, contour_nm=1200.0, *, along=0, turns=True, wall=True, camera=None):
    return Experiment(
        chain=Chain(contour_nm, 50.0, 298.15),
        bead=Bead(radius_nm, turns),
        fluid=Fluid(298.15, 0.9, wall),
        along=along,
        camera=camera or Camera(1 / 120, 1 / 240),
        stage=Stage(),
        tracker=Tracker((1.0, 2.0, 3.0)),
        rests=(Rest(1.0, 1024, 3.0),),
    )


def setup(*effects, magnet=(), **changes):
    content = setup_content(model={"effects": list(effects)}, **changes)
    return parse_setup(content | {"magnet": [dict(one) for one in magnet]})


@pytest.mark.parametrize("along", [0, 1])
@pytest.mark.parametrize("force", FORCES)
def test_lateral_motion_has_the_variances_and_modes_of_the_literature(force, along):
    """kT L/F along the field with L the mean height of the tether's end, kT (L + R)/F across."""
    described = experiment(along=along)
    state, energy = bead_state(described, force), described.fluid.thermal_energy_pN_nm
    end, radius = float(mean_extension_nm(described.chain, force)), 500.0
    covariance = state.modes.covariance_nm2()
    assert covariance[along, along] == pytest.approx(energy * end / force, rel=1e-9)
    across = 1 - along
    assert covariance[across, across] == pytest.approx(energy * (end + radius) / force, rel=1e-9)
    np.testing.assert_allclose(covariance - np.diag(np.diag(covariance)), 0, atol=1e-6)

    friction, _, _, turning = np.diag(state.motion.friction)
    closed = rotating_bead(end, radius, turning / friction)
    rates = force / (end + radius) / friction * np.array(closed.rates)
    taus = state.modes.tau_s[np.abs(state.modes.amplitude_nm[across]) > 1e-6]
    np.testing.assert_allclose(1 / taus, rates, rtol=1e-6)
    single = state.modes.tau_s[np.abs(state.modes.amplitude_nm[along]) > 1e-6]
    assert single == pytest.approx([friction * end / force], rel=1e-9)


@pytest.mark.parametrize("along", [0, 1])
@pytest.mark.parametrize("force", FORCES)
def test_an_image_that_turns_with_the_bead_has_the_covariances_of_the_literature(force, along):
    """PHYSICS E25, with kT/Fa the variance of the turn and kT/F its covariance with the motion."""
    described = experiment(along=along)
    turning = dataclasses.replace(
        described,
        bead=dataclasses.replace(described.bead, z_per_turn_nm=80.0, aside_per_turn_nm=-150.0),
    )
    round_one, seen = (
        bead_state(one, force).modes.covariance_nm2() for one in (described, turning)
    )
    energy, across, lever = described.fluid.thermal_energy_pN_nm, 1 - along, 500.0
    aside = 2 * -150 * energy / force + 150**2 * energy / (force * lever)
    assert seen[across, across] - round_one[across, across] == pytest.approx(aside, rel=1e-9)
    both = 80 * energy / force + 80 * -150 * energy / (force * lever)
    assert seen[across, 2] == pytest.approx(both, rel=1e-9)
    assert seen[along, 2] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("force", FORCES)
def test_friction_is_that_of_the_heights_a_bead_visits(force):
    """The inverse of the mean mobility over a normal distribution of heights, by plain sums."""
    described = experiment()
    state = bead_state(described, force)
    spread = np.sqrt(float(moments(described.chain, force).variance_nm2))
    away = np.linspace(-4, 4, 801)
    heights = np.maximum(state.extension_nm + spread * away, 0.05 * state.extension_nm)
    weight = np.exp(-(away**2) / 2)
    found = np.diag(state.motion.friction)
    for axis, upright in ((0, False), (1, False), (2, True)):
        each = friction_pN_s_per_nm(heights, 500.0, 0.9, wall=True, upright=upright)
        mean = 1 / np.average(1 / each, weights=weight)
        assert found[axis] == pytest.approx(mean, rel=2e-3)
    ratio = found[3] / found[0]
    at_mean = turning_modes(state.extension_nm, 500.0, wall=True)
    assert rotating_bead(state.extension_nm, 500.0, ratio).rates == pytest.approx(
        at_mean.rates, rel=0.01
    )


@pytest.mark.parametrize("force", FORCES)
def test_a_bead_that_does_not_turn_is_the_baseline(force):
    described = experiment(turns=False, wall=False)
    state, energy = bead_state(described, force), described.fluid.thermal_energy_pN_nm
    end = float(mean_extension_nm(described.chain, force))
    assert state.extension_nm == end
    lateral = np.diag(state.modes.covariance_nm2())[:2]
    np.testing.assert_allclose(lateral, energy / force * np.array([end, end + 500]), rtol=1e-9)
    friction = 6e-9 * np.pi * 0.9 * 500
    np.testing.assert_allclose(np.diag(state.motion.friction), friction, rtol=1e-9)


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize("turns", [True, False])
def test_the_height_fluctuates_as_the_chain_and_the_swing_say(force, turns):
    """Var z = the chain's radial variance + ½ Σ (what each way of swinging shortens)²."""
    described = experiment(turns=turns)
    state, energy = bead_state(described, force), described.fluid.thermal_energy_pN_nm
    variance = moments(described.chain, force).variance_nm2
    camera = Camera(1e-7, 0.0)
    still = dataclasses.replace(described, camera=camera, tracker=Tracker())
    frequency = np.concatenate([[0], np.geomspace(1e-4, camera.nyquist_hz, 20_000)])
    power = expected_spectrum(frequency, state, still, 2)
    # the swinging end, its bead and the bead's turn lose kT/2F on average each, and scatter by
    # √2 of that
    ways = 3 if turns else 2
    swing = ways * (energy / force) ** 2 / 2
    assert np.trapezoid(power, frequency) == pytest.approx(float(variance) + swing, rel=2e-3)


def test_the_expected_spectrum_has_the_tracking_noise_and_the_blur():
    described = experiment(turns=False)
    state, camera = bead_state(described, 2.0), described.camera
    frequency = np.linspace(0, 60, 7)
    tau = state.modes.tau_s[np.abs(state.modes.amplitude_nm[0]) > 1e-6][0]
    variance = state.modes.covariance_nm2()[0, 0]
    expected = power_spectrum(frequency, variance, tau, camera) + 2 * camera.frame_s * 1.0**2
    np.testing.assert_allclose(expected_spectrum(frequency, state, described, 0), expected)


def test_a_force_that_cannot_hold_the_bead_up_is_refused():
    with pytest.raises(FitError, match=r"at 0\.001 pN the tether does not hold the bead"):
        bead_state(experiment(), 0.001)


def test_a_setup_becomes_the_experiment_it_states():
    stated = setup(
        "wall_drag",
        camera={"frame_rate_hz": 200.0, "exposure_s": 0.002},
        field={"direction": "y"},
        beads={"radius_nm": 700.0, "reference": ["r1", "r2"]},
    )
    described, notices = experiment_of(stated, FORCES, 2000, beads=3, lost_share=0.1)
    assert (described.camera.frame_s, described.camera.exposure_s) == (0.005, 0.002)
    assert described.bead == Bead(700.0, turns=False)
    assert described.fluid.wall
    assert (described.along, described.tethered, described.references) == (1, 3, 2)
    assert [rest.force_pN for rest in described.rests] == list(FORCES)
    assert described.tracker == Tracker(lost_share=0.1)
    assert {notice.code for notice in notices} == {"stage_assumed", "magnet_assumed"}


def test_what_is_assumed_is_said():
    stated = setup(
        "tracking_noise",
        camera={"frame_rate_hz": 120.0, "exposure_s": "unknown"},
        buffer={"temperature_K": "unknown", "viscosity_mPa_s": "unknown"},
    )
    described, notices = experiment_of(stated, [1.0], 100)
    assert described.camera.exposure_s == 1 / 120
    assert {notice.code for notice in notices} == {
        "stage_assumed", "magnet_assumed", "noise_assumed", "exposure_assumed",
        "temperature_assumed", "viscosity_assumed", "short_plateaus",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("pinned", "noise"), [(1.5, (1.5, 1.5, 1.5)), ([1, 2, 3], (1, 2, 3)), ("much", None)]
)
def test_the_noise_that_a_setup_pins_is_taken(pinned, noise):
    content = setup_content(
        model={"effects": ["tracking_noise"], "tracking_noise": {"noise_nm": pinned}}
    )
    if noise is None:
        with pytest.raises(SetupError, match="a number, or one each for x, y and z"):
            experiment_of(parse_setup(content), [1.0], 1000)
        return
    described, notices = experiment_of(parse_setup(content), [1.0], 1000)
    assert described.tracker.noise_nm == described.tracker.reference_noise_nm == noise
    assert {notice.code for notice in notices} == {"stage_assumed", "magnet_assumed"}


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"beads": {"radius_nm": "unknown"}}, "radius_nm"),
        ({"tether": {"contour_length_nm": "unknown", "persistence_length_nm": 50.0}}, "contour"),
        ({"camera": {"frame_rate_hz": "unknown", "exposure_s": 0.001}}, "frame_rate_hz"),
    ],
)
def test_what_a_simulation_needs_cannot_be_unknown(changes, key):
    with pytest.raises(SetupError, match=key):
        experiment_of(setup(**changes), [1.0], 1000)


@pytest.mark.parametrize(
    ("forces", "frames", "options", "said"),
    [
        ([], 1000, {}, "no force is given"),
        ([1.0, -2.0], 1000, {}, "a force of -2 pN cannot be simulated"),
        ([float("nan")], 1000, {}, "a force of nan pN"),
        ([1.0], 1, {}, "1 frames of 1 beads"),
        ([1.0], 1000, {"beads": 0}, "1000 frames of 0 beads"),
        ([1.0], 1000, {"noise_nm": (1.0, -1.0, 0.0)}, "a tracking noise"),
        ([1.0], 1000, {"lost_share": 1.0}, "a share of 1 of the frames"),
    ],
)
def test_arguments_that_cannot_be_are_refused(forces, frames, options, said):
    with pytest.raises(SetupError, match=said):
        experiment_of(setup(), forces, frames, **options)


known_magnets = st.lists(
    st.tuples(st.floats(0.05, 50), st.floats(0.2, 9)),
    max_size=4,
    unique_by=(lambda one: one[0], lambda one: one[1]),
)


@given(known_magnets, st.lists(st.floats(0.02, 80), min_size=1, max_size=8))
def test_stronger_forces_stand_nearer_and_neighbours_apart(known, forces):
    strong, near = sorted(f for f, _ in known), sorted((p for _, p in known), reverse=True)
    stated = setup(
        magnet=[{"force_pN": f, "position_mm": p} for f, p in zip(strong, near, strict=True)]
    )
    positions = magnets_mm(stated, forces)
    assert all(a != b for a, b in itertools.pairwise(positions))
    for (f, a), (g, b) in itertools.combinations(zip(forces, positions, strict=True), 2):
        # to 1 µm of rounding and 1 µm by which neighbours are moved apart
        assert (b - a) * (g - f) <= 0.0021 * abs(g - f)


def test_magnets_stand_where_the_setup_knows_the_force():
    stated = setup(
        magnet=[
            {"force_pN": 1.0, "position_mm": 4.0},
            {"force_pN": 10.0, "position_mm": 1.0},
            {"force_pN": "unknown", "position_mm": 0.5},
        ]
    )
    assert magnets_mm(stated, [10.0, 1.0, np.sqrt(10), 0.1]) == [1.0, 4.0, 2.5, 7.0]
    _, notices = experiment_of(stated, [1.0], 1000)
    assert [notice.code for notice in notices] == ["stage_assumed"]


def test_equal_forces_in_a_row_stay_two_plateaus_under_a_tolerance():
    stated = setup(plateaus={"tolerance_mm": 0.02})
    first, second = magnets_mm(stated, [2.0, 2.0])
    assert abs(second - first) > 0.02


def test_tethers_worked_out_together_are_those_worked_out_alone():
    for chain in (experiment().chain, Chain(1200.0, 45.0, 298.0, "extensible", 900.0)):
        forces = [0.05, 0.3, 2.0, 15.0, 60.0]
        together = _tethers(chain, np.array(forces))
        for force, one in zip(forces, together, strict=True):
            (alone,) = _tethers(chain, np.array([force]))
            assert (one.end_nm, one.variance_nm2) == (alone.end_nm, alone.variance_nm2)
            np.testing.assert_allclose(one.weight, alone.weight, rtol=1e-9)
            np.testing.assert_allclose(one.deviation, alone.deviation, rtol=1e-9, atol=1e-12)
            assert one.weight @ one.deviation == pytest.approx(0.0, abs=1e-12)
            assert one.weight @ one.deviation**2 == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("changes", "some_refused"),
    [
        ({}, True),
        ({"anharmonic": True}, False),
        ({"bead": Bead(500.0, offset_nm=200.0), "magnets": Magnets(3000.0)}, True),
        ({"bead": Bead(500.0, turns=False), "allowance": Allowance(1.02, 0.97)}, False),
    ],
    ids=["turning", "whole motion", "tilting", "stiff and softer"],
)
def test_states_worked_out_together_are_those_worked_out_alone(changes, some_refused):
    """At all forces, low and high; where there is none, it says the same, and takes no other."""
    here = dataclasses.replace(experiment(), **changes)
    forces = np.geomspace(0.001, 80.0, 12).tolist()
    frequency = np.geomspace(0.1, 60.0, 30)
    refused = 0
    for force, one in zip(forces, bead_states(here, forces), strict=True):
        if isinstance(one, FitError):
            refused += 1
            with pytest.raises(FitError, match=re.escape(str(one))):
                bead_state(here, force)
            continue
        alone = bead_state(here, force)
        assert one.force_pN == force
        assert (one.stepped is None) == (alone.stepped is None)
        assert one.extension_nm == pytest.approx(alone.extension_nm, rel=1e-9)
        np.testing.assert_allclose(one.modes.tau_s, alone.modes.tau_s, rtol=1e-9)
        for axis in range(3):
            together, by_itself = (
                expected_spectrum(frequency, state, here, axis) for state in (one, alone)
            )
            np.testing.assert_allclose(together, by_itself, rtol=1e-8)
    assert 0 < refused < 6 if some_refused else refused == 0

"""The step-by-step simulators against equipartition, closed forms, quadrature and each other.

Every statistical check has a fixed seed and allows 4 standard errors: were the seed drawn anew, a
right simulator would fail one check in 16000 (a few times as often where the error is estimated
from batches).
"""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mtpipe.experiment.changes import with_magnets
from mtpipe.experiment.description import Stage
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.experiment.state import bead_state
from mtpipe.physics import camera as cam
from mtpipe.physics import friction, tether, tethered_bead
from mtpipe.physics.buffer import thermal_energy_pN_nm
from mtpipe.physics.camera import Camera
from mtpipe.physics.modes import SINGLE_MODE
from mtpipe.setup.setup import parse_setup
from mtpipe.simulation.brownian import BrownianBead, longest_time_step_s, simulate_bead
from mtpipe.simulation.chain_table import ChainTable, tabulate
from mtpipe.simulation.equilibrium import draw_state
from mtpipe.simulation.simulate import simulate_experiment
from mtpipe.simulation.springs import simulate_path, simulate_springs
from mtpipe.simulation.steps import divide_frame
from tests.simulated import setup_content

pytestmark = pytest.mark.slow

KT = float(thermal_energy_pN_nm(293.15))
FRAME_S = 1 / 120
SIGMAS = 4.0
FEW = settings(max_examples=20, derandomize=True)


def chain(contour_nm=1200.0, **changes):
    return tether.Chain(contour_nm, 50.0, 293.15, **changes)


def bead(contour_nm=1200.0, radius_nm=500.0, force_pN=1.0, **changes):
    return BrownianBead(chain(contour_nm), force_pN, radius_nm, 1.0, **changes)


def assert_mean(samples, expected, batches=50, bias=0.0):
    """The mean is the expected one within 4 errors, from batches much longer than a relaxation."""
    means = samples[: len(samples) // batches * batches].reshape(batches, -1).mean(axis=1)
    error = means.std(ddof=1) / np.sqrt(batches)
    assert abs(means.mean() - expected) < SIGMAS * error + bias, (means.mean(), expected, error)
    return error


# Springs


@pytest.mark.parametrize("share", [1.0, 1 / 3, 0.0])
def test_springs_have_the_variance_and_covariance_of_the_closed_forms(share):
    camera = Camera(FRAME_S, share * FRAME_S)
    tau_s = np.repeat([2.5e-3, 8e-3, 0.03], 30)
    gamma = 2.6e-5
    # two steps in 500 make a variance 0.4 % too large at most
    recorded = simulate_springs(
        gamma / tau_s, gamma, KT, camera, 1000, np.random.default_rng(1), time_step_s=2e-5
    )
    variance = np.mean(recorded**2, axis=0) / (KT * tau_s / gamma)
    covariance = np.mean(recorded[1:] * recorded[:-1], axis=0) / (KT * tau_s / gamma)
    for tau in np.unique(tau_s):
        at = tau_s == tau
        for measured, expected in (
            (variance[at], cam.frame_variance(1.0, tau, camera)),
            (covariance[at], cam.lag_one_covariance(1.0, tau, camera)),
        ):
            error = measured.std(ddof=1) / np.sqrt(at.sum())
            assert abs(measured.mean() - expected) < SIGMAS * error + 0.004 * expected
            assert error < 0.03 * expected or tau < 5e-3


def test_springs_have_the_spectrum_of_the_closed_form():
    camera, tau_s, gamma, frames = Camera(FRAME_S, 0.6 * FRAME_S), 6e-3, 2.6e-5, 2048
    recorded = simulate_springs(
        np.full(16, gamma / tau_s),
        gamma,
        KT,
        camera,
        frames,
        np.random.default_rng(2),
        time_step_s=4e-5,
    )
    f = np.fft.rfftfreq(frames, FRAME_S)[1:-1]
    ordinates = 2 * FRAME_S / frames * np.abs(np.fft.rfft(recorded, axis=0)[1:-1]) ** 2
    expected = cam.power_spectrum(f, KT * tau_s / gamma, tau_s, camera)
    for band in np.array_split(ordinates / expected[:, None], 8):
        assert band.mean() == pytest.approx(1, abs=SIGMAS / np.sqrt(band.size) + 0.004)


def test_springs_draw_numpy_s_own_random_numbers():
    k, gamma, dt = 0.004, 9.4e-6, 5e-6
    random = np.random.default_rng(3)
    path = [np.sqrt(KT / k / (1 - dt * k / gamma / 2)) * random.standard_normal()]
    for _ in range(999):
        kick = np.sqrt(2 * KT * dt / gamma) * random.standard_normal()
        path.append(path[-1] * (1 - dt * k / gamma) + kick)
    simulated = simulate_path(k, gamma, KT, 1000, np.random.default_rng(3), time_step_s=dt)
    assert simulated[:, 0] == pytest.approx(path, rel=1e-9)


@FEW
@given(share=st.floats(0, 1), ln_steps=st.floats(0, 6), seed=st.integers(0, 99))
def test_recorded_springs_are_the_camera_s_view_of_the_path(share, ln_steps, seed):
    camera = Camera(FRAME_S, share * FRAME_S)
    longest = FRAME_S / np.exp(ln_steps)
    steps = divide_frame(camera, longest)
    assert 1 <= steps.exposed <= steps.per_frame
    assert steps.time_step_s <= longest * (1 + 1e-9)
    assert steps.per_frame * steps.time_step_s == pytest.approx(FRAME_S, rel=1e-12)
    assert abs(steps.exposure_s - camera.exposure_s) <= steps.time_step_s * (
        0.5 if steps.exposed > 1 else 1.0
    )
    springs = (np.array([2e-4, 1e-3]), 1e-3, KT)
    recorded = simulate_springs(
        *springs, camera, 5, np.random.default_rng(seed), time_step_s=longest
    )
    path = simulate_path(
        *springs, 5 * steps.per_frame, np.random.default_rng(seed), time_step_s=steps.time_step_s
    )
    seen = path.reshape(5, steps.per_frame, -1)[:, : steps.exposed].mean(axis=1)
    assert recorded == pytest.approx(seen, rel=1e-9, abs=1e-9)


def test_an_exposure_that_is_a_simple_share_is_a_whole_number_of_steps():
    for share in (1 / 2, 1 / 3, 0.7):
        steps = divide_frame(Camera(FRAME_S, share * FRAME_S), 5e-6)
        assert steps.exposure_s == pytest.approx(share * FRAME_S, rel=1e-12)


@FEW
@given(ln_tau=st.floats(-3, 10), share=st.sampled_from([0.0, 0.3, 1.0]), seed=st.integers(0, 99))
def test_springs_start_in_equilibrium_however_slow_or_fast(ln_tau, share, seed):
    tau_s = FRAME_S * np.exp(ln_tau)
    camera, gamma, springs = Camera(FRAME_S, share * FRAME_S), 1e-5, 3000
    recorded = simulate_springs(
        np.full(springs, gamma / tau_s),
        gamma,
        KT,
        camera,
        2,
        np.random.default_rng(seed),
        time_step_s=min(tau_s, FRAME_S) / 60,
    )
    expected = cam.frame_variance(KT * tau_s / gamma, tau_s, camera)
    # a step of a 60th makes a variance 0.8 % too large
    tolerance = SIGMAS * np.sqrt(2 / springs) + 0.01
    assert np.mean(recorded**2, axis=1) == pytest.approx(expected, rel=tolerance)


def test_a_step_too_long_for_the_stiffest_spring_is_refused():
    with pytest.raises(ValueError, match=r"9.8% too large: take at most 5.08e-07 s"):
        simulate_springs(
            [1e-3, 0.37], 9.4e-6, KT, Camera(FRAME_S, FRAME_S), 1, np.random.default_rng(0)
        )
    with pytest.raises(ValueError, match="must be positive"):
        simulate_path(0.0, 1e-5, KT, 1, np.random.default_rng(0))
    with pytest.raises(ValueError, match="time step"):
        divide_frame(Camera(1.0, 1.0), 0.0)


# The bead with everything


@pytest.mark.parametrize(
    ("contour_nm", "radius_nm", "force_pN"),
    [(1200, 500, 0.5), (1200, 500, 3.0), (2700, 1400, 2.0), (300, 500, 1.0)],
)
def test_equipartition_holds_exactly_in_the_anharmonic_potential(contour_nm, radius_nm, force_pN):
    """kT<z>/F and kT<centre's z>/F, chains of any stiffness (PHYSICS section 0)."""
    turning = bead(contour_nm, radius_nm, force_pN)
    tau_s = 6e-9 * np.pi * radius_nm * 1.3 * (contour_nm + radius_nm) / force_pN
    recorded = simulate_bead(turning, Camera(tau_s, 0.0), 12_000, np.random.default_rng(4))
    x, y, z = recorded.position_nm.T
    # x: the end of the tether and the bead's centre move together; z of the end is not recorded
    # but has the mean of the chain
    end = float(tether.mean_extension_nm(turning.chain, force_pN))
    error = assert_mean(x**2 * force_pN / KT, end)
    assert error < 0.02 * end
    assert_mean(y**2 * force_pN / KT - z, radius_nm)
    assert_mean(x, 0.0)
    assert_mean(y, 0.0)


@pytest.mark.parametrize(
    ("formula", "modulus", "softness"),
    # variance over kT/stiffness at the mean, by quadrature
    [("marko-siggia", None, 0.985), ("bouchiat", None, 0.985), ("extensible", 900.0, 1.0)],
)
@pytest.mark.parametrize("longer", [0.5, 1.0, 2.0])
def test_mean_height_is_that_of_the_chain_at_any_step(formula, modulus, softness, longer):
    locked = dataclasses.replace(
        bead(force_pN=8.0, turns=False),
        chain=chain(formula=formula, stretch_modulus_pN=modulus),
    )
    camera = Camera(2e-3, 0.0)
    step = longer * longest_time_step_s(locked, camera)
    trace = simulate_bead(locked, camera, 8_000, np.random.default_rng(5), time_step_s=step)
    z = trace.position_nm[:, 2]
    mean = float(tether.mean_extension_nm(locked.chain, 8.0))
    error = assert_mean(z, mean)
    assert error < 0.1
    assert abs(mean - tether.extension_nm(locked.chain, 8.0)) > 5 * error  # not that of the curve
    stiffness = float(tether.stiffness_pN_per_nm(locked.chain, mean))
    assert z.var() * stiffness / KT == pytest.approx(softness, rel=SIGMAS * np.sqrt(2 / len(z)))


@pytest.mark.parametrize("wall", [True, False])
@pytest.mark.parametrize("force_pN", [0.0, 0.05])
def test_heights_near_the_surface_are_distributed_by_boltzmann(wall, force_pN):
    """The surface cuts much off. Without the Itô drift the mean is 76 nm too low and more."""
    locked = bead(400, 1000, force_pN, wall=wall, turns=False)
    recorded = simulate_bead(locked, Camera(0.05, 0.0), 60_000, np.random.default_rng(6))
    z = recorded.position_nm[:, 2]
    error = assert_mean(z, float(tether.mean_extension_nm(locked.chain, force_pN)))
    assert error < 1.0
    # the second moment by quadrature over the half space, in r and the height z = r c
    r = np.linspace(0, 400, 2002)[1:-1]
    tension = tether.force_pN(locked.chain, r)
    energy = np.cumsum(tension) * (r[1] - r[0])
    c = np.linspace(0, 1, 801)
    weight = r[:, None] ** 2 * np.exp((force_pN * r[:, None] * c - energy[:, None]) / KT)
    second = np.sum(weight * (r[:, None] * c) ** 2) / np.sum(weight)
    assert_mean(z**2, second, bias=0.002 * second)


def test_the_surface_slows_the_relaxation_down():
    locked = bead(1200, 500, 1.0, turns=False)
    length = float(tether.mean_extension_nm(locked.chain, 1.0))
    for wall in (True, False):
        gamma = tethered_bead.friction_pN_s_per_nm(length, 500.0, 1.0, wall=wall)
        tau_s, frames = float(gamma * length), 20_000
        camera = Camera(0.7 * tau_s, 0.0)
        trace = simulate_bead(
            dataclasses.replace(locked, wall=wall), camera, frames, np.random.default_rng(7)
        )
        for axis in (0, 1):
            x = trace.position_nm[:, axis]
            q = np.mean(x[1:] * x[:-1]) / np.mean(x**2)
            expected = np.exp(-0.7)
            # the wall's factor is 1.22: without it q would be 0.06 lower. Friction varies with the
            # height, which shows at the level of 0.3 %
            error = np.sqrt((1 - expected**2) / frames)
            assert q == pytest.approx(expected, abs=SIGMAS * error + 0.002)


@pytest.mark.parametrize("wall", [True, False])
def test_short_displacements_are_those_of_the_friction_at_the_heights_visited(wall):
    radius, frames, frame_s = 1000.0, 20_000, 1e-4
    low = bead(400, radius, 0.2, wall=wall, turns=False)
    trace = simulate_bead(
        low, Camera(frame_s, 0.0), frames, np.random.default_rng(15), time_step_s=frame_s / 200
    )
    height = trace.position_nm[:, 2]
    steps = np.mean(np.diff(trace.position_nm, axis=0) ** 2, axis=0)
    # the relaxation takes off a part of frame/(2 tau) = 0.5 % (z); the first and last step 0.25 %
    for axis in range(3):
        gamma = tethered_bead.friction_pN_s_per_nm(
            height, radius, 1.0, wall=wall, upright=axis == 2
        )
        expected = 2 * KT * frame_s * np.mean(1 / gamma)
        assert steps[axis] == pytest.approx(expected, rel=SIGMAS * np.sqrt(2 / frames) + 0.01)


def test_one_mode_along_the_field_and_two_across():
    radius, force, frames = 1400.0, 5.0, 65536
    camera = Camera(FRAME_S, FRAME_S)
    turning = bead(2700, radius, force)
    recorded = simulate_bead(turning, camera, frames, np.random.default_rng(8)).position_nm
    length = float(tether.mean_extension_nm(turning.chain, force))
    gamma = tethered_bead.friction_pN_s_per_nm(length, radius, 1.0, wall=True)
    two = tethered_bead.turning_modes(length, radius, wall=True)
    f = np.fft.rfftfreq(frames, FRAME_S)[1:-1]

    def worst(axis, stiffness, modes):
        ordinates = 2 * FRAME_S / frames * np.abs(np.fft.rfft(recorded[:, axis])[1:-1]) ** 2
        expected = sum(
            cam.power_spectrum(f, share * KT / stiffness, gamma / stiffness / rate, camera)
            for share, rate in zip(modes.shares, modes.rates, strict=True)
        )
        edges = np.searchsorted(f, [0, 2, 5, 10, 20, 40, 60])
        ratio = ordinates / expected
        bands = [ratio[a:b] for a, b in itertools.pairwise(edges)]
        return max(abs(band.mean() - 1) * np.sqrt(band.size) for band in bands)

    # the largest of 6 bands each
    assert worst(0, force / length, SINGLE_MODE) < SIGMAS
    assert worst(1, force / (length + radius), two) < SIGMAS
    assert worst(1, force / (length + radius), SINGLE_MODE) > 1.5 * SIGMAS


def test_the_field_can_lie_along_either_axis():
    camera = Camera(FRAME_S, FRAME_S)
    along_x, along_y = (
        simulate_bead(bead(along=along), camera, 20, np.random.default_rng(8)).position_nm
        for along in (0, 1)
    )
    assert np.array_equal(along_x[:, [1, 0, 2]], along_y)


@pytest.mark.parametrize("kappa", [2e3, 8e3])
def test_a_soft_alignment_adds_to_the_variance_along_the_field(kappa):
    force, radius = 4.0, 500.0
    held = bead(1200, radius, force, alignment_pN_nm=kappa)
    trace = simulate_bead(held, Camera(5e-3, 0.0), 40_000, np.random.default_rng(9))
    length = float(tether.mean_extension_nm(held.chain, force))
    expected = KT * (length / force + radius**2 / (force * radius + kappa))
    # harmonic in the angle, which varies by up to sqrt(kT/4000) = 0.03
    error = assert_mean(trace.position_nm[:, 0] ** 2, expected, bias=0.003 * expected)
    assert error < 0.1 * (expected - KT * length / force)


def held_sideways(share, force_pN=4.0, **changes):
    """A bead of which the magnets hold a share of the stiffness along the field."""
    length = float(tether.mean_extension_nm(chain(), force_pN))
    return bead(force_pN=force_pN, sideways_per_nm=share / (1 - share) / length, **changes)


def swung_about_the_anchor(held, swing_nm, height_nm):
    """0 on average, in nm, for what swings about the anchor as one piece, its height with it.

    The mean of a rotation's generator on swing times Boltzmann weight is 0: with the energy
    -F height + F s swing²/2, kT<height> = F<swing²> + F s<swing² height>, for any chain.
    """
    pull = held.force_pN / KT
    return pull * swing_nm**2 * (1 + held.sideways_per_nm * height_nm) - height_nm


@pytest.mark.parametrize("turns", [True, False])
@pytest.mark.parametrize("share", [1 / 3, 0.999])
def test_equipartition_holds_exactly_where_the_magnets_hold_the_bead_sideways(share, turns):
    """At 0.999 the magnets are the fastest, and set the time step."""
    held = held_sideways(share, turns=turns)
    assert longest_time_step_s(held, Camera(1.0, 0.0)) < 1e-5 or share < 0.5
    trace = simulate_bead(held, Camera(3e-3, 0.0), 12_000, np.random.default_rng(16))
    x, y, z = trace.position_nm.T
    length = float(tether.mean_extension_nm(held.chain, held.force_pN))
    # across the field tether and bead swing as one piece, where it turns; else as along it
    height = z + held.radius_nm if turns else z
    error = assert_mean(swung_about_the_anchor(held, y, height), 0.0)
    assert error < 0.02 * (length + turns * held.radius_nm)
    assert_mean(y, 0.0)
    assert_mean(x, 0.0)
    if not turns:
        assert assert_mean(swung_about_the_anchor(held, x, height), 0.0) < 0.02 * length


@pytest.mark.parametrize("share", [1 / 3, 0.9])
def test_a_bead_held_sideways_starts_in_equilibrium(share):
    held = held_sideways(share)
    fine, random = tabulate(held.chain, held.force_pN), np.random.default_rng(17)
    # a thousand nodes are enough, and faster
    columns = (fine.distance_nm, fine.energy_pN_nm, fine.secant_pN_per_nm)
    table = ChainTable(*(column[::64] for column in columns))
    starts = np.array([draw_state(held, table, held.force_pN, random) for _ in range(4000)])
    x, y, z = starts[:, :3].T
    length = float(tether.mean_extension_nm(held.chain, held.force_pN))
    reach = length + held.radius_nm
    error = assert_mean(swung_about_the_anchor(held, y, z + held.radius_nm), 0.0)
    assert error < 0.04 * reach
    # along the field the height is the tether's end's, which is its mean but for some nm
    assert_mean(swung_about_the_anchor(held, x, length), 0.0, bias=0.005 * length)


@pytest.mark.parametrize("alignment_pN_nm", [None, 4e3])
@pytest.mark.parametrize("direction", ["x", "y"])
def test_the_magnets_hold_an_experiment_s_bead_sideways(direction, alignment_pN_nm):
    """Variances of a recording, step by step, are those of the stiffness matrix (E15)."""
    force, frames = 4.0, 12_000
    effects = ["wall_drag", "rotation_coupling"]
    setup = parse_setup(
        setup_content(field={"direction": direction}, model={"effects": effects}),
    )
    experiment, _ = experiment_of(setup, [force], frames, stage=Stage())
    experiment = dataclasses.replace(experiment, camera=Camera(3e-3, 0.0))
    length = float(tether.mean_extension_nm(experiment.chain, force))
    experiment = with_magnets(
        experiment, sideways_per_nm=0.5 / length, alignment_pN_nm=alignment_pN_nm
    )
    state = bead_state(experiment, force)
    amplitude = state.modes.amplitude_nm
    expected = np.sum(amplitude**2, axis=1)
    recording = simulate_experiment(experiment, setup, 18, engine="brownian")
    position = recording.positions_nm["b1"]
    spread = position - position.mean(axis=0)
    for axis in (0, 1):
        error = assert_mean(spread[:, axis] ** 2, expected[axis], bias=0.01 * expected[axis])
        assert error < 0.03 * expected[axis]  # a third is the magnets'
    # held so, the bead swings less and hangs higher, by 0.4 nm; tilting it hangs lower
    error = assert_mean(position[:, 2], state.extension_nm, bias=0.1)
    assert error < 0.07
    # the closed form, with the locked tilt
    if alignment_pN_nm is None:
        kT = experiment.fluid.thermal_energy_pN_nm
        held = force * experiment.magnets.sideways_per_nm
        across = kT / (force / (length + experiment.bead.radius_nm) + held)
        both = [kT / (force / length + held), across]
        assert expected[:2] == pytest.approx(both if direction == "x" else both[::-1], rel=1e-6)


def test_magnets_hold_a_bead_where_the_field_does_also_off_its_lowest_point():
    force, radius, angle = 4.0, 500.0, 0.6
    off = held_sideways(0.5, attachment_angle_rad=angle)
    trace = simulate_bead(off, Camera(5e-3, 0.0), 10_000, np.random.default_rng(19))
    x, y, _ = trace.position_nm.T
    length = float(tether.mean_extension_nm(off.chain, force))
    side, down = radius * np.sin(angle), radius * np.cos(angle)
    held = force * off.sideways_per_nm
    assert_mean(x, -side)
    assert_mean((x + side) ** 2, KT / (force / length + held), bias=0.005 * KT * length / force)
    expected = KT / (force / (length + down) + held)
    assert_mean(y**2, expected, bias=0.01 * expected)


def test_an_attachment_off_the_lowest_point_couples_the_axes():
    """The lever is R cos, height and position along the field covary, the mean is shifted."""
    force, radius, angle, kappa = 4.0, 500.0, 0.6, 5e4
    off = bead(1200, radius, force, alignment_pN_nm=kappa, attachment_angle_rad=angle)
    trace = simulate_bead(off, Camera(5e-3, 0.0), 10_000, np.random.default_rng(10))
    x, y, z = trace.position_nm.T
    length = float(tether.mean_extension_nm(off.chain, force))
    side, down = radius * np.sin(angle), radius * np.cos(angle)
    hold = kappa + force * down
    tilt = -force * side / hold
    assert_mean(y**2, KT * (length + down) / force, bias=0.01 * KT * length / force)
    spread = x - x.mean()
    assert_mean(spread**2, KT * (length / force + down**2 / hold))
    assert_mean(
        spread * (z - z.mean()), KT * side * down / hold, bias=0.1 * KT * side * down / hold
    )
    assert_mean(x, -side - tilt * down, bias=1.0)
    # the turn about the field's axis, by sqrt(kT/(F down)) = 0.05, lowers the centre
    assert_mean(z, length + down - radius - tilt * side - KT / force / 2, bias=0.5)


def test_force_can_change_from_frame_to_frame():
    force = np.repeat([1.0, 6.0], 3000)
    trace = simulate_bead(
        bead(force_pN=force, turns=False), Camera(0.02, 0.02), 6000, np.random.default_rng(11)
    )
    for part in (slice(0, 3000), slice(3050, 6000)):
        expected = float(tether.mean_extension_nm(chain(), force[part][0]))
        assert_mean(trace.position_nm[part, 2], expected)


def test_blur_takes_the_variance_that_the_closed_form_says():
    force, frames = 10.0, 16_000
    locked = bead(force_pN=force, turns=False)
    camera = Camera(FRAME_S, 0.5 * FRAME_S)
    trace = simulate_bead(locked, camera, frames, np.random.default_rng(12))
    length = float(tether.mean_extension_nm(locked.chain, force))
    gamma = tethered_bead.friction_pN_s_per_nm(length, 500.0, 1.0, wall=True)
    tau_s = float(gamma * length / force)
    expected = cam.frame_variance(KT * length / force, tau_s, camera)
    assert expected < 0.5 * KT * length / force
    for axis in (0, 1):
        error = np.sqrt(2 / frames)  # samples are 7 relaxations apart
        variance = np.mean(trace.position_nm[:, axis] ** 2)
        assert variance == pytest.approx(expected, rel=SIGMAS * error + 0.003)


@FEW
@given(
    contour_nm=st.floats(100, 5000),
    radius_nm=st.floats(200, 3000),
    force_pN=st.floats(0, 40),
    formula=st.sampled_from(["marko-siggia", "bouchiat", "extensible"]),
    share=st.sampled_from([0.0, 0.5, 1.0]),
    kappa=st.sampled_from([None, 1e3, 1e5]),
    sideways=st.sampled_from([0.0, 1e-4, 5e-3]),
    flags=st.tuples(st.booleans(), st.booleans(), st.integers(0, 1)),
    angle=st.floats(0, 1.5),
)
def test_the_bead_stays_above_the_surface_and_on_its_tether(
    contour_nm, radius_nm, force_pN, formula, share, kappa, sideways, flags, angle
):
    modulus = 1000.0 if formula == "extensible" else None
    odd = BrownianBead(
        chain(contour_nm, formula=formula, stretch_modulus_pN=modulus),
        force_pN,
        radius_nm,
        1.0,
        wall=flags[0],
        turns=flags[1],
        along=flags[2],
        alignment_pN_nm=kappa,
        sideways_per_nm=sideways,
        attachment_angle_rad=angle,
    )
    assume(radius_nm * (1 - np.cos(angle)) < 0.3 * contour_nm)
    camera = Camera(1e-3, share * 1e-3)
    try:
        first, again = (
            simulate_bead(odd, camera, 20, np.random.default_rng(13)).position_nm for _ in range(2)
        )
    except ValueError as error:
        # magnets that hold a tilted bead sideways by many kT are refused, as documented
        assume("nothing of the tether's swing to start from" not in str(error))
        raise
    assert np.array_equal(first, again)
    assert np.all(first[:, 2] >= 0)
    # the centre is within the taut tether and the radius of the anchor
    centre = first + np.array([0.0, 0.0, radius_nm])
    reach = contour_nm * (1.05 if modulus is None else 1.2)
    assert np.all(np.linalg.norm(centre, axis=1) < reach + radius_nm)


def test_what_makes_no_sense_is_refused():
    camera, random = Camera(1.0, 1.0), np.random.default_rng(0)
    with pytest.raises(ValueError, match="3 forces for 2 frames"):
        simulate_bead(bead(force_pN=np.ones(3)), camera, 2, random)
    for changes, words in (
        ({"force_pN": -1.0}, "force_pN"),
        ({"radius_nm": 0.0}, "radius_nm"),
        ({"along": 2}, "along"),
        ({"alignment_pN_nm": -1.0}, "alignment_pN_nm"),
        ({"sideways_per_nm": -1e-4}, "sideways_per_nm"),
        ({"attachment_angle_rad": 2.0}, "attachment_angle_rad"),
    ):
        with pytest.raises(ValueError, match=words):
            bead(**changes)


def test_a_bead_that_cannot_leave_the_surface_or_its_place_is_refused():
    stuck = bead(100, 3000, 1.0, turns=False, attachment_angle_rad=1.0)
    with pytest.raises(ValueError, match="does not let the bead out of the surface"):
        simulate_bead(stuck, Camera(0.01, 0.01), 1, np.random.default_rng(0))
    clamped = bead(sideways_per_nm=1e4)
    with pytest.raises(ValueError, match="leave nothing of the tether's swing"):
        simulate_bead(clamped, Camera(0.01, 0.01), 1, np.random.default_rng(0))


def test_friction_at_contact_does_not_stop_the_start():
    """The tables reach from contact to infinity and hold the library's own factors between."""
    short = bead(100, 1400, 0.02)
    trace = simulate_bead(short, Camera(0.01, 0.01), 50, np.random.default_rng(14))
    assert np.all(np.isfinite(trace.position_nm))
    assert friction.parallel_wall_factor(1400 + trace.position_nm[:, 2].mean(), 1400.0) > 1.5

"""The configured experiment fitted to whole recordings, against the truth of simulated ones.

Seeds are fixed. Where a bound is statistical, the chance that it fails for a right programme is
stated beside it.
"""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.crosschecking.prepared_bead import described, prepare
from mtpipe.crosschecking.twin import TwinMaker
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import (
    Clock,
    ForceCourse,
    Line,
    Magnets,
    Optics,
    Stage,
    Tracker,
)
from mtpipe.experiment.parameter import Parameter
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit import fit as fit_module
from mtpipe.joint_fit import spectra
from mtpipe.joint_fit.data import plateau_data
from mtpipe.joint_fit.expectation import Subtraction
from mtpipe.joint_fit.fit import STUCK, fit_configured, nearby_fit
from mtpipe.joint_fit.information import gradient_of
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.joint_fit.random_walk import line_of, sees_walks
from mtpipe.joint_fit.slopes import slopes
from mtpipe.joint_fit.spectra import edges_about, matrix_periodogram, quick_length
from mtpipe.joint_fit.three_axes import inverses
from mtpipe.physics.camera import Camera
from mtpipe.simulation.readout import recorded
from mtpipe.spectra.spectrum import periodogram
from mtpipe.spectra.window import bin_edges
from tests.small_case import FORCES_PN, NOISE_NM, case, generator, raw, setup

pytestmark = pytest.mark.slow

FRAME_S = 1 / 120


@pytest.fixture(scope="module")
def fitted():
    """Bead and fit of a few recordings, with the formula of the chain that they were made by."""
    return [case(raw(seed)) for seed in range(5)]


def test_diagonal_of_the_matrix_is_the_spectrum_of_each_axis():
    x = np.cumsum(generator(1).normal(size=(3001, 2)), axis=0)
    x[700:720] = np.nan
    phi = (0.9, 0.5)
    found = matrix_periodogram(x, FRAME_S, phi)
    for axis in range(2):
        alone = periodogram(x[:, axis], FRAME_S, phi=phi[axis])
        assert found.frequency_hz == pytest.approx(alone.frequency_hz)
        assert found.power[:, axis, axis] == pytest.approx(alone.power)
        assert found.ordinates == pytest.approx(alone.ordinates)


def test_white_noise_in_common_to_two_axes_is_their_cross_spectrum():
    # 40 000 frames: the mean over all bins has a standard error of 0.7 %, failing one time in 1e4
    shared, x, y = generator(2).normal(size=(3, 40_000))
    position = np.column_stack([x + shared, y - 2 * shared])
    found = matrix_periodogram(position, FRAME_S, (0.3, 0.6))
    gain = np.sqrt(found.gain(0) * found.gain(1))
    level = 2 * FRAME_S
    cross = np.average(found.power[:, 0, 1] / gain, weights=found.ordinates)
    own = np.average(found.power[:, 1, 1] / found.gain(1), weights=found.ordinates)
    assert cross == pytest.approx(-2 * level, rel=0.04)
    assert own == pytest.approx(5 * level, rel=0.04)


def test_inverses_and_determinants_are_those_of_lapack():
    root = np.random.default_rng(2).normal(size=(50, 3, 3)) * [[1.0], [1e3], [1e-3]]
    power = root @ np.swapaxes(root, 1, 2)
    inverse, log_determinant = inverses(power)
    size = 1 / np.sqrt(np.diagonal(power, axis1=1, axis2=2))
    error = (inverse - np.linalg.inv(power)) / (size[:, :, None] * size[:, None, :])
    assert np.max(np.abs(error)) < 1e-6
    assert log_determinant == pytest.approx(np.linalg.slogdet(power)[1], abs=1e-8)
    none, ln_none = inverses(np.zeros((1, 3, 3)))
    assert np.isnan(none).all()
    assert np.isnan(ln_none).all()
    # two axes with more in common than they have, which is the power of nothing
    impossible = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 1.0]]])
    assert np.isnan(inverses(impossible)[1]).all()


def test_mean_heights_scatter_as_stated_where_noise_is_most_of_it(fitted):
    """Of white noise alone that a mean of 100 frames is of, half of them lost."""
    one = fitted[0]
    model, frames, noise_nm = one.fit.model, 200, 40.0
    noisy, quiet = (
        replace(model.described(one.fit.theta), tracker=Tracker(noise_nm=(1.0, 1.0, of_z)))
        for of_z in (noise_nm, 0.0)
    )
    position = generator(6).normal(size=(frames, 3))
    position[60:160] = np.nan
    data = plateau_data(position, FRAME_S, one.phi[0])
    subtraction = Subtraction((0.1, 0.1, 0.1), (0.0, 0.0, 30.0))
    nothing = Subtraction((None, None, None), (0.0, 0.0, 0.0))
    stderr, without = (
        replace(model, data=(data,), subtraction=of).expected(there, 0, 20.0).extension_stderr_nm
        for of, there in ((subtraction, noisy), (nothing, quiet))
    )
    assert stderr**2 - without**2 == pytest.approx((noise_nm**2 + 30.0**2) / 100)


@pytest.mark.parametrize("ordinate", [40.0, 95.5, 300.3])
def test_a_wave_is_expected_in_all_bins_that_it_leaks_into(fitted, ordinate):
    """The mean over phases of what is recorded; 95.5 lies between two bins."""
    one = fitted[0]
    data, model = one.fit.model.data[0], one.fit.model
    frames, size_nm = data.spectrum.used.size, 3.0
    line_hz = ordinate / (frames * FRAME_S)
    experiment = model.described(one.fit.theta)
    force_pN = float(one.fit.force_pN[0])
    lines = (Line(line_hz, (size_nm, 0.0, 0.0)),)
    with_it, without = (
        model.expected(there, 0, force_pN).power[:, 0, 0]
        for there in (with_stage(experiment, lines=lines), experiment)
    )
    phases = np.arange(16) * np.pi / 8
    time_s = FRAME_S * np.arange(frames + 1)
    rest = generator(4).normal(size=(frames + 1, 2))
    recorded = []
    for phase in phases:
        wave = size_nm * np.cos(2 * np.pi * line_hz * time_s + phase)
        found = matrix_periodogram(np.column_stack([wave, rest]), FRAME_S, one.phi[0])
        recorded.append(found.power[:, 0, 0])
    mean = np.mean(recorded, axis=0)
    assert with_it - without == pytest.approx(mean, rel=1e-6, abs=1e-9 * mean.max())
    assert np.sum(mean > 0.2 * mean.max()) == (2 if ordinate == 95.5 else 1)


def test_a_wave_whose_phase_diffuses_is_expected_as_it_is_simulated(fitted):
    """In bins of its own. 400 waves: each bin's mean is within 5 % one time in three, and no bin of
    some 14 beyond 25 % but for 1 set of waves in 10⁵.
    """
    one = fitted[0]
    data, model = one.fit.model.data[0], one.fit.model
    frames, line_hz = data.spectrum.used.size, 31.7
    experiment = model.described(one.fit.theta)
    line = Line(line_hz, (3.0, 0.0, 0.0), 2.0)
    random = generator(14)
    rest = replace(experiment, stage=Stage(), tracker=Tracker(), optics=Optics())
    waving = replace(rest, stage=Stage(lines=(line,)))
    waves = [recorded(np.zeros((frames + 1, 3)), np.ones(frames + 1), waving, random)[:, 0]
             for _ in range(400)]  # fmt: skip
    still = random.normal(size=(frames + 1, 2))
    spectra_of = [
        matrix_periodogram(np.column_stack([wave, still]), FRAME_S, one.phi[0], (line_hz,))
        for wave in waves
    ]
    apart = replace(data, spectrum=spectra_of[0])
    with_it, without = (
        replace(model, data=(apart,)).expected(there, 0, 7.0).power[:, 0, 0]
        for there in (with_stage(experiment, lines=(line,)), experiment)
    )
    mean = np.mean([found.power[:, 0, 0] for found in spectra_of], axis=0)
    near = np.abs(apart.spectrum.frequency_hz - line_hz) < 2
    assert near.sum() >= 7
    assert (with_it - without)[near] == pytest.approx(mean[near], rel=0.25)
    total = apart.spectrum.ordinates @ (with_it - without)
    # each wave has its size by construction, whatever its phase does
    assert total == pytest.approx(apart.spectrum.ordinates @ mean, rel=0.02)


@given(
    frames=st.integers(64, 20_000),
    shares=st.lists(st.floats(0.0, 0.6), max_size=4),
    frame_s=st.sampled_from([0.002, 0.1]),
)
def test_bins_about_lines_hold_every_ordinate_once(frames, shares, frame_s):
    usual = bin_edges(frames, 1)
    lines_hz = tuple(share / frame_s for share in shares)
    edges = edges_about(lines_hz, frames, frame_s)
    assert (edges[0], edges[-1]) == (usual[0], usual[-1])
    widths = np.diff(edges)
    assert widths.min() >= 1
    assert widths.max() <= 2 * np.diff(usual).max()


def test_a_line_has_a_bin_of_its_own_and_far_ones_are_as_usual():
    edges, usual = edges_about((30.0,), 8192, FRAME_S), bin_edges(8192, 1)
    ordinate = 30.0 * 8192 * FRAME_S
    at = np.searchsorted(edges, ordinate, side="right")
    assert (edges[at - 1], edges[at]) == (ordinate - 2, ordinate + 3)
    assert np.diff(edges)[at - 4 : at + 3].tolist() == [20, 10, 5, 5, 5, 10, 20]
    far = (usual < 0.9 * ordinate) | (usual > 1.1 * ordinate)
    assert set(usual[far]) <= set(edges)


def test_forces_are_found_with_the_errors_stated(fitted):
    pulls = np.array([np.log(c.fit.force_pN / FORCES_PN) for c in fitted])
    pulls /= np.array([c.fit.force_stderr_pN / c.fit.force_pN for c in fitted])
    # 15 pulls of about unit variance: their mean square is within 0.25 and 2.4 but for 1 in 1000
    assert all(c.fit.converged for c in fitted)
    assert 0.25 < np.mean(pulls**2) < 2.4


def test_noise_is_found_with_the_errors_stated(fitted):
    pulls = []
    for one in fitted:
        model, stderr = one.fit.model, np.sqrt(np.diag(one.fit.covariance))
        for k, parameter in enumerate(model.parameters):
            if parameter.name.startswith("tracking noise"):
                i = model.plateaus + k
                true = NOISE_NM["xyz".index(parameter.name[-1])] ** 2
                pulls.append((one.fit.theta[i] - true) / stderr[i])
    assert len(pulls) == 15
    assert 0.25 < np.mean(np.square(pulls)) < 2.4


def test_start_far_away_ends_in_the_same_place(fitted):
    fit = fitted[0].fit
    start = fit.theta.copy()
    start[: fit.model.plateaus] += [0.3, -0.3, 0.2]
    again = fit_configured(fit.model, start)
    assert again.log_likelihood == pytest.approx(fit.log_likelihood, abs=0.05)
    assert again.force_pN == pytest.approx(fit.force_pN, rel=0.2 * np.max(
        fit.force_stderr_pN / fit.force_pN))  # fmt: skip


def test_a_long_tether_is_found_where_forces_of_a_coarse_grid_miss_its_height():
    """Heights known to 0.1 nm once drew the first guess to forces far too small."""
    found = case(raw(3, tether={"contour_length_nm": 7000.0}))
    assert found.fit.force_pN == pytest.approx(FORCES_PN, rel=0.3)


def test_gradient_is_that_of_the_likelihood(fitted):
    fit = fitted[0].fit
    model, theta = fit.model, fit.theta + 0.02
    expected = model.all_expected(theta)
    gradient = gradient_of(model, model.data, theta, expected, slopes(model, theta, expected))
    for i in (0, model.plateaus):
        step = np.zeros_like(theta)
        step[i] = 1e-3
        ends = [
            model.log_likelihood(model.all_expected(t), t) for t in (theta + step, theta - step)
        ]
        assert gradient[i] == pytest.approx((ends[0] - ends[1]) / 2e-3, rel=0.05, abs=2.0)


def longer(ends, experiment, share):
    length_nm, bead = experiment.chain.contour_length_nm * (1 + share), experiment.bead
    if ends and share > 0:
        length_nm, bead = 50.0, replace(bead, offset_nm=0.9 * bead.radius_nm)
    chain = replace(experiment.chain, contour_length_nm=length_nm)
    return replace(experiment, chain=chain, bead=bead)


def test_where_a_step_leaves_the_bead_on_the_surface_slopes_are_those_of_a_step_back(fitted):
    fit = fitted[0].fit
    theta = np.append(fit.theta, 0.0)
    found = []
    for ends in (False, True):
        change = partial(longer, ends)
        share = Parameter("longer", "", 0.0, -0.1, 0.1, 1e-5, None, change)
        model = replace(fit.model, parameters=(*fit.model.parameters, share))
        found.append(slopes(model, theta, fit.expected))
    for ahead, back in zip(*found, strict=True):
        assert back.extension_nm[-1] == pytest.approx(ahead.extension_nm[-1], rel=1e-3)
        np.testing.assert_allclose(back.extension_nm[:-1], ahead.extension_nm[:-1])


def walking(fitted, begins_s=()):
    """A model in which the bead's z walks off, and θ at 0.5 nm/√s."""
    model, theta = fitted[0].fit.model, fitted[0].fit.theta
    (drift,) = (effect for effect in OWN if effect.name == "drift")
    parameters = drift.hypotheses(model.experiment, Evidence((), FORCES_PN))[0].parameters
    model = replace(model, parameters=(*model.parameters, *parameters), begins_s=begins_s)
    return model, np.concatenate([theta, [0.04, 0.04, 0.25]])


def test_heights_wander_as_the_mean_of_a_random_walk_does(fitted):
    model, _ = walking(fitted, (5.0, 30.0, 60.0))
    lasts = [data.duration_s for data in model.data]
    step_s = 0.05
    walks = np.cumsum(generator(3).normal(size=(4000, 2000)), axis=1) * np.sqrt(step_s)
    edges = [(begin, begin + last) for begin, last in zip(model.begins_s, lasts, strict=True)]
    assert edges[-1][1] < 2000 * step_s
    means = np.array(
        [walks[:, round(a / step_s) : round(b / step_s)].mean(axis=1) for a, b in edges]
    )
    # 4000 walks: 2 % standard error each, all nine within 10 % but for one time in 1e5
    np.testing.assert_allclose(np.cov(means), model.wandering_s, rtol=0.1)


@pytest.mark.parametrize("begins_s", [(), (5.0, 30.0, 60.0)])
@pytest.mark.parametrize("long", [False, True])
def test_gradient_follows_the_walk(fitted, begins_s, long, monkeypatch):
    # of plateaus as long as this their spectra are means of several, and see no walk's end
    monkeypatch.setattr(spectra, "LONGEST_SEGMENT", 600 if long else 2**16)
    one = fitted[0]
    plateaus = zip(one.positions_nm, one.phi, strict=True)
    data = tuple(plateau_data(x, FRAME_S, phi) for x, phi in plateaus)
    assert sees_walks(data[0]) is not long
    model, theta = walking(fitted, begins_s)
    model = replace(model, data=data)
    expected = model.all_expected(theta)
    gradient = gradient_of(model, model.data, theta, expected, slopes(model, theta, expected))
    for k in (*range(model.plateaus), -3, -2, -1):
        step = 1e-4 if k < 0 else 1e-5
        moved = [theta.copy(), theta.copy()]
        moved[0][k] += step
        moved[1][k] -= step
        ends = [model.log_likelihood(model.all_expected(t), t) for t in moved]
        slope = (ends[0] - ends[1]) / (2 * step)
        # slopes of forces are one-sided differences, those of walks are not
        assert gradient[k] == pytest.approx(slope, rel=1e-3, abs=1e-3 if k < 0 else 2.0)


def test_gradient_follows_a_walk_that_begins(fitted):
    model, theta = walking(fitted)
    theta[-3:] = 0.0
    expected = model.all_expected(theta)
    gradient = gradient_of(model, model.data, theta, expected, slopes(model, theta, expected))
    for k in (-3, -2, -1):
        values = []
        for size in (0.0, 1e-5, 2e-5):
            there = theta.copy()
            there[k] = size
            values.append(model.log_likelihood(model.all_expected(there), there))
        slope = (4 * values[1] - 3 * values[0] - values[2]) / 2e-5
        assert gradient[k] == pytest.approx(slope, rel=0.02)


def test_nearby_fit_of_a_simulation_is_its_full_fit(fitted):
    one = fitted[1]
    maker, random = TwinMaker(one), generator(7)
    for _ in range(3):
        twin = maker.draw(random)
        data = tuple(
            plateau_data(x, FRAME_S, phi) for x, phi in zip(twin.positions_nm, one.phi, strict=True)
        )
        near = nearby_fit(one.fit, data).expected
        full = fit_configured(replace(one.fit.model, data=data), one.fit.theta)
        for i, (quick, exact) in enumerate(zip(near, full.expected, strict=True)):
            for axis in range(3):
                ratio = quick.power[:, axis, axis] / exact.power[:, axis, axis]
                change = exact.power[:, axis, axis] / one.fit.expected[i].power[:, axis, axis] - 1
                # what one step leaves is of second order in what the fit changes
                allowed = 0.02 + 2 * np.max(np.abs(change)) ** 2
                assert ratio == pytest.approx(1.0, abs=allowed)
            change = abs(exact.extension_nm - one.fit.expected[i].extension_nm)
            assert quick.extension_nm == pytest.approx(exact.extension_nm, abs=0.1 + 0.1 * change)


def test_a_line_is_that_of_the_frames_and_worked_out_once():
    """Other traces with the same frames have it, those that lose others have another."""
    random = generator(3)
    first, again, lost = (random.normal(size=(600, 3)) for _ in range(3))
    lost[100:140] = np.nan
    data = [plateau_data(x, FRAME_S, (0.2, 0.3, 0.4)) for x in (first, again, lost)]
    assert line_of(data[0]) is line_of(data[1])
    assert line_of(data[2]) is not line_of(data[0])
    rising = np.arange(600) / 600
    for one in data:
        exact = [one.spectrum.transform_of(rising, axis) for axis in range(3)]
        assert np.array_equal(line_of(one).transforms, exact)


def test_stated_error_of_the_viscosity_is_used():
    stated = {"viscosity_mPa_s": 0.89 / 1.08, "viscosity_mPa_s_stderr": 0.05}
    recording = replace(raw(4), setup=setup(buffer=stated))
    fit = case(recording).fit
    names = [p.name for p in fit.model.parameters]
    k = fit.model.plateaus + names.index("ln viscosity")
    stderr = float(np.sqrt(fit.covariance[k, k]))
    # true value is 8 % above what is stated; 4 standard errors fail once in 16 000
    assert fit.theta[k] == pytest.approx(np.log(1.08), abs=4 * stderr)
    assert stderr < 0.03


def test_data_that_no_force_explains_are_refused(fitted):
    model = fitted[0].fit.model
    nonsense = tuple(
        replace(d, spectrum=replace(d.spectrum, power=np.full_like(d.spectrum.power, np.nan)))
        for d in model.data
    )
    broken = ConfiguredModel(nonsense, model.experiment, model.parameters, model.subtraction)
    with pytest.raises(FitError, match="no force makes the configured experiment agree"):
        fit_configured(broken)


@pytest.mark.parametrize(
    ("stated", "relative"),
    [({"temperature_K_stderr": 6.0}, 0.0201), ({"temperature_K": "unknown"}, 0.0101)],
)
def test_a_doubtful_temperature_is_in_the_error_of_every_force(fitted, stated, relative):
    exact = fitted[1].fit
    doubtful = case(replace(raw(1), setup=setup(buffer=stated))).fit
    added = (doubtful.force_stderr_pN / doubtful.force_pN) ** 2
    added -= (exact.force_stderr_pN / exact.force_pN) ** 2
    # diffusion with a known friction tells the temperature a little
    assert np.all(np.sqrt(added) < 1.01 * relative)
    assert np.all(np.sqrt(added) > 0.6 * relative)


def test_a_doubtful_pixel_lets_x_and_y_be_larger_than_they_are():
    recording = subtract_drift(raw(1))
    larger = {bead: xyz * [1.03, 1.03, 1.0] for bead, xyz in recording.positions_nm.items()}
    pixel = {"pixel_size_nm": 100.0, "pixel_size_nm_stderr": 3.0}
    found = prepare(replace(recording, positions_nm=larger, setup=setup(camera=pixel)), "b1")
    scale, stderr = described(found).optics.lateral_scale, np.sqrt(np.diag(found.fit.covariance))
    (k,) = (k for k, p in enumerate(found.fit.model.parameters) if p.name == "ln scale of x and y")
    assert stderr[found.fit.model.plateaus + k] < 0.03
    assert abs(np.log(scale / 1.03)) < 3 * stderr[found.fit.model.plateaus + k]


def test_experiments_asked_for_together_are_expected_as_one_by_one(fitted):
    """Of two plateaus, by other cameras, noises and courses; one of them holds no bead."""
    model, theta = fitted[0].fit.model, fitted[0].fit.theta
    experiment = model.described(theta)
    course = ForceCourse(0.3, "settling", 0.2)
    camera = experiment.camera
    others = [
        experiment,
        replace(experiment, tracker=Tracker(noise_nm=(1.0, 2.0, 3.0))),
        replace(experiment, camera=Camera(camera.frame_s, 0.5 * camera.exposure_s)),
        replace(experiment, clock=Clock(dropped_share=0.1)),
        replace(experiment, stage=Stage(unsubtracted_nm_per_root_s=(1.0, 0.0, 2.0))),
        replace(experiment, magnets=Magnets(courses=(course,) * model.plateaus)),
        experiment,
    ]
    asked = [(other, i, force_pN) for i in (0, 1) for other in others for force_pN in (1e-4, 5.0)]
    # plateaus in turns as well
    asked += [(other, i, 7.0) for other in others for i in (0, 1)]
    found = model.expectations([model.asked(*one) for one in asked])
    # other data, of which nothing is known already
    fresh = replace(model, data=tuple(replace(one) for one in model.data))
    refused = 0
    for one, together in zip(asked, found, strict=True):
        if isinstance(together, FitError):
            refused += 1
            with pytest.raises(FitError, match="does not hold"):
                fresh.expected(*one)
            continue
        alone = fresh.expected(*one)
        assert together.power == pytest.approx(alone.power, rel=1e-12, abs=0)
        assert together.extension_nm == pytest.approx(alone.extension_nm, rel=1e-13)
        assert together.extension_stderr_nm == pytest.approx(alone.extension_stderr_nm, rel=1e-12)
        assert together.walked_nm2 == pytest.approx(alone.walked_nm2, rel=1e-12)
    assert refused == 2 * len(others)


BEND, SLOPE = np.array([[1.0, 0.99], [0.99, 1.0]]), np.array([1.0, 0.9])
PEAK = np.linalg.solve(BEND, SLOPE)


@pytest.fixture
def parabola(monkeypatch):
    """Of a bound of the first of two coordinates, and what each look at the likelihood takes off
    it: a model whose likelihood is a parabola with its peak far beyond the bound, and how often it
    was looked at. `expected_share` : of its bend is expected.
    """

    def made(bound, lost=0.0, expected_share=1.0):
        looks = []

        def log_likelihood(expected, theta):
            looks.append(theta)
            return float(SLOPE @ theta - theta @ BEND @ theta / 2) - lost * len(looks)

        model = SimpleNamespace(
            lower=np.full(2, -10.0),
            upper=np.array([bound, 10.0]),
            data=(),
            all_expected=lambda theta: [],
            log_likelihood=log_likelihood,
            information=expected_share * BEND,
        )
        return model, looks

    monkeypatch.setattr(fit_module, "slopes", lambda *_: [])
    monkeypatch.setattr(
        fit_module, "gradient_of", lambda model, data, theta, *_: SLOPE - BEND @ theta
    )
    monkeypatch.setattr(fit_module, "information_of", lambda model, *_: model.information)
    return made


def test_a_fit_goes_on_where_a_bound_turns_its_step_round(parabola):
    """Clipped, the first step has a predicted rise of -4: shorter ones are tried."""
    model, _ = parabola(bound=0.1)
    found = fit_configured(model, np.zeros(2))
    assert found.converged
    assert found.theta == pytest.approx([0.1, 0.9 - 0.99 * 0.1], abs=0.05)


def test_a_step_that_changes_nothing_is_not_tried_again_and_again(parabola):
    """At the peak, where rounding makes each look a little worse."""
    model, looks = parabola(bound=10.0, lost=1e-7)
    found = fit_configured(model, PEAK)
    assert found.converged
    assert len(looks) == 2


@pytest.mark.parametrize(("share", "most"), [(1.0, 4), (0.51, 9)])
def test_a_step_that_goes_too_far_is_shortened(parabola, share, most):
    """Where half of the bend is expected, each step ends as far beyond the peak as it began
    before it.
    """
    model, looks = parabola(bound=10.0, expected_share=share)
    found = fit_configured(model, np.array([3.0, 2.0]))
    assert found.converged
    assert found.log_likelihood == pytest.approx(SLOPE @ PEAK / 2, abs=5e-3)
    assert len(looks) <= most


@pytest.mark.parametrize("arrived", [1e-3, 0.05])
@pytest.mark.parametrize("share", [0.7, 0.85, 1.0, 1.2, 1.4])
def test_a_fit_ends_where_its_steps_leave_less_than_asked(parabola, share, arrived):
    """How much a step leaves is known by how well its gain was foretold."""
    model, looks = parabola(bound=10.0, expected_share=share)
    found = fit_configured(model, np.array([3.0, 2.0]), arrived=arrived)
    assert found.converged
    assert SLOPE @ PEAK / 2 - found.log_likelihood < arrived
    # start, one step, and the damping's rest: there is no need to see the last one gain nothing
    assert share != 1.0 or len(looks) <= 3


def test_a_fit_whose_steps_raise_nothing_ends(parabola, monkeypatch):
    """The slope promises more than there is: of the bend next to nothing is left to climb."""
    model, looks = parabola(bound=10.0)
    monkeypatch.setattr(fit_module, "gradient_of", lambda *_: np.array([30.0, -30.0]))
    model.log_likelihood = lambda expected, theta: looks.append(theta) or 1e-5 * len(looks)
    found = fit_configured(model, np.zeros(2), rounds=100)
    assert not found.converged
    assert len(looks) <= 1 + 2 * STUCK


@given(frames=st.integers(1, 40_000))
def test_quick_lengths_are_the_largest_without_a_large_prime_factor(frames):
    length = quick_length(frames)
    assert max(prime_factors(length), default=1) <= spectra.LARGEST_FACTOR
    for more in range(length + 1, frames + 1):
        assert max(prime_factors(more)) > spectra.LARGEST_FACTOR
    assert frames - length <= max(2, 0.01 * frames)


def prime_factors(number):
    found, factor = [], 2
    while number > 1:
        if number % factor == 0:
            found.append(factor)
            number //= factor
        else:
            factor += 1
    return found

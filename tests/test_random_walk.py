"""Likelihood of a bead that walks off, against the law of all its positions together."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import linalg
from scipy.fft import dct

from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.experiment.readout import readout
from mtpipe.experiment.state import bead_state
from mtpipe.joint_fit.data import plateau_data, whitening
from mtpipe.joint_fit.expectation import LEAST_HEIGHT_STDERR_NM, Subtraction
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.physics.camera import frame_variance, lag_one_covariance
from mtpipe.physics.walk import walk_variance_s
from tests.small_case import generator, setup

FRAME_S, FRAMES, FORCES_PN, NOISE_NM = 1 / 120, 512, (1.0, 4.0), 2.0
NOTHING = Subtraction((None, None, None), (0.0, 0.0, 0.0))
SIZES = 0.3, 0.6, 1.2, 2.4, 4.8


def walking(nm_per_root_s):
    """An experiment in which z walks off."""
    experiment, _ = experiment_of(setup(), FORCES_PN, FRAMES)
    tracker = replace(experiment.tracker, noise_nm=(NOISE_NM,) * 3)
    walk = (0.0, 0.0, nm_per_root_s)
    return with_stage(replace(experiment, tracker=tracker), unsubtracted_nm_per_root_s=walk)


def law_of(nm_per_root_s):
    """Mean of z in all frames of two plateaus, of which one follows the other, and a root of its
    covariance.
    """
    experiment = walking(0.0)
    lag = np.abs(np.subtract.outer(np.arange(FRAMES), np.arange(FRAMES)))
    frame = np.arange(2 * FRAMES)
    mean = np.empty(2 * FRAMES)
    covariance = nm_per_root_s**2 * FRAME_S * np.minimum.outer(frame, frame)
    covariance += NOISE_NM**2 * np.eye(2 * FRAMES)
    for i, force_pN in enumerate(FORCES_PN):
        parts = readout(experiment, bead_state(experiment, force_pN), FRAMES * FRAME_S)
        here = slice(i * FRAMES, (i + 1) * FRAMES)
        mean[here] = parts.extension_nm
        covariance[here, here] += LEAST_HEIGHT_STDERR_NM**2
        for tau_s, variance in zip(parts.tau_s, parts.covariance_nm2[:, 2, 2], strict=True):
            own = frame_variance(variance, tau_s, experiment.camera)
            one = lag_one_covariance(variance, tau_s, experiment.camera)
            decay = np.exp(-np.maximum(lag - 1, 0) * FRAME_S / tau_s)
            covariance[here, here] += np.where(lag == 0, own, one * decay)
    return mean, np.linalg.cholesky(covariance)


def log_density(z, mean, root):
    pulls = linalg.solve_triangular(root, z - mean, lower=True)
    return -0.5 * np.sum(pulls**2) - np.sum(np.log(np.diag(root)))


@pytest.mark.slow
def test_likelihood_of_a_walk_is_that_of_all_positions():
    """How much likelier the true size of a walk is than half and twice of it; negative control:
    ordinates and heights taken for independent.
    """
    laws = [law_of(size) for size in SIZES]
    wrong = [[], []]
    for seed, true in enumerate([1, 2, 3] * 5):
        random = generator(seed)
        z = laws[true][0] + laws[true][1] @ random.normal(size=2 * FRAMES)
        xyz = np.column_stack([*random.normal(scale=10.0, size=(2, 2 * FRAMES)), z])
        halves = xyz[:FRAMES], xyz[FRAMES:]
        data = tuple(plateau_data(half, FRAME_S, whitening(half, FRAME_S)) for half in halves)
        found = []
        for size, law in zip(SIZES, laws, strict=True):
            model = ConfiguredModel(data, walking(size), (), NOTHING)
            theta = np.log(FORCES_PN)
            here = model.all_expected(theta)
            independent = [
                replace(one, random_power=one.power, walked_nm2=np.zeros(3), line_power=None)
                for one in here
            ]
            found.append(
                [
                    model.log_likelihood(here, theta) - log_density(z, *law),
                    model.log_likelihood(independent, theta) - log_density(z, *law),
                ]
            )
        for each, values in zip(wrong, np.transpose(found), strict=True):
            each += [values[other] - values[true] for other in (true - 1, true + 1)]
    exact, independent = np.sqrt(np.mean(np.square(wrong), axis=1))
    assert exact < 0.25
    assert independent > 0.5


def test_a_walk_is_diagonal_in_cosines_with_its_variance_at_each_frequency():
    """Exact: the covariance min(i, j) Δ of a walk, in the cosine basis."""
    frames, frame_s = 64, 0.02
    at = np.arange(1, frames + 1)
    walk = frame_s * np.minimum.outer(at, at)
    cosines = dct(np.eye(frames), norm="ortho", axis=0)
    found = (cosines @ walk @ cosines.T)[1:, 1:]
    frequency_hz = np.arange(1, frames) / (2 * frames * frame_s)
    assert found == pytest.approx(np.diag(walk_variance_s(frequency_hz, frame_s)), abs=1e-9)

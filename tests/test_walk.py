"""Likelihood of spectra of a bead that walks off, against the law of all positions together."""

from dataclasses import replace

import numpy as np

from mtpipe.configured.data import plateau_data, whitening
from mtpipe.configured.expectation import Subtraction, expectation
from mtpipe.configured.model import spectral_log_likelihood
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.from_setup import experiment_of
from mtpipe.experiment.readout import readout
from mtpipe.experiment.state import bead_state
from mtpipe.physics.camera import frame_variance, lag_one_covariance
from tests.small_case import generator, setup

FRAME_S, FRAMES, FORCE_PN, NOISE_NM = 1 / 120, 1024, 1.0, 2.0
NOTHING = Subtraction((None, None, None), (0.0, 0.0, 0.0))


def walking(nm_per_root_s):
    experiment, _ = experiment_of(setup(), [FORCE_PN], FRAMES)
    tracker = replace(experiment.tracker, noise_nm=(NOISE_NM,) * 3)
    stage = (nm_per_root_s, 0.0, 0.0)
    return with_stage(replace(experiment, tracker=tracker), unsubtracted_nm_per_root_s=stage)


def covariance_of(nm_per_root_s):
    """Of x in all frames: the bead's modes, its walk and noise."""
    experiment = walking(0.0)
    parts = readout(experiment, bead_state(experiment, FORCE_PN), FRAMES * FRAME_S)
    lag = np.abs(np.subtract.outer(np.arange(FRAMES), np.arange(FRAMES)))
    found = nm_per_root_s**2 * FRAME_S * np.minimum.outer(np.arange(FRAMES), np.arange(FRAMES))
    found = found + NOISE_NM**2 * (lag == 0)
    for tau_s, variance in zip(parts.tau_s, parts.covariance_nm2[:, 0, 0], strict=True):
        own = frame_variance(variance, tau_s, experiment.camera)
        one = lag_one_covariance(variance, tau_s, experiment.camera)
        found += np.where(lag == 0, own, one * np.exp(-(lag - 1.0) * FRAME_S / tau_s))
    return found


def log_density(x, covariance):
    """ln density of all differences of successive positions: they do not know the mean."""
    apart = np.diff(np.eye(len(x)), axis=0)
    root = np.linalg.cholesky(apart @ covariance @ apart.T)
    return -0.5 * np.sum(np.linalg.solve(root, apart @ x) ** 2) - np.sum(np.log(np.diag(root)))


def test_likelihood_of_a_walk_is_that_of_all_positions():
    """How much likelier one size of a walk is than another; negative control: ordinates taken for
    independent.
    """
    sizes = 0.0, 4.0, 12.0, 40.0
    law = {size: covariance_of(size) for size in sizes}
    experiments = {size: walking(size) for size in sizes}
    wrong: list[list[float]] = [[], []]
    for seed, size in enumerate(sizes[1:] * 4):
        random = generator(seed)
        x = np.linalg.cholesky(law[size]) @ random.normal(size=FRAMES)
        xyz = np.column_stack([x, *random.normal(scale=10.0, size=(2, FRAMES))])
        data = plateau_data(xyz, FRAME_S, whitening(xyz, FRAME_S))
        found = []
        for one in experiments.values():
            here = expectation(data, NOTHING, one, 0, FORCE_PN)
            independent = replace(here, random_power=here.power, walked_nm2=np.zeros(3))
            found.append([spectral_log_likelihood(data, e) for e in (here, independent)])
        exact = np.array([log_density(x, law[other]) for other in sizes])
        for each, values in zip(wrong, np.transpose(found), strict=True):
            each += (values - exact - (values - exact)[sizes.index(size)]).tolist()
    root_mean_square = np.sqrt(np.mean(np.square(wrong), axis=1))
    assert root_mean_square[0] < 0.3
    assert root_mean_square[1] > 0.6

"""Posteriors: agreement with the likelihood on a grid, coverage, convergence, reproducibility."""

import math

import numpy as np
import pytest

from mtpipe.fit.posterior import sample_posterior
from mtpipe.fit.sampling import split_r_hat
from mtpipe.ground.errors import FitError
from tests.test_fit_trace import FRICTION, fit, simulate, stiffness_at

pytestmark = pytest.mark.slow


def test_posterior_is_that_of_the_grid():
    """Mean and standard deviation of ln k against direct integration of the posterior."""
    x = simulate(0.3, np.random.default_rng(1), frames=1024, noise_nm=4.0)
    result = fit(x, tracking_noise_nm=4.0)
    posterior = sample_posterior(result, seed=3)
    sigma = np.sqrt(np.diag(result.covariance)[:2])
    steps = np.linspace(-6, 6, 81)
    k, g = np.meshgrid(result.theta[0] + steps * sigma[0], result.theta[1] + steps * sigma[1])
    theta = np.column_stack([k.ravel(), g.ravel(), np.full(k.size, 16.0)])
    log_density = result.model.log_posterior(theta)
    weight = np.exp(log_density - log_density.max())
    mean = np.average(theta[:, 0], weights=weight)
    spread = math.sqrt(np.average((theta[:, 0] - mean) ** 2, weights=weight))
    sample = posterior.theta[:, 0]
    error = spread / math.sqrt(posterior.effective_samples)
    assert sample.mean() == pytest.approx(mean, abs=5 * error)
    assert sample.std() == pytest.approx(spread, rel=0.1)
    assert posterior.converged
    assert posterior.r_hat < 1.05


def test_intervals_cover():
    """68 % intervals of both kinds hold the truth in 56 to 80 % of 100 repeats (3 sigma)."""
    random = np.random.default_rng(21)
    truth = stiffness_at(0.5)
    inside = {"fit": 0, "posterior": 0}
    for seed in range(100):
        x = simulate(0.5, random, noise_nm=3.0, frames=2048)
        result = fit(x, tracking_noise_nm="fit", friction=(FRICTION, 0.05 * FRICTION))
        for name, estimate in (
            ("fit", result.stiffness),
            ("posterior", sample_posterior(result, seed=seed).stiffness),
        ):
            inside[name] += estimate.interval[0] < truth < estimate.interval[1]
    # the prior is centred on the truth, so intervals may be a little too wide, never too narrow
    assert 56 <= inside["fit"] <= 84
    assert 56 <= inside["posterior"] <= 84


def test_same_seed_same_chain_other_seed_other_chain():
    result = fit(simulate(0.2, np.random.default_rng(5), frames=1024))
    one, again, other = (sample_posterior(result, seed=s) for s in (1, 1, 2))
    assert np.array_equal(one.theta, again.theta)
    assert not np.array_equal(one.theta, other.theta)


def test_undetermined_stiffness_is_not_passed_off_as_a_number():
    x = np.random.default_rng(4).normal(size=4096) * 3
    posterior = sample_posterior(
        fit(x, tracking_noise_nm="fit", friction=(FRICTION, 0.03 * FRICTION))
    )
    assert posterior.stiffness.status == "not_identified"
    assert math.isnan(posterior.stiffness.value)


@pytest.mark.parametrize(
    "options", [{"tracking_noise_nm": 1e4}, {"friction": (1e-12, 1e-14)}, {"friction": (1.0, 0.01)}]
)
def test_priors_that_contradict_the_data_end_in_a_sentence_or_a_flag(options):
    """The chain once looked for a start for ever where the prior excluded the best fit."""
    result = fit(simulate(0.3, np.random.default_rng(1), frames=1024), **options)
    try:
        posterior = sample_posterior(result)
    except FitError as error:
        assert "contradict" in str(error)  # noqa: PT017
    else:
        assert np.all(np.isfinite(posterior.theta))


def test_r_hat_tells_chains_apart():
    random = np.random.default_rng(0)
    together = random.normal(size=(400, 8, 1))
    apart = together + np.arange(8)[None, :, None]
    assert split_r_hat(together)[0] < 1.02
    assert split_r_hat(apart)[0] > 1.5

"""emcee from weighed points: right for a good proposal, and for one that is far off."""

import numpy as np
import pytest

from mtpipe.fit.sampling import Student, sample
from mtpipe.ground.errors import FitError

CENTRE, ROOT = np.array([1.0, -2.0]), np.array([[1.0, 0.0], [0.8, 0.6]])


def log_gaussian(points):
    scaled = np.linalg.solve(ROOT, (points - CENTRE).T)
    return -0.5 * np.sum(scaled**2, axis=0)


@pytest.mark.parametrize(
    ("offset", "width"), [(0.0, 1.0), (2.5, 0.6)], ids=["about it", "off and narrow"]
)
def test_a_gaussian_is_sampled(offset, width):
    """Means and standard deviations of 800 independent samples, to 5 of their errors."""
    proposal = Student.about(CENTRE + offset, width**2 * ROOT @ ROOT.T, 1.0)
    chain = sample(log_gaussian, proposal, CENTRE, np.random.default_rng(3))
    assert chain.converged
    assert chain.effective_samples >= 800
    error = 1 / np.sqrt(chain.effective_samples)
    sigma = np.sqrt(np.diag(ROOT @ ROOT.T))
    assert np.all(np.abs(chain.theta.mean(axis=0) - CENTRE) < 5 * error * sigma)
    assert chain.theta.std(axis=0) == pytest.approx(sigma, rel=5 * error)


def test_where_nothing_is_allowed_that_is_said():
    proposal = Student.about(CENTRE, ROOT @ ROOT.T, 1.0)
    with pytest.raises(FitError, match="exclude"):
        sample(
            lambda points: np.full(len(points), -np.inf),
            proposal,
            CENTRE,
            np.random.default_rng(0),
        )

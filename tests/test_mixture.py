"""The error of a number of which several models are possible."""

import numpy as np
import pytest

from mtpipe.diagnosis.mixture import WITHIN_ONE, Mixture


def test_one_model_alone_has_its_standard_errors():
    stderr = np.array([0.1, 3.0, np.nan])
    np.testing.assert_allclose(Mixture.of_one(stderr).half_width(), stderr, rtol=1e-10)


def test_another_of_the_same_values_changes_nothing():
    stderr = np.array([0.1, 3.0])
    same = Mixture.of_one(stderr).or_else([(2.0, np.zeros(2), stderr)])
    np.testing.assert_allclose(same.half_width(), stderr, rtol=1e-10)


@pytest.mark.parametrize("nats", [-60.0, 60.0])
def test_one_that_is_certain_decides(nats):
    stderr, far = np.array([0.1]), np.array([7.0])
    width = Mixture.of_one(stderr).or_else([(nats, far, stderr)]).half_width()
    # of one far off 68 % lie within 7 and what half a normal distribution needs to reach it
    np.testing.assert_allclose(width, 0.1 if nats < 0 else 7.0 + 0.1 * 0.4752, rtol=1e-3)


def test_an_error_that_is_not_known_is_the_taken_ones():
    stderr, there = np.array([0.1, 0.2]), np.array([0.3, 0.5])
    known = Mixture.of_one(stderr).or_else([(0.0, there, stderr)]).half_width()
    unknown = Mixture.of_one(stderr).or_else([(0.0, there, np.array([np.nan, 0.2]))])
    np.testing.assert_allclose(unknown.half_width(), known)


def test_it_holds_what_one_standard_error_does():
    """Of two choices, drawn: 200 000 draws, six standard errors."""
    random = np.random.default_rng(0)
    mixture = Mixture.of_one(np.array([1.0]))
    mixture = mixture.or_else([(0.5, np.array([4.0]), np.array([2.0]))])
    mixture = mixture.or_else([(-1.0, np.array([-3.0]), np.array([0.5]))])
    first = random.random(200_000) < np.exp(0.5) / (1 + np.exp(0.5))
    second = random.random(200_000) < np.exp(-1) / (1 + np.exp(-1))
    spread = np.where(first, 2.0, 1.0) * np.where(second, 0.5, 1.0)
    drawn = 4.0 * first - 3.0 * second + spread * random.standard_normal(200_000)
    within = np.mean(np.abs(drawn) < mixture.half_width()[0])
    assert abs(within - WITHIN_ONE) < 6 * np.sqrt(0.22 / 200_000)

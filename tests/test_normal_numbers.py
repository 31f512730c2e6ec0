"""Standard normal numbers are numpy's, and as many are taken from the generator."""

import numpy as np
import pytest

from mtpipe.physics.normal_numbers import standard_normal


@pytest.mark.parametrize("shape", [0, 7, 5000, (3, 1000), (400, 3)])
def test_numbers_are_those_of_numpy(shape):
    ours, numpys = np.random.default_rng(4), np.random.default_rng(4)
    for _ in range(2):
        np.testing.assert_array_equal(standard_normal(ours, shape), numpys.standard_normal(shape))
    assert ours.bit_generator.state == numpys.bit_generator.state

"""Sizes in words."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mtpipe.diagnosis.sentence import consequence
from mtpipe.diagnosis.size_words import compared, factor, percent


@pytest.mark.parametrize(
    ("value", "stderr", "said"),
    [
        (1.091, 0.012, "9 ± 1 % higher"),
        (1.091, 0.004, "9.1 ± 0.4 % higher"),
        (0.97, 0.006, "3.0 ± 0.6 % lower"),
        (3.21, 0.02, "3.21 ± 0.06 times as high"),
        (0.31, 0.1, "0.31 ± 0.03 times as high"),
        (101, 0.1, "more than 100 times as high"),
        (1 / 101, 0.1, "less than 0.01 times as high"),
    ],
)
def test_a_factor_is_told_in_percent_or_as_it_is(value, stderr, said):
    assert compared(math.log(value), stderr, "higher", "lower") == said


def test_errors_are_those_of_the_factor_and_not_of_its_logarithm():
    assert percent(math.log(1.5), 0.1) == "50 ± 15 %"
    assert factor(math.log(5.0), 0.1) == "5.0 ± 0.5"


@pytest.mark.parametrize(
    ("percents", "errors", "said"),
    [
        ([-0.4, 0.9], [0.1, 0.2], "changed no force by more than 1 %"),
        # the median went the other way: that is not told as if all forces had moved
        ([1.2, -0.7, -0.7], [0.8, 0.8, 0.8], "raised 1 of 3 forces by 1.2 ± 0.8 %"),
        ([1.2, -0.7, -0.7], [1.3, 0.8, 0.8], "changed no force by more than its error"),
        ([-2.9, -2.0, -1.5], [0.6, 0.5, 0.5],
         "lowered forces by up to 2.9 ± 0.6 % (median 2.0 %)"),
        ([-2.9, -2.0, 0.2], [0.6, 0.5, 0.5], "lowered 2 of 3 forces by up to 2.9 ± 0.6 %"),
        ([5.0, -3.0], [1.0, 1.0],
         "raised 1 of 2 forces by 5 ± 1 % and lowered 1 of 2 forces by 3 ± 1 %"),
        ([220.0, 210.0], [2.0, 2.0], "made forces up to 3.20 ± 0.06 times as high"),
        ([8.0], [2.0], "raised forces by 8 ± 2 %"),
    ],
)  # fmt: skip
def test_only_changes_beyond_a_percent_and_their_error_moved_a_force(percents, errors, said):
    ln = np.log1p(np.array(percents) / 100)
    assert consequence(ln, np.array(errors) / 100) == said

"""Sizes in words."""

from __future__ import annotations

import math

import pytest

from mtpipe.diagnosis.words import compared, factor, percent


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

"""Numbers and codes in words."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from mtpipe.crosschecking.battery import spectral
from mtpipe.crosschecking.battery.catalogue import KINDS
from mtpipe.diagnosis.explanation import ALARM_P
from mtpipe.report import crosscheck_words, words


@pytest.mark.parametrize(
    ("value", "stderr", "shown"),
    [
        (1.23456, 0.0123, "1.235 ± 0.012"),
        (1.23456, 0.0456, "1.23 ± 0.05"),
        (1.23456, 0.0396, "1.23 ± 0.04"),
        (2703.4, 5.4, "2703 ± 5"),
        (2703.4, 154.0, "2700 ± 150"),
        (-3.2, 0.5, "−3.2 ± 0.5"),
        (0.001, 4.0, "0 ± 4"),
        (2.634e-5, 3.1e-7, "(2.634 ± 0.031) × 10⁻⁵"),
        (-0.004, 0.5, "0.0 ± 0.5"),
        (4.56789, 0.0, "4.568"),
        (4.56789, math.nan, "4.568"),
        (math.nan, 1.0, "—"),
        (None, None, "—"),
    ],
)
def test_value_with_error(value: float, stderr: float, shown: str) -> None:
    assert words.with_error(value, stderr) == shown


@pytest.mark.parametrize(
    ("low", "high", "shown"),
    [
        (0.9, 1.1, "1.00 ± 0.10"),
        (0.0, 1.4, "0.2 +1.2 −0.2"),
        (1.0, 1.1, "1.00 +0.10 −0.00"),
        (math.nan, math.nan, "1.00 ± 0.10"),
    ],
)
def test_lopsided_interval_shows_both_arms(low: float, high: float, shown: str) -> None:
    value = 0.2 if high == 1.4 else 1.0
    assert words.with_arms(value, 0.1, low, high) == shown


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (0, "0"),
        (8.0, "8"),
        (0.5, "0.5"),
        (1234.5, "1234"),
        (9.996, "10"),
        (-0.0123, "−0.0123"),
        (3.2e-6, "3.20 × 10⁻⁶"),
        (math.inf, "—"),
    ],
)
def test_number(value: float, shown: str) -> None:
    assert words.number(value) == shown


@pytest.mark.parametrize(
    ("value", "shown"), [(1.26, "+1.3"), (-2.0, "−2.0"), (-0.01, "+0.0"), (0.0, "+0.0")]
)
def test_signed(value: float, shown: str) -> None:
    assert words.signed(value, 1) == shown


def test_counts() -> None:
    assert [words.count(n, "bead") for n in (0, 1, 2)] == ["0 beads", "1 bead", "2 beads"]
    assert [words.count(n, "spectrum", "spectra") for n in (1, 3)] == ["1 spectrum", "3 spectra"]


def test_listed() -> None:
    assert [words.listed(list("abc"[:n])) for n in range(4)] == ["", "a", "a and b", "a, b and c"]


def test_names_sort_by_the_numbers_in_them() -> None:
    assert sorted(["b10", "b9", "a", "B2"], key=words.natural) == ["a", "B2", "b9", "b10"]


def test_flags_of_an_empty_cell() -> None:
    assert words.flags(None) == words.flags("") == []
    assert words.flags("a; b") == ["a", "b"]


def compared_row(**changes: object) -> dict[str, object]:
    row: dict[str, object] = {"statistic": "psd_band", "axis": "x", "plateau": 3}
    row |= {"band_low_hz": 0.3, "band_high_hz": 4.0, "time_low_s": None, "time_high_s": None}
    row |= {"value": 5.1, "simulated_median": 0.1, "simulated_low": -1.9, "simulated_high": 2.1}
    return row | {"p_value": 2e-5, "extrapolated": True} | changes


def test_comparisons_of_the_cross_check_are_sentences() -> None:
    assert crosscheck_words.comparison(compared_row()) == (
        "x, plateau 3, 0.3 – 4 Hz: power is above the simulated one, 5.1 instead of −1.9 to 2.1 "
        "(p = 2.0 × 10⁻⁵, extrapolated)."
    )
    line = compared_row(statistic="line", plateau=None, band_low_hz=29.7, band_high_hz=29.9)
    assert crosscheck_words.comparison(line).startswith(
        "x, all plateaus together, 29.8 Hz: the strongest"
    )
    step = compared_row(statistic="mean_step", band_low_hz=None, band_high_hz=None, time_low_s=20.0,
                    time_high_s=60.0, value=-3.0, extrapolated=False)  # fmt: skip
    assert "plateau 3, 20 – 60 s: largest step of the mean is below" in crosscheck_words.comparison(
        step
    )


def test_every_statistic_of_the_battery_has_its_words() -> None:
    named = set(KINDS)
    source = Path(spectral.__file__).parent
    said = {"line", "second_line", "stiffness_along_series", "friction_along_series"}
    for file in source.glob("*.py"):
        said |= set(re.findall(r'Statistic\("(\w+)"', file.read_text(encoding="utf-8")))
    assert len(said) > 10
    assert said <= named


def test_the_p_value_of_all_comparisons_is_a_sentence() -> None:
    assert crosscheck_words.verdict(0.43, 700, 48) == (
        "Recording and simulations agree: p = 0.43 "
        "(700 comparisons with 48 simulations, counted together)."
    )
    assert "one in 42 recordings" in crosscheck_words.verdict(0.024, 700, 120)
    assert "No clear mismatch" in crosscheck_words.verdict(ALARM_P, 700, 120)
    assert "simulations differ" in crosscheck_words.verdict(0.99 * ALARM_P, 700, 120)
    assert "no simulation differs as much" in crosscheck_words.verdict(1e-9, 700, 48)
    assert "p < 10⁻¹²" in crosscheck_words.verdict(1e-90, 700, 48)


def test_changes_of_a_force_are_said_in_percent_or_as_a_factor() -> None:
    shown = [words.change(ratio) for ratio in (1.02, 0.87, 1.0, 21.2, 0.3)]
    assert shown == [
        "2.0 % more",
        "13 % less",
        "0.0 % more",
        "21 times as large",
        "0.3 times as large",
    ]


def test_plateaus_are_listed_shortly() -> None:
    assert words.plateaus([3]) == "plateau 3"
    assert words.plateaus([2, 3, 4, 5]) == "plateaus 2 to 5"
    assert words.plateaus([4, 0, 1]) == "plateaus 0, 1 and 4"
    assert words.plateaus([9, 0, 1, 2, 4, 8]) == "plateaus 0 to 2, 4, 8 and 9"


def test_sentences_begin_with_a_capital_unless_with_a_symbol() -> None:
    assert words.sentence("its length is 3 nm") == "Its length is 3 nm."
    assert words.sentence("z was not recorded.") == "z was not recorded."


def test_a_number_stays_with_its_unit_and_error() -> None:
    assert words.unbroken("by 3 % to 1.2 ± 0.1 pN") == "by 3\u00a0% to 1.2\u00a0±\u00a00.1\u00a0pN"

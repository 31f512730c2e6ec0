"""The battery's statistics and how p-values are made of them, on made-up data of known law.

Seeds are fixed. Where a bound is statistical, the chance that it fails for a right programme is
stated beside it.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy import signal, stats

from mtpipe.crosschecking.battery import shape, spectral, temporal
from mtpipe.crosschecking.battery.observed import Fixed, Observed, bridged
from mtpipe.crosschecking.nulls import Nulls, rounds_correlation, second_round_p_value, together
from mtpipe.joint_fit.data import plateau_data, whitening
from mtpipe.joint_fit.expectation import Expectation
from tests.small_case import generator

pytestmark = pytest.mark.slow

FRAME_S = 0.01
# What most statistics do without.
FIXED = Fixed(np.empty(0), np.empty((0, 2)), (0.0, 0.0, 0.0), (), np.ones(1))


@dataclass
class White:
    """White noise of unit variance on all axes, as an `Observed`, changed as wished."""

    frames: int = 2048

    def seen(self, random, change=lambda x: x, reference=None):
        x = change(random.normal(size=(self.frames, 3)))
        data = plateau_data(x, FRAME_S, (0.0, 0.0, 0.0))
        level = 2 * FRAME_S * np.eye(3)
        expected = Expectation(np.tile(level, (len(data.spectrum.frequency_hz), 1, 1)), 0.0, 0.1)
        return Observed(x, reference, np.zeros((len(x), 2)), data, expected, FRAME_S)


def values(found, statistic, axis="x", pooled=False):
    return {
        look: value
        for look, value in found
        if (look.kind, look.axis, look.pooled) == (statistic, axis, pooled)
    }


def over_seeds(function, repeats=60, change=lambda x: x):
    """(repeats, looks) values of a statistic on white noise."""
    found = [function([White().seen(generator(9, i), change)], FIXED) for i in range(repeats)]
    return np.array([[value for _, value in one] for one in found])


def of_bands(edges_hz):
    return replace(FIXED, band_edges_hz=edges_hz)


def of_periods(one):
    return replace(FIXED, longest_period_nm=shape.smooth_periods_nm([one]))


def test_bands_are_standard_normal_where_the_model_is_right():
    edges = np.geomspace(0.04, 51, 7)
    scores = over_seeds(lambda seen, _: spectral.bands(seen, of_bands(edges)))
    # 60 × 18 nearly independent scores: mean within 5 standard errors of 0, failing once in 1e6
    assert abs(scores.mean()) < 5 / np.sqrt(scores.size)
    assert scores.std() == pytest.approx(1, abs=0.15)
    assert abs(stats.skew(scores.ravel())) < 0.4


def test_band_with_more_power_stands_out_where_it_is():
    wave = 0.15 * np.sin(2 * np.pi * 12.0 * FRAME_S * np.arange(2048))
    one = White().seen(generator(1), lambda x: x + np.outer(2 * wave, [0, 1, 0]))
    edges = np.array([0.04, 1.0, 8.0, 16.0, 51.0])
    found = values(spectral.bands([one], of_bands(edges)), "psd_band", "y")
    assert max(found, key=found.get).band_hz == (8.0, 16.0)


def test_a_band_whose_expectation_makes_no_sense_is_a_look_without_a_value():
    """Simulations have it, so that the recording must have it too."""
    edges, right = np.array([0.04, 1.0, 8.0, 51.0]), White().seen(generator(1))
    power = right.expected.power.copy()
    power[right.data.spectrum.frequency_hz < 1.0, 1, 1] = np.nan
    wrong = replace(right, expected=replace(right.expected, random_power=power))
    fixed = of_bands(edges)
    found, there = spectral.bands([wrong, right], fixed), spectral.bands([right, right], fixed)
    assert [look for look, _ in found] == [look for look, _ in there]
    assert [look for look, value in found if np.isnan(value)] == [
        look for look, _ in there if look.axis == "y" and look.band_hz == (0.04, 1.0)
        and look.plateaus != (1,)
    ]  # fmt: skip


def test_line_is_found_at_its_frequency_and_scored_like_a_normal_variate():
    scores = over_seeds(spectral.lines)
    # maxima of tapered, hence correlated, ordinates are a little smaller than of independent ones
    assert -0.8 < scores.mean() < 0.3
    assert scores.std() == pytest.approx(1, abs=0.2)
    wave = 0.5 * np.sin(2 * np.pi * 12.0 * FRAME_S * np.arange(2048))
    one = White().seen(generator(1), lambda x: x + np.outer(wave, [0, 0, 1]))
    ((look, value),) = values(spectral.lines([one], FIXED), "line", "z").items()
    assert look.band_hz[0] < 12.0 < look.band_hz[1]
    assert value > 8


def test_a_line_that_wanders_is_not_two():
    """Its phase runs to and fro by a turn: the line is several steps of the spectrum wide."""
    phase = 2 * np.pi * 30.0 * FRAME_S * np.arange(2048) + 3 * np.sin(np.linspace(0, 9, 2048))
    one = White().seen(generator(4), lambda x: x + np.outer(np.sin(phase), [1, 0, 0]))
    found = spectral.lines([one], FIXED)
    ((_, first),) = values(found, "line").items()
    ((look, second),) = values(found, "second_line").items()
    assert first > 7
    assert second < 4
    assert abs(np.mean(look.band_hz) - 30.0) > 0.6


def test_score_of_the_largest_is_finite_for_any_line():
    huge = spectral._score_of_largest(1e6, 1000)
    assert np.isfinite(huge)
    assert huge > spectral._score_of_largest(35.0, 1000) > spectral._score_of_largest(25.0, 1000)


def test_correlation_of_axes_has_its_sign():
    mix = np.array([[1.0, 0.0, 0.0], [-0.3, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = spectral.between_axes([White().seen(generator(2), lambda x: x @ mix.T)], FIXED)
    assert values(found, "correlation", "xy").popitem()[1] < -6
    # a standard normal variate beyond 5: once in 2 million
    assert abs(values(found, "correlation", "xz").popitem()[1]) < 5


def test_motion_in_common_with_the_reference_is_seen_above_the_cutoff_only():
    random = generator(3)
    shared = random.normal(size=(2048, 3))
    one = White().seen(random, lambda x: x + 0.3 * shared, reference=shared)
    fixed = replace(FIXED, above_hz=(1.0, 1.0, np.inf))
    found = spectral.with_reference([one], fixed)
    assert values(found, "reference_coherence", "x").popitem()[1] > 5
    assert not values(found, "reference_coherence", "z")


@pytest.mark.parametrize(
    ("statistic", "change"),
    [
        ("mean_trend", lambda x: x + np.linspace(-0.3, 0.3, len(x))[:, None]),
        ("mean_step", lambda x: x + 0.4 * (np.arange(len(x)) > 1500)[:, None]),
        ("mean_excursion", lambda x: x + 0.7 * (abs(np.arange(len(x)) - 1000) < 60)[:, None]),
        ("variance_trend", lambda x: x * np.linspace(0.7, 1.3, len(x))[:, None]),
        ("variance_step", lambda x: x * (1 + 0.4 * (np.arange(len(x)) > 1500))[:, None]),
        ("variance_spread", lambda x: x * (1 + 0.4 * np.sin(np.arange(len(x)) / 90))[:, None]),
    ],
)
def test_looks_along_time_notice_what_they_are_for(statistic, change):
    null = np.array([
        values(temporal.over_time([White().seen(generator(4, i))], FIXED), statistic).popitem()[1]
        for i in range(30)
    ])  # fmt: skip
    found = temporal.over_time([White().seen(generator(5), change)], FIXED)
    look, value = values(found, statistic).popitem()
    assert abs(value - null.mean()) > 5 * null.std()
    if statistic == "variance_step":
        assert look.time_s[0] == pytest.approx(15.0, abs=1.5)


def test_quietest_second_is_where_the_bead_stuck():
    def stuck(x):
        x[900:1020] *= 0.05
        return x

    found = temporal.over_time([White().seen(generator(6), stuck)], FIXED)
    look, value = values(found, "quietest_second").popitem()
    assert value < -3
    assert 8.9 <= look.time_s[0] <= look.time_s[1] <= 10.3


def test_irreversible_motion_is_told_from_reversible():
    def sawtooth(x):
        # slow rise, sudden fall
        return x + 6 * (np.arange(len(x)) % 40 / 40)[:, None]

    null = over_seeds(temporal.irreversibility, 30)
    found = values(temporal.irreversibility([White().seen(generator(7), sawtooth)], FIXED),
                   "irreversibility").popitem()[1]  # fmt: skip
    assert abs(found) > 5 * null.std()


def test_direction_of_time_has_a_value_where_a_long_stretch_is_lost():
    """What bridges the gap lies far from the mean of what is there."""

    def lost(x):
        places = np.full(len(x), -20.0)
        places[614:-614] = 0.0
        x = x + places[:, None]
        x[634:-634] = np.nan
        return x

    (one,) = [White().seen(generator(7), lost)]
    values = [value for _, value in temporal.irreversibility([one], FIXED)]
    assert np.isfinite(values).all()
    backward = replace(one, position_nm=one.position_nm[::-1])
    turned = [value for _, value in temporal.irreversibility([backward], FIXED)]
    assert turned == pytest.approx([-value for value in values])


def test_shape_does_not_depend_on_scale_or_origin():
    plain = White().seen(generator(8))
    moved = White().seen(generator(8), lambda x: 50 + 7 * x)
    for one, other in zip(
        shape.moments([plain], FIXED), shape.moments([moved], FIXED), strict=True
    ):
        assert one[1] == pytest.approx(other[1])
    kurtosis = over_seeds(shape.moments)[:, 3:]
    assert kurtosis.mean() == pytest.approx(3.0, abs=5 * kurtosis.std() / np.sqrt(kurtosis.size))


@pytest.mark.parametrize("relaxation_frames", [5, 20])
def test_moments_of_slow_beads_have_normal_tails_on_their_scales(relaxation_frames):
    """10 000 slow traces: beyond 3.5 spreads there should be 4.7; of plain kurtosis there are 50.

    As many as 20 would come by chance once in a million.
    """
    decay = np.exp(-1 / relaxation_frames)
    kicks = generator(12).normal(size=(10_000, 1200 + 10 * relaxation_frames))
    x = signal.lfilter([1.0], [1.0, -decay], kicks, axis=1)[:, 10 * relaxation_frames :]
    x = (x - x.mean(axis=1, keepdims=True)) / x.std(axis=1, keepdims=True)
    third, fourth = (x**3).mean(axis=1), (x**4).mean(axis=1)
    plain = (fourth - fourth.mean()) / fourth.std()
    assert np.sum(np.abs(plain) > 3.5) > 40
    for values_, scale in (
        (third, shape.nearly_normal_skewness),
        (fourth, shape.nearly_normal_kurtosis),
    ):
        scaled = np.array([scale(float(value)) for value in values_])
        scaled = (scaled - scaled.mean()) / scaled.std()
        assert np.sum(np.abs(scaled) > 3.5) < 20


def test_moments_of_normal_positions_are_unchanged_by_their_scales():
    assert shape.nearly_normal_skewness(0.0) == 0.0
    assert shape.nearly_normal_kurtosis(3.0) == pytest.approx(3.0)
    step = 1e-5
    slope = shape.nearly_normal_kurtosis(3 + step) - shape.nearly_normal_kurtosis(3 - step)
    assert slope == pytest.approx(2 * step)
    assert shape.nearly_normal_skewness(step) == pytest.approx(step)


def test_allan_variance_of_white_noise_falls_with_the_number_averaged():
    found = values(shape.allan([White(8192).seen(generator(10))], FIXED), "allan_variance")
    logs = list(found.values())
    # ln of a variance of 32 blocks has a spread of 0.25; five of them
    assert np.diff(logs)[:3] == pytest.approx(-np.log(4), abs=0.5)


def test_pixels_show_in_positions_that_cover_several():
    def locked(x):
        x = 80 * x
        return x + 5 * np.sin(2 * np.pi * x / 100)

    def strongest(seed, change, frames=2048):
        one = White(frames).seen(generator(11, seed), change)
        found = shape.fractional_pixel([one], of_periods(one))
        return values(found, "fractional_pixel").popitem()[1]

    plain = [strongest(i, lambda x: 80 * x) for i in range(20)]
    assert strongest(20, locked, 8192) > np.max(plain)
    # too small a motion tells nothing
    one = White().seen(generator(12))
    assert not shape.fractional_pixel([one], of_periods(one))


def test_frames_lost_far_from_the_middle_are_noticed():
    def far_lost(x):
        x[1:][np.abs(x[:-1, 0]) > 1.8] = np.nan
        return x

    def randomly_lost(x):
        x[::15] = np.nan
        return x

    found = values(shape.lost_frames([White().seen(generator(13), far_lost)], FIXED), "lost_frames")
    assert found.popitem()[1] > 1
    found = values(
        shape.lost_frames([White().seen(generator(13), randomly_lost)], FIXED), "lost_frames"
    )
    # 137 squares: spread 0.12 of their mean
    assert abs(found.popitem()[1]) < 0.6
    assert not shape.lost_frames([White().seen(generator(13))], FIXED)


def test_bridged_series_have_no_mean_and_no_gap():
    x = generator(14).normal(size=(200, 3)) + 5
    x[10:20] = np.nan
    found = bridged(x)
    assert found.shape == (3, 200)
    assert np.isfinite(found).all()
    assert np.abs(found[:, [*range(10), *range(20, 200)]].mean(axis=1)) == pytest.approx(0)


def test_whitening_follows_the_correlation_of_frames():
    random = generator(15)
    slow = np.cumsum(random.normal(size=3000))
    slow -= np.linspace(slow[0], slow[-1], 3000)
    fast = random.normal(size=3000)
    phi = whitening(np.column_stack([slow, fast, np.abs(fast)]), FRAME_S)
    assert phi[0] > 0.9
    assert phi[1] == 0.0


SKEWED = {
    "normal": lambda random, shape: random.normal(size=shape),
    "gamma": lambda random, shape: random.gamma(6.0, size=shape),
    "mirrored gamma": lambda random, shape: -random.gamma(6.0, size=shape),
    "log of chi2": lambda random, shape: np.log(random.chisquare(20, size=shape)),
    "kurtosis-like": lambda random, shape: random.normal(size=shape) * random.gamma(20, size=shape),
}


@pytest.mark.parametrize("law", SKEWED)
@pytest.mark.parametrize("simulations", [48, 120])
def test_p_values_are_uniform_far_into_the_tail(law, simulations):
    draw, upper = SKEWED[law], np.zeros(200, dtype=bool)
    random = generator(16, simulations)
    found = []
    for _ in range(30):
        nulls = Nulls(draw(random, (simulations, 200)), upper, np.arange(200))
        found.append(nulls.p_values(draw(random, 200)))
    p = np.concatenate(found)
    # of 6000: at 1 % a standard error of 0.13 %, at 0.1 % of 0.04 %; the law itself is approximate
    assert 0.004 < np.mean(p < 0.01) < 0.018
    assert np.mean(p < 0.001) < 0.005
    assert np.mean(p < 0.5) == pytest.approx(0.5, abs=0.04)


def test_looks_at_the_same_statistic_learn_their_tail_from_one_another():
    """The smallest of hundreds of p-values hangs on it. The largest of 16 normal variates, looked
    at 24 times: 57 600 values, standard errors 0.13 · 10⁻³ at 10⁻³ and 0.04 · 10⁻³ at 10⁻⁴.
    """
    upper = np.ones(24, dtype=bool)

    def largest(random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return random.normal(size=(*shape, 16)).max(axis=-1)

    alone, shared = [], []
    for i in range(2400):
        random = generator(22, i)
        simulated, observed = largest(random, (48, 24)), largest(random, (24,))
        alone.append(Nulls(simulated, upper, np.arange(24)).p_values(observed))
        shared.append(Nulls(simulated, upper, np.zeros(24, dtype=int)).p_values(observed))
    assert np.mean(np.array(shared) < 1e-3) == pytest.approx(1e-3, abs=0.6e-3)
    assert np.mean(np.array(shared) < 1e-4) < 4e-4
    assert np.mean(np.array(alone) < 1e-4) > 1.5 * np.mean(np.array(shared) < 1e-4)


def test_long_tails_on_both_sides_make_no_p_values_of_nothing():
    """Means of six cubes of normal variates, whose kurtosis is far from normal: of 30 000 at 0.1 %,
    a standard error of 0.02 %; by skewness alone 1 % were below.
    """
    upper, found = np.zeros(60, dtype=bool), []
    for i in range(500):
        random = generator(24, i)
        simulated, observed = (
            np.mean(random.normal(size=(*shape, 6)) ** 3, axis=-1) for shape in ((120, 60), (60,))
        )
        found.append(Nulls(simulated, upper, np.zeros(60, dtype=int)).p_values(observed))
    assert np.mean(np.array(found) < 0.001) < 0.003
    assert 0.005 < np.mean(np.array(found) < 0.01) < 0.02


def test_a_look_without_values_takes_nothing_from_the_others():
    values = generator(23).normal(size=(48, 3))
    same = np.zeros(3, dtype=int)
    observed = np.array([0.5, 1.0, 2.0])
    p = Nulls(values, np.zeros(3, dtype=bool), same).p_values(observed)
    values[7, 0] = np.nan
    without = Nulls(values, np.zeros(3, dtype=bool), same).p_values(observed)
    assert np.isnan(without[0])
    assert without[1:] == pytest.approx(p[1:], rel=0.2)


def test_own_p_values_are_those_judged_by_all_the_others():
    values = generator(17).gamma(4.0, size=(30, 5))
    upper = np.array([True, False, True, False, False])
    statistic = np.array([0, 1, 0, 1, 1])
    own = Nulls(values, upper, statistic).own_p_values()
    for i in (0, 11, 29):
        others = Nulls(np.delete(values, i, axis=0), upper, statistic)
        assert own[i] == pytest.approx(others.p_values(values[i]), rel=1e-6)


def test_no_value_on_the_short_side_is_odder_than_a_normal_one():
    """The fitted law ends there, and a value beyond its end once had a p-value of zero."""
    values = generator(18).gamma(1.5, size=(100, 1))
    spread, mean = values.std(ddof=1), values.mean()
    p = Nulls(values, np.array([False]), np.array([0])).p_values(np.array([mean - 3 * spread]))
    assert p[0] > 0.002


def test_upper_statistics_are_odd_only_where_large():
    nulls = Nulls(generator(19).normal(size=(100, 2)), np.array([True, False]), np.arange(2))
    low = nulls.p_values(np.array([-5.0, -5.0]))
    assert low[0] > 0.99
    assert low[1] < 1e-4


def test_all_looks_together_are_uniform():
    """Correlated looks, in two families: the number of looks is accounted for."""
    found = []
    for i in range(150):
        random = generator(20, i)
        common = random.normal(size=(61, 10))
        values = np.repeat(common, 20, axis=1) + 0.7 * random.normal(size=(61, 200))
        family = np.arange(200) < 20
        nulls = Nulls(values[1:], np.zeros(200, dtype=bool), np.arange(200))
        p = nulls.p_values(values[0])
        found.append(together(p, nulls.own_p_values(), [family, ~family]).p_value)
    # Kolmogorov–Smirnov p below 0.001: one time in a thousand
    assert stats.kstest(found, "uniform").pvalue > 1e-3
    assert np.mean(np.array(found) < 0.05) < 0.13


def test_second_looks_at_those_that_are_open_give_uniform_p_values():
    """40 000 pairs of correlated scores: its empirical law is within 0.014 but for 1 in 10⁶."""
    for alike in (0.3, 0.75, 0.95):
        random = np.random.default_rng(8)
        first = random.normal(size=40_000)
        second = alike * first + np.sqrt(1 - alike**2) * random.normal(size=len(first))
        p_values = stats.norm.cdf([first, second])
        assert rounds_correlation(*p_values) == pytest.approx(alike, abs=0.02)
        again = p_values[0] < 0.2
        final = p_values[0].copy()
        grid = np.linspace(0, 1, 2001)
        law = [second_round_p_value(p, 0.2, alike) for p in grid]
        final[again] = np.interp(p_values[1, again], grid, law)
        assert stats.kstest(final, "uniform").statistic < 0.014
    assert second_round_p_value(1e-30, 0.2, 0.75) == pytest.approx(1e-30)
    assert second_round_p_value(1.0, 0.2, 0.75) == pytest.approx(0.2, rel=1e-3)


def test_a_p_value_beyond_the_simulations_says_so():
    random = generator(21)
    values = random.normal(size=(60, 30))
    nulls = Nulls(values, np.zeros(30, dtype=bool), np.arange(30))
    everywhere = [np.ones(30, dtype=bool), np.zeros(30, dtype=bool)]
    odd = together(nulls.p_values(np.full(30, 8.0)), nulls.own_p_values(), everywhere)
    calm = together(nulls.p_values(random.normal(size=30)), nulls.own_p_values(), everywhere)
    assert odd.extrapolated
    assert odd.p_value < 1e-4
    assert not calm.extrapolated
    assert 1 <= calm.numbers[0] <= 40

"""Effects seen in the traces: found at moderate strength, taken off, and not found elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.check import BeadCheck, check_bead
from mtpipe.crosschecking.nulls import Together
from mtpipe.diagnosis import time_corrections as corrected_module
from mtpipe.diagnosis.corrections import (
    height_curve,
    pixel_locking,
    softness,
    surface_sticking,
    z_response,
)
from mtpipe.diagnosis.corrections.catalogue import CORRECTIONS
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.corrections.surface_sticking import bound_stretches
from mtpipe.diagnosis.explain import explain
from mtpipe.diagnosis.sentence import sentence
from mtpipe.physics.camera import Camera
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from tests import small_case
from tests.curved_table import sloping, stepped, with_table

pytestmark = pytest.mark.slow

RATE_HZ, PERIOD_NM = 120.0, 100.0
# First frame, within its plateau, and length of the episodes of each plateau.
EPISODES = {0: ((300, 120), (900, 45), (1500, 200)), 1: ((700, 90), (1400, 12))}
STIFFER = 16.0


def unchecked(recording):
    """A cross-check without any look; corrections only read its case."""
    nothing = np.empty(0)
    found = small_case.case(recording)
    return BeadCheck(found, (), nothing, nothing[None], nothing, Together(0.0, (), False, nothing))


def checked(recording):
    return check_bead(small_case.case(recording), small_case.generator(2), rounds=(48,))


def p_value(case):
    return check_bead(case, small_case.generator(2), rounds=(48,)).p_value


def moved(raw: Recording, nm) -> Recording:
    return replace(raw, positions_nm=raw.positions_nm | {"b1": raw.positions_nm["b1"] + nm})


def stuck(raw: Recording, random, spring: float | None = None) -> Recording:
    """The bead is held where it was, or by a stiffer spring about that point."""
    xyz = raw.positions_nm["b1"].copy()
    for number, episodes in EPISODES.items():
        plateau = raw.plateaus[number]
        own = xyz[plateau.start : plateau.stop]
        for first, length in episodes:
            held = np.tile(own[first - 1], (length, 1))
            if spring is not None:
                held += relaxing(own, length, spring, random)
            own[first : first + length] = held + small_case.NOISE_NM * random.normal(
                size=held.shape
            )
    return replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})


def relaxing(free, frames, spring, random):
    """(frames, 3) from 0, with the friction of a free trace and so many times its stiffness."""
    deviation = free - free.mean(axis=0)
    variance = deviation.var(axis=0) - np.square(small_case.NOISE_NM)
    ratio = (np.mean(deviation[1:] * deviation[:-1], axis=0) / variance) ** spring
    path = np.zeros((frames, 3))
    for k in range(1, frames):
        kick = np.sqrt(variance / spring * (1 - ratio**2)) * random.normal(size=3)
        path[k] = ratio * path[k - 1] + kick
    return path


def bent(raw: Recording, amplitude_nm: float) -> Recording:
    """All beads as a tracker sees them whose response has a period."""

    def seen(xyz):
        wave = np.sin(2 * np.pi * xyz / PERIOD_NM + [0.3, 2.0, 0.0])
        return xyz + amplitude_nm * wave * [1, 1, 0]

    return replace(raw, positions_nm={bead: seen(xyz) for bead, xyz in raw.positions_nm.items()})


@pytest.mark.parametrize("spring", [None, STIFFER])
def test_sticking_is_found_measured_and_taken_off(spring):
    raw = small_case.raw(3)
    check = unchecked(stuck(raw, small_case.generator(4), spring))
    found = surface_sticking.find(check)
    assert found is not None
    share, count, duration = found.strengths
    frames = [length for episodes in EPISODES.values() for _, length in episodes]
    # an episode of a few frames by a spring may or may not be seen
    missed = len(frames) - count.value
    assert missed == 0 if spring is None else missed in (0, 1)
    true_share = sum(frames) / (len(small_case.FORCES_PN) * small_case.FRAMES)
    assert share.value == pytest.approx(true_share, rel=0.05 if spring is None else 0.15)
    assert abs(duration.value - np.mean(frames) / RATE_HZ) < 2 * duration.stderr
    for number, episodes in EPISODES.items():
        lost = np.isnan(found.case.positions_nm[number]).all(axis=1)
        for first, length in episodes:
            assert length < 20 or np.mean(lost[first : first + length]) > 0.9
        assert lost.sum() < 1.35 * sum(length for _, length in episodes) + 20
    assert not np.isnan(found.case.positions_nm[2]).any()
    assert p_value(found.case) > 0.004
    if spring is None:
        assert p_value(check.case) < 0.004
    assert f"{share.value:.1%} of the time" in found.cause


def test_a_pixels_response_is_found_measured_and_undone():
    raw = small_case.raw(5)
    check = unchecked(bent(raw, 3.0))
    found = pixel_locking.find(check)
    assert found is not None
    along_x, along_y, period = found.strengths
    for strength, truth in ((along_x, 3.0), (along_y, 3.0), (period, PERIOD_NM)):
        assert 0 < strength.stderr < 0.1 * truth
        assert abs(strength.value - truth) < 3 * strength.stderr
    before = unchecked(raw).case
    # the drift is measured with a bent reference, so that a mean may be left
    for truth, bad, mended in zip(
        before.positions_nm, check.case.positions_nm, found.case.positions_nm, strict=True
    ):
        off, left = ((x - truth)[:, :2].std(axis=0) for x in (bad, mended))
        assert np.all(left < 0.35 * off)
        np.testing.assert_array_equal(mended[:, 2], bad[:, 2])
    assert p_value(found.case) > 0.004
    assert "setup states no pixel" in found.cause


def test_the_stated_pixel_is_the_only_period_asked_for():
    camera = {"pixel_size_nm": PERIOD_NM}
    seen = bent(small_case.raw(6, camera=camera), 2.0)
    found = pixel_locking.find(unchecked(seen))
    assert found is not None
    along_x, along_y, period = found.strengths
    assert (period.value, period.stderr) == (PERIOD_NM, 0.0)
    assert all(abs(one.value - 2.0) < 3 * one.stderr for one in (along_x, along_y))
    elsewhere = bent(small_case.raw(6, camera={"pixel_size_nm": 61.0}), 2.0)
    assert pixel_locking.find(unchecked(elsewhere)) is None


def test_positions_stored_in_coarse_steps_are_no_pixels_response():
    """Steps trouble the test at any period, the pixel's too."""
    raw = small_case.raw(5, camera={"pixel_size_nm": PERIOD_NM})
    stepped = {
        bead: np.column_stack([90.0 * np.round(xyz[:, :2] / 90.0), xyz[:, 2]])
        for bead, xyz in raw.positions_nm.items()
    }
    check = unchecked(replace(raw, positions_nm=stepped))
    axes = [
        [
            pixel_locking.Trace(position[:, axis] + stage[:, axis], stage[:, axis])
            for position, stage in zip(
                check.case.positions_nm, check.case.camera_offset_nm, strict=True
            )
        ]
        for axis in (0, 1)
    ]
    assert pixel_locking.period(axes, PERIOD_NM).p_value(1.0) < pixel_locking.NEEDED_P
    assert pixel_locking.find(check) is None


def test_a_response_is_undone_exactly():
    place, size = np.linspace(-300, 300, 1001), np.array([4.0, -3.0])
    q = 2 * np.pi / PERIOD_NM
    raw = place + size[0] * np.sin(q * place) + size[1] * np.cos(q * place)
    np.testing.assert_allclose(pixel_locking.undone(raw, size, PERIOD_NM), place, atol=1e-6)


def test_lost_frames_neither_hide_nor_feign_sticking():
    random = small_case.generator(8)
    raw = small_case.raw(7)
    rows = slice(raw.plateaus[0].start, raw.plateaus[0].stop)
    lost = random.random(small_case.FRAMES) < 0.2
    free, held = (
        np.where(lost[:, None], np.nan, recording.positions_nm["b1"][rows])
        for recording in (raw, stuck(raw, random))
    )
    assert bound_stretches(free) == []
    found = bound_stretches(held)
    assert [(round(s.start / 20), round(s.stop / 20)) for s in found] == [
        (round(first / 20), round((first + length) / 20)) for first, length in EPISODES[0]
    ]


def drifting(raw, random):
    return moved(raw, np.cumsum(0.3 * random.normal(size=(len(raw.time_s), 3)), axis=0))


def vibrating(raw, random):
    phase = 2 * np.pi * random.random()
    return moved(raw, np.outer(np.sin(2 * np.pi * 31.7 * raw.time_s + phase), [6.0, 3.0, 2.0]))


def hopping(raw, random):
    state = np.cumsum(random.random(len(raw.time_s)) < 3 / RATE_HZ) % 2
    return moved(raw, np.outer(state, [0.0, 0.0, 50.0]))


def weakening(raw, random):
    """The force falls to half in every plateau, in the variances of x and y."""
    xyz = raw.positions_nm["b1"].copy()
    for plateau in raw.plateaus:
        own = xyz[plateau.start : plateau.stop, :2]
        middle = np.nanmean(own, axis=0)
        factor = np.sqrt(np.linspace(0.7, 1.4, len(own)))[:, None]
        own[:] = middle + factor * (own - middle)
    return replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})


def scaled(raw, random):
    xyz = raw.positions_nm["b1"]
    middle = np.append(np.nanmean(xyz[:, :2], axis=0), 0.0)
    return moved(raw, 0.15 * (xyz - middle))


def dropping(raw, random):
    kept = np.flatnonzero(random.random(len(raw.time_s)) > 0.1)
    time_s, magnet = raw.time_s[: len(kept)], raw.magnet_mm[kept]
    return replace(
        raw,
        time_s=time_s,
        frame=raw.frame[: len(kept)],
        positions_nm={bead: xyz[kept] for bead, xyz in raw.positions_nm.items()},
        magnet_mm=magnet,
        plateaus=find_plateaus(time_s, magnet, raw.setup.plateaus),
    )


def mistracked(raw, random):
    wrong = random.random(len(raw.time_s)) < 0.002
    return moved(raw, np.outer(wrong, [4000.0, -3000.0, 2000.0]))


def as_it_was(raw, random):
    return raw


each_other = pytest.mark.parametrize(
    "effect",
    [as_it_was, drifting, vibrating, hopping, weakening, scaled, dropping, mistracked],
)


@each_other
def test_other_effects_are_not_taken_for_these(effect):
    raw = small_case.raw(11, lost_share=0.02)
    check = unchecked(effect(raw, small_case.generator(11, 1)))
    assert [find(check) for find in CORRECTIONS] == [None, None]


@pytest.mark.parametrize(
    ("table", "slope", "spread"),
    [(sloping, 0.3, 0.28), (sloping, -0.3, 0.28), (stepped, 1.0, 0.25)],
)
def test_a_curved_table_is_found_measured_and_undone(table, slope, spread):
    raw = small_case.raw(21, lost_share=0.02)
    straight, check = unchecked(raw).case, checked(with_table(raw, 0, table, slope))
    found = z_response.find(check, small_case.generator(22))
    assert found is not None
    assert found.name == "z_response"
    (size,) = found.strengths
    # by the middle 96 % of heights; points scatter too, and a bead is not quite Gaussian
    assert abs(size.value - spread) < 0.08
    for number, (truth, bad, mended) in enumerate(
        zip(straight.positions_nm, check.case.positions_nm, found.case.positions_nm, strict=True)
    ):
        shape_off, shape_left = (1 - correlation(truth, x) for x in (bad, mended))
        assert shape_left < 0.25 * shape_off if number == 0 else shape_left == shape_off
        np.testing.assert_array_equal(mended[:, :2], bad[:, :2])


def correlation(one, other):
    """Of z: a scale is not the curve's to tell."""
    known = np.isfinite(one[:, 2]) & np.isfinite(other[:, 2])
    return np.corrcoef(one[known, 2], other[known, 2])[0, 1]


def test_a_curve_is_undone_exactly():
    heights = np.linspace(-2.0, 2.0, 13)
    curve = height_curve.Curve(heights, stepped(heights, 1.0))
    many = np.linspace(-5.0, 5.0, 1001)
    recorded = curve.answered(many)
    assert (np.diff(recorded) > 0).all()
    np.testing.assert_allclose(curve.undone(curve.recorded), heights, atol=1e-12)
    np.testing.assert_allclose(curve.undone(recorded), many, atol=0.03)
    straight = height_curve.Curve(heights, heights)
    z_nm = 900.0 + 12.0 * many
    np.testing.assert_allclose(z_response.straightened(z_nm, straight), z_nm)


def softer_at_some_heights(frames, steps, random):
    """Heights (frames,) of a bead in the potential u²/2 + 0.8 (u − tanh u), averaged over frames of
    so many steps of 0.02 relaxation times (Euler and Maruyama).
    """
    u, found = 0.0, np.zeros(frames)
    noise = random.normal(size=(frames, steps)) * np.sqrt(0.04)
    for k in range(frames):
        for kick in noise[k]:
            u += -0.02 * (u + 0.8 * np.tanh(u) ** 2) + kick
            found[k] += u / steps
    return found


@pytest.mark.parametrize("steps", [10, 30, 100])
def test_a_tether_that_is_softer_at_some_heights_shows_as_much_in_steps_as_expected(steps):
    """By brute force, with frames of 0.2 to 2 relaxation times that are exposed throughout."""
    random, camera = small_case.generator(31), Camera(1.0, 1.0)
    z = height_curve.standardised(softer_at_some_heights(12000, steps, random))
    straight = [
        height_curve.standardised(softness.tether_like(None, 50 / steps, camera, random))
        for _ in range(24)
    ]
    quantiles = np.mean([np.quantile(one, height_curve.SHARES) for one in straight], axis=0)
    curve = height_curve.Curve(quantiles, np.quantile(z, height_curve.SHARES))
    by_table = [curve.answered(one) for one in straight]
    steps_of = [
        np.array([height_curve.fast_by_height(one) for one in some])
        for some in (straight, by_table)
    ]
    share, stderr = height_curve.share_of_way(height_curve.fast_by_height(z), *steps_of)
    expected, its_stderr = softness.steps_of_softness(curve, z, camera, random)
    assert stderr < 0.15
    assert abs(share - expected) < 2.6 * np.hypot(stderr, its_stderr)
    assert expected < 1 - 2.6 * stderr or steps == 100


@pytest.mark.parametrize(
    ("share", "stderr", "of_softness", "told_apart"),
    [
        (1.0, 0.05, 0.5, True),
        (0.7, 0.05, 0.5, False),
        (1.0, 0.3, 0.5, False),
        (0.9, 0.1, 1.0, False),
    ],
)
def test_a_table_is_told_from_a_tether_by_more_than_chance(share, stderr, of_softness, told_apart):
    curve = height_curve.Curve(np.arange(3.0), np.arange(3.0))
    one = z_response.PlateauCurve(
        0, curve, 0.2, 0.02, 1e-9, (share, stderr), (of_softness, 0.03), 3
    )
    assert one.told_apart is told_apart


def test_what_a_tether_may_do_as_well_is_told_as_a_form():
    """In a plateau whose frames hardly follow each other."""
    raw = with_table(small_case.raw(21), 2, stepped, 1.0)
    told = explain(checked(raw), small_case.generator(6), effects=[])
    assert [(one.name, one.form) for one in told.named] == [("gain_by_height_z", "gain")]
    assert told.verdict == "described"
    assert "which this recording does not tell apart" in sentence(told, told.named[0])


@pytest.mark.parametrize(("outliers", "verdict"), [(False, "explained"), (True, "unexplained")])
def test_a_curved_table_is_named_without_any_cause_and_beside_what_is_left(outliers, verdict):
    """In a plateau whose frames follow each other; outliers of y have no name."""
    raw = with_table(small_case.raw(21), 0, stepped, 1.5)
    if outliers:
        xyz, random = raw.positions_nm["b1"], small_case.generator(8)
        wrong = random.random(len(xyz)) < 0.01
        xyz[wrong, 1] += 200.0 * random.normal(size=wrong.sum())
    told = explain(checked(raw), small_case.generator(6), effects=[])
    assert [one.name for one in told.named] == ["z_response"]
    assert told.verdict == verdict


def test_heights_read_in_coarse_steps_have_no_curve():
    raw = small_case.raw(21)
    xyz = raw.positions_nm["b1"].copy()
    xyz[:, 2] = 25.0 * np.round(xyz[:, 2] / 25.0)
    coarse = replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})
    assert not z_response.curves(small_case.case(coarse), small_case.generator(3))


@each_other
def test_other_effects_are_not_taken_for_a_curved_table(effect):
    raw = small_case.raw(11, lost_share=0.02)
    check = checked(effect(raw, small_case.generator(11, 1)))
    assert z_response.find(check, small_case.generator(23)) is None


@pytest.mark.parametrize(
    ("by", "is_simulated"), [("helping", True), ("nothing", False), ("losing frames", True)]
)
def test_a_correction_that_hardly_helps_is_not_simulated(monkeypatch, by, is_simulated):
    """Foreseen beside the simulations that there are, which lost what the recording had lost."""
    raw = small_case.raw(3)
    waving = moved(raw, waved(raw, 8.0))
    odd = small_case.case(waving)
    check = check_bead(odd, small_case.generator(1), rounds=(24,))
    lost = np.where(np.arange(len(raw.frame)) % 50 == 7, np.nan, 0.0)[:, None]
    case = {
        "helping": small_case.case(raw),
        "nothing": odd,
        "losing frames": small_case.case(moved(waving, lost)),
    }[by]
    found = Correction("made_up", case, (), "")
    asked = []

    def simulated(case, random):
        asked.append(case)
        return check

    monkeypatch.setattr(corrected_module, "check_bead", simulated)
    finds = (lambda check: found,)
    named, after = corrected_module.corrected(check, small_case.generator(2), finds)
    assert asked == ([case] if is_simulated else [])
    # it is the simulation that decides
    assert named == []
    assert after is check


def waved(raw: Recording, size_nm: float):
    return np.outer(size_nm * np.sin(2 * np.pi * 31.7 * raw.time_s), [0, 1, 0])

"""Lost frames that a file does not show: what they make of a wave, by formula and by chance.

Seeds are fixed. Where a bound is statistical, the chance that it fails for a right programme is
stated beside it.
"""

import cmath
import math
from dataclasses import replace

import numpy as np
import pytest

from mtpipe.crosschecking.lines import strongest_lines, with_line_bins
from mtpipe.crosschecking.prepared_bead import prepare
from mtpipe.drift import subtract_drift
from mtpipe.effects.catalogue import OWN
from mtpipe.effects.effect import Evidence
from mtpipe.experiment.changes import with_stage
from mtpipe.experiment.description import Clock, Line
from mtpipe.joint_fit.hypotheses import best_of
from mtpipe.joint_fit.spectra import matrix_periodogram
from mtpipe.physics.lost_frames import between_rows, wave_hz_by_frames
from mtpipe.simulation.readout import kept_frames, recorded
from tests.small_case import case, generator, raw, setup

SHARE, FRAME_S = 0.12, 1 / 120
OWN_BY_NAME = {effect.name: effect for effect in OWN}


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("recorded_hz", [0.4, 9.0, 31.0, 59.0])
def test_a_wave_has_the_recorded_frequency_where_frames_are_lost(recorded_hz, share):
    hz = wave_hz_by_frames(recorded_hz, FRAME_S, share)
    assert hz <= recorded_hz
    row = between_rows(cmath.exp(2j * math.pi * hz * FRAME_S), share)
    assert cmath.phase(row) / (2 * math.pi * FRAME_S) == pytest.approx(recorded_hz)


def test_the_example_of_the_page_on_physics():
    """With 12 % missing, 9 Hz at 120 frames/s are seen at 10.2 Hz, 0.6 Hz wide."""
    row = between_rows(cmath.exp(2j * math.pi * 9.0 * FRAME_S), SHARE)
    assert cmath.phase(row) / (2 * math.pi * FRAME_S) == pytest.approx(10.2, abs=0.05)
    coherence_s = -FRAME_S / math.log(abs(row))
    assert 1 / (math.pi * coherence_s) == pytest.approx(0.6, abs=0.05)


def test_what_rows_of_a_wave_have_in_common_is_the_mean_over_gaps():
    """Within four standard errors of 4000 series; by chance outside in 1 of 1000."""
    wave = cmath.exp(2j * math.pi * 17.0 * FRAME_S)
    gaps = [kept_frames(6, SHARE, generator(seed)) for seed in range(4000)]
    played = np.mean([wave**frames for frames in gaps], axis=0)
    expected = between_rows(wave, SHARE) ** np.arange(6)
    assert played == pytest.approx(expected, abs=4 / math.sqrt(8e3))


@pytest.mark.parametrize("coherence_s", [math.inf, 2.0])
def test_expected_spectra_of_a_wave_are_those_that_are_played(coherence_s):
    """The mean of 200 series in ten bins about the line is within 5 standard errors of what a fit
    expects, taken from the series' own scatter; by chance outside in 1 of 10⁵.
    """
    clean = case(raw(3))
    model, frames = clean.fit.model, len(clean.positions_nm[0])
    experiment = _broken(model.described(clean.fit.theta), coherence_s)
    without = with_stage(experiment, lines=())
    force_pN = float(clean.fit.force_pN[0])
    with_line, alone = (model.expected(one, 0, force_pN).power for one in (experiment, without))
    still = replace(experiment, tracker=replace(experiment.tracker, noise_nm=(0.0, 0.0, 0.0)))
    played = []
    for seed in range(200):
        random, many = generator(seed), math.ceil(1.4 * frames)
        seen = recorded(np.zeros((many, 3)), np.full(many, force_pN), still, random, [slice(many)])
        rows = kept_frames(frames, SHARE, random)
        spectrum = matrix_periodogram(seen[rows], FRAME_S, clean.phi[0])
        played.append(spectrum.power[:, 1, 1])
    expected = (with_line - alone)[:, 1, 1]
    mean, stderr = np.mean(played, axis=0), np.std(played, axis=0) / math.sqrt(len(played))
    largest = np.argsort(expected)[-10:]
    assert np.all(np.abs(mean - expected)[largest] < 5 * stderr[largest])
    # as long as one forgets the lost frames, far more of the wave is in its bin
    unbroken = model.expected(replace(experiment, clock=Clock()), 0, force_pN).power - alone
    assert unbroken[:, 1, 1].max() > 2 * mean.max()


def _broken(experiment, coherence_s):
    line = Line(23.0, (40.0, 40.0, 40.0), coherence_s)
    lossy = replace(experiment, clock=replace(experiment.clock, dropped_share=SHARE))
    return with_stage(lossy, lines=(line,))


@pytest.mark.parametrize("seed", range(4))
def test_a_wave_broken_by_lost_frames_is_seen_and_told_with_them(seed):
    """A steady wave of 9 Hz has a peak half a hertz wide where 12 % of the frames are lost.

    Its place is within 0.3 Hz, its amplitude within 20 % and the share within 0.03, three standard
    errors each; by chance outside in 1 of 100 seeds.
    """
    sizes = (
        {"share": SHARE},
        {"line_hz": 9.0} | {f"amplitude_{axis}_nm": 50.0 * (axis == "y") for axis in "xyz"},
    )
    listed = ["wall_drag", "rotation_coupling", "tracking_noise"]
    effects = {"dropped_frames": sizes[0], "vibration": sizes[1]}
    recording = raw(seed, model={"effects": [*listed, *effects]} | effects)
    bead = prepare(subtract_drift(replace(recording, setup=setup())), "b1")
    nats, line_hz = strongest_lines(bead)[0]
    assert nats > 12
    assert line_hz == pytest.approx(9.0, abs=0.3)
    bead = with_line_bins(bead, (line_hz,))
    evidence = Evidence((line_hz,), tuple(float(f) for f in bead.fit.force_pN))
    lossy = best_of(bead.fit, OWN_BY_NAME["dropped_frames"], evidence)
    both = best_of(lossy.fit, OWN_BY_NAME["vibration"], evidence)
    alone = best_of(bead.fit, OWN_BY_NAME["vibration"], evidence)
    assert both.fit.log_likelihood > alone.fit.log_likelihood + 10
    found = both.fit.model.described(both.fit.theta)
    assert found.clock.dropped_share == pytest.approx(SHARE, abs=0.03)
    assert found.stage.lines[0].amplitude_nm[1] == pytest.approx(50.0, rel=0.2)

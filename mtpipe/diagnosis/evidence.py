"""What the data suggest before any hypothesis is fitted: lines, and whether the reference moves."""

from __future__ import annotations

import numpy as np

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.crosschecking.lines import distinct_lines
from mtpipe.crosschecking.prepared_bead import PreparedBead, described
from mtpipe.drift.lowpass import response
from mtpipe.effects.effect import Evidence
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.courses import force_courses

BLOCK_S = 1.0
# Slow motion is laid to the reference, or to the bead, where that is likelier by 6 nats.
DECIDED_NATS = 6.0
# Frequencies in units of 1/block up to which a block mean is integrated, and their number.
HIGHEST, POINTS = 20.0, 2001


def evidence_of(check: BeadCheck) -> Evidence:
    """Evidence from a bead's cross-check and its traces."""
    forces = tuple(float(f) for f in check.case.fit.force_pN)
    each, common = force_courses(check.case.fit, check.case.positions_nm, check.case.frame_s)
    named = described(check.case).stage.lines_hz
    lines_hz = distinct_lines(check.case.lines_hz, named)
    heights_nm = check.case.heights_nm
    return Evidence(
        lines_hz,
        forces,
        reference_moves(check),
        check.case.reference_loose,
        check.case.reference_largest,
        each,
        common,
        check.case.focus,
        heights_nm,
    )


def reference_moves(check: BeadCheck) -> bool | None:
    """Whether slow motion of the bead is the reference's own, carried over by subtraction.

    Then the bead's steps from second to second go against the motion that was subtracted, by the
    reference's share of it; motion of the bead itself has nothing to do with it. The reference's
    tracking noise is subtracted too, as far as it passes, and goes against it in either case. None:
    there is no reference, or the data do not tell.
    """
    case = check.case
    if case.references_nm is None:
        return None
    bead, subtracted, thermal, tracked = [], [], [], []
    noise_nm2 = noise_between_blocks_nm2(case)
    for i, position in enumerate(case.positions_nm):
        length = max(2, round(BLOCK_S / case.frame_s))
        blocks = len(position) // length
        if blocks < 4:
            continue
        own = _block_means(position, blocks, length)
        carried = _block_means(case.camera_offset_nm[i], blocks, length)
        spectrum = case.fit.model.data[i].spectrum
        for axis in range(3):
            bead.append(np.diff(own[:, axis]))
            subtracted.append(np.diff(carried[:, axis]))
            level = case.fit.expected[i].power[:, axis, axis] / spectrum.gain(axis)
            slow = float(np.interp(1 / (4 * BLOCK_S), spectrum.frequency_hz, level))
            thermal.append(np.full(blocks - 1, slow / BLOCK_S))
            tracked.append(np.full(blocks - 1, noise_nm2[axis]))
    if not bead:
        return None
    # plateaus and axes are weighted by one over the variance of their thermal motion
    b, s, noise, passed = (np.concatenate(part) for part in (bead, subtracted, thermal, tracked))
    known = np.isfinite(b) & np.isfinite(s)
    b, s, weight, passed = b[known], s[known], 1 / noise[known], passed[known]
    total = float(np.sum(weight * s**2))
    if not total > 0:
        return None
    slope = float(np.sum(weight * b * s)) / total
    variance = float(np.sum((weight * s * (b - slope * s)) ** 2)) / total**2
    beyond_noise = slope + float(np.sum(weight * passed)) / total
    # two hypotheses: all of the bead's excess motion is the reference's, or none of it
    if_reference = -max(float(np.sum(weight * b**2)) - len(b), 0.0) / total
    variance_if = variance + 2 * len(b) / total**2
    nats = 0.5 * (beyond_noise**2 / variance - (beyond_noise - if_reference) ** 2 / variance_if)
    return None if abs(nats) < DECIDED_NATS else nats > 0


def noise_between_blocks_nm2(case: PreparedBead) -> list[float]:
    """Variance per axis of the difference of successive block means of what passes the low-pass of
    the references' tracking noise.
    """
    subtraction = case.fit.model.subtraction
    frequency = np.linspace(0.0, HIGHEST / BLOCK_S, POINTS)
    of_blocks = np.sinc(frequency * BLOCK_S) ** 2 * 4 * np.sin(np.pi * frequency * BLOCK_S) ** 2
    return [
        2 * case.frame_s * noise_nm**2
        * float(np.trapezoid(response(frequency, cutoff_hz) ** 2 * of_blocks, frequency))
        for noise_nm, cutoff_hz in zip(subtraction.noise_nm, subtraction.cutoff_hz, strict=True)
    ]  # fmt: skip


def _block_means(series: FloatArray, blocks: int, length: int) -> FloatArray:
    """(blocks, columns) means of successive blocks, lost frames left out."""
    pieces = series[: blocks * length].reshape(blocks, length, -1)
    there = np.isfinite(pieces)
    count = there.sum(axis=1)
    total = np.where(there, pieces, 0.0).sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))

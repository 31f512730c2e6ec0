"""What no reference bead takes off: the stage's course along z, and what it does to extensions.

The stage moves on from plateau to plateau, and from where z = 0 was true. Each plateau's mean z
holds that motion, whose size is estimated from what all beads show within the plateaus
(`mtpipe.drift.course`). Nothing depends on the means of x and y, and what is slow in them is in
their spectra, so that nothing is said of them here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from mtpipe.drift.course import Piece, fit_course, piece_of
from mtpipe.drift.grid import MOSTLY_KNOWN, grid_of
from mtpipe.drift.plateau_means import covariance_of_means
from mtpipe.ground.notice import Notice
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.surface import z_zero_time_s
from mtpipe.physics.mistracking import without_mistracked
from mtpipe.recording.recording import Recording, StageCourse


def course_left(recording: Recording) -> StageCourse | None:
    """The stage's course along z, from a recording whose z has lost nothing of it; None where the
    plateaus are too short to tell, or z was not recorded."""
    return fit_course(list(_pieces(recording)))


def extension_covariance_nm2(recording: Recording, bead: str) -> FloatArray | None:
    """(plateaus, plateaus) covariance of a bead's mean z by the stage's motion; None where that
    was taken off, or nothing tells it."""
    course = None if recording.drift is None else recording.drift.left_along_z
    if course is None or not recording.plateaus:
        return None
    return covariance_of_means(course, _spans_s(recording), z_zero_time_s(recording, bead))


def left_notice(recording: Recording, course: StageCourse | None) -> Notice | None:
    """What is to be said of motion that stays along z; None where z was not recorded."""
    seen = any(np.isfinite(recording.positions_nm[b][:, 2]).any() for b in recording.tethered)
    if not (seen and recording.plateaus):
        return None
    if course is None:
        text = (
            "How far the stage moves along z is unknown: there is no reference bead, and the "
            "plateaus are too short to measure it. Errors of extensions and of the tether's "
            "lengths do not include this motion. Record longer plateaus or a reference bead."
        )
        return Notice("drift_unknown", "caution", text, axis="z")
    covariance = covariance_of_means(course, _spans_s(recording), float(recording.time_s[0]))
    if len(covariance) > 1:
        variance = covariance[0, 0] + covariance[-1, -1] - 2 * covariance[0, -1]
        between = "between the first and the last plateau"
    else:
        variance, between = covariance[0, 0], "on average since the beginning"
    text = (
        f"The stage may have moved by ± {math.sqrt(variance):.2g} nm along z {between}, if it goes "
        f"on as within the plateaus ({_rates(course)}); no reference bead corrects for it, "
        "and errors of extensions and of the tether's lengths include it."
    )
    return Notice("drift_left", "caution", text, axis="z")


def _rates(course: StageCourse) -> str:
    walk = (
        f"{course.random_nm_per_root_s:.2g} ± {course.random_stderr_nm_per_root_s:.1g} nm per root "
        "second at random"
    )
    steady = course.steady_nm_per_s
    return f"{walk}, {steady:.2g} nm/s steadily" if steady > 0 else walk


def _spans_s(recording: Recording) -> FloatArray:
    """(plateaus, 2) begin and end of each."""
    frame_s = 1 / grid_of(recording).rate_hz
    time_s = recording.time_s
    return np.array([
        (time_s[plateau.start], time_s[plateau.stop - 1] + frame_s)
        for plateau in recording.plateaus
    ])  # fmt: skip


def _pieces(recording: Recording) -> Iterator[Piece]:
    """z of all beads that are tracked nearly throughout a plateau, plateau by plateau."""
    frame_s = 1 / grid_of(recording).rate_hz
    for plateau in recording.plateaus:
        found = []
        for bead in recording.tethered:
            z = without_mistracked(recording.trace_nm(bead, plateau))[0][:, 2]
            known = np.flatnonzero(np.isfinite(z))
            if len(known) > MOSTLY_KNOWN * len(z):
                found.append(np.interp(np.arange(len(z)), known, z[known]))
        piece = piece_of(found, frame_s) if found else None
        if piece is not None:
            yield piece

"""Looks between axes, plateaus and the extension: does one bead on one tether explain them all?

A trace by itself has a stiffness and a friction; how far they are from those of the fitted
experiment follows to first order from the residual spectrum, projected on what a change of either
would do to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.crosschecking.battery.observed import Fixed, Observed
from mtpipe.crosschecking.battery.statistic import Group, Kind, Statistic, Values
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import AXES


def projections(expected_changes: FloatArray, ordinates: FloatArray) -> FloatArray:
    """(2, n_bins) what takes a residual P/S − 1 to the changes of ln stiffness and ln friction.

    Parameters
    ----------
    expected_changes : (2, n_bins) ∂ ln S/∂ ln k and ∂ ln S/∂ ln γ.
    """
    weighted = expected_changes * ordinates
    return np.asarray(np.linalg.pinv(weighted @ expected_changes.T) @ weighted)


def per_trace(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """Changes of ln stiffness and ln friction of each trace against the fitted experiment."""
    values: Values = []
    projection = fixed.projection
    changes = np.array(
        [
            [projection[i][axis] @ (one.ratio[:, axis] - 1) for axis in range(3)]
            for i, one in enumerate(seen)
        ]
    )
    everywhere = tuple(range(len(seen)))
    precision = np.array(
        [
            [
                1 / np.sum(projection[i][axis] ** 2 / one.data.spectrum.ordinates, axis=1)
                for axis in range(3)
            ]
            for i, one in enumerate(seen)
        ]
    )
    trend = np.linspace(-1, 1, len(seen)) if len(seen) > 1 else np.zeros(1)
    for kind, statistic in enumerate(("stiffness", "friction")):
        for axis, name in enumerate(AXES):
            for i in everywhere:
                values.append((Statistic(statistic, name, (i,)), float(changes[i, axis, kind])))
            if len(seen) > 1:
                weight = precision[:, axis, kind]
                mean = float(weight @ changes[:, axis, kind] / weight.sum())
                values.append((Statistic(statistic, name, everywhere, pooled=True), mean))
                tilt = weight * (trend - weight @ trend / weight.sum())
                slope = float(tilt @ changes[:, axis, kind] / np.sqrt(np.sum(tilt**2)))
                entry = Statistic(f"{statistic}_along_series", name, everywhere, pooled=True)
                values.append((entry, slope))
    return values


PER_TRACE = Group(
    per_trace,
    (
        Kind(
            "stiffness",
            "stiffness",
            "stiffness of the trace alone compared with that of the joint fit (ln of the ratio)",
        ),
        Kind(
            "friction",
            "friction",
            "friction of the trace alone compared with that of the joint fit (ln of the ratio)",
        ),
        Kind("stiffness_along_series", "stiffness", "trend of the stiffness along the series"),
        Kind("friction_along_series", "friction", "trend of the friction along the series"),
    ),
)


def extensions(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """Mean heights against the chain, in standard errors; and all of them together."""
    pulls = [
        float((one.data.mean_nm[2] - one.expected.extension_nm) / one.expected.extension_stderr_nm)
        for one in seen
    ]
    values: Values = [(Statistic("extension", "z", (i,)), pull) for i, pull in enumerate(pulls)]
    if len(seen) > 1:
        entry = Statistic("extension", "z", tuple(range(len(seen))), pooled=True)
        values.append((entry, float(np.log1p(np.sum(np.square(pulls))))))
    return values


EXTENSIONS = Group(
    extensions,
    (
        Kind(
            "extension",
            "extension",
            "mean extension minus that of the chain (in standard errors)",
            odd="large pooled",
        ),
    ),
)


def known_forces(seen: Sequence[Observed], fixed: Fixed) -> Values:
    """ln of each fitted force over the force that the setup states, and the mean of these."""
    known = [(i, one.ln_force_off) for i, one in enumerate(seen) if one.ln_force_off is not None]
    values: Values = [(Statistic("known_force", "", (i,)), off) for i, off in known]
    if len(known) > 1:
        there = [i for i, _ in known]
        mean = float(np.average([off for _, off in known], weights=fixed.force_weight[there]))
        values.append((Statistic("known_force", "", tuple(there), pooled=True), mean))
    return values


KNOWN_FORCES = Group(
    known_forces,
    (
        Kind(
            "known_force",
            "known forces",
            "fitted force compared with the one that [[magnet]] states (ln of the ratio)",
        ),
    ),
)

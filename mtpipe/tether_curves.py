"""From a calibration to the force–extension curve of every bead."""

from __future__ import annotations

import math

import numpy as np

from mtpipe.bead_calibration import BeadResult, PlateauResult
from mtpipe.calibration import Calibration, calibrate
from mtpipe.estimate import Estimate
from mtpipe.extension_curve import ForceExtension, fit_curve
from mtpipe.fit.tether import Assay, ExtensionPoints
from mtpipe.recording import AXES, Recording

CONSISTENT_SIGMAS = 3.0


def tether_curves(calibration: Calibration) -> dict[str, ForceExtension]:
    """The curve of each bead that has a force in at least one plateau."""
    conditions = calibration.conditions
    assay = Assay(conditions.temperature_K, bead_turns=conditions.rotation)
    curves = {}
    for bead in calibration.beads:
        points = extension_points(bead, conditions.along)
        if points.usable().any():
            curves[bead.bead] = fit_curve(bead.bead, points, assay)
    return curves


def force_extension(recording: Recording, *, seed: int = 0) -> dict[str, ForceExtension]:
    """Calibrate a recording (drift already subtracted) and fit the curve of every bead.

    Parameters
    ----------
    seed : of the posteriors.
    """
    return tether_curves(calibrate(recording, seed=seed))


def extension_points(bead: BeadResult, along: int) -> ExtensionPoints:
    """Force and mean extension of every plateau, nan where there is none.

    The force is that along the field, averaged with the one across (which needs the bead's radius
    and the modes of its rotation) where both agree within three standard errors.
    """
    forces = [_force(plateau, along) for plateau in bead.plateaus]
    return ExtensionPoints(
        plateau=np.array([p.plateau.number for p in bead.plateaus], dtype=np.int64),
        force_pN=np.array([f[0] for f in forces]),
        force_stderr_pN=np.array([f[1] for f in forces]),
        extension_nm=np.array([p.extension_nm for p in bead.plateaus]),
        extension_stderr_nm=np.array([p.extension_stderr_nm for p in bead.plateaus]),
        lever_nm=np.array([p.extension_nm for p in bead.plateaus]),
    )


def _force(plateau: PlateauResult, along: int) -> tuple[float, float]:
    by_axis = {one.axis: one.force for one in plateau.axes if _usable(one.force)}
    first, second = by_axis.get(AXES[along]), by_axis.get(AXES[1 - along])
    if first is None:
        return math.nan, math.nan
    if second is None or abs(first.value - second.value) > CONSISTENT_SIGMAS * math.hypot(
        first.stderr, second.stderr
    ):
        return first.value, first.stderr
    weights = np.array([first.stderr, second.stderr]) ** -2.0
    values = np.array([first.value, second.value])
    return float(weights @ values / weights.sum()), float(weights.sum() ** -0.5)


def _usable(force: Estimate | None) -> bool:
    return force is not None and force.status == "ok"

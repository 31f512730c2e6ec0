"""From a calibration to the force–extension curve of every bead."""

from __future__ import annotations

import math

import numpy as np

from mtpipe.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration import Calibration, calibrate
from mtpipe.conditions import Conditions
from mtpipe.extension_curve import ForceExtension, fit_curves
from mtpipe.fit.tether import Assay, ExtensionPoints
from mtpipe.recording import AXES, Recording

CONSISTENT_SIGMAS = 3.0


def tether_curves(calibration: Calibration) -> dict[str, ForceExtension]:
    """The curve of each bead that has a force in at least one plateau."""
    conditions = calibration.conditions
    beads = {}
    for bead in calibration.beads:
        points = extension_points(bead, conditions)
        assay = Assay(
            conditions.temperature_K,
            bead_turns=conditions.rotation,
            zero_stderr_nm=bead.z_zero_stderr_nm,
        )
        if points.usable().any():
            beads[bead.bead] = (points, assay)
    return fit_curves(beads)


def force_extension(recording: Recording, *, seed: int = 0) -> dict[str, ForceExtension]:
    """Calibrate a recording (drift already subtracted) and fit the curve of every bead.

    Parameters
    ----------
    seed : of the posteriors.
    """
    return tether_curves(calibrate(recording, seed=seed))


def extension_points(bead: BeadResult, conditions: Conditions) -> ExtensionPoints:
    """Force and mean extension of every plateau, nan where there is none.

    The force is the one that x and y share; where they do not, that along the field, averaged with
    the one across (which needs the bead's radius and the modes of its rotation) if both agree
    within three standard errors. Its error is without that of z = 0, which is common to all
    plateaus.
    """
    forces = [_force(plateau, conditions) for plateau in bead.plateaus]
    return ExtensionPoints(
        plateau=np.array([p.plateau.number for p in bead.plateaus], dtype=np.int64),
        force_pN=np.array([f[0] for f in forces]),
        force_stderr_pN=np.array([f[1] for f in forces]),
        extension_nm=np.array([p.extension_nm for p in bead.plateaus]),
        extension_stderr_nm=np.array([p.extension_stderr_nm for p in bead.plateaus]),
        lever_nm=np.array([p.extension_nm for p in bead.plateaus]),
    )


def _force(plateau: PlateauResult, conditions: Conditions) -> tuple[float, float]:
    along, across = (
        next((_own(one, plateau, conditions) for one in plateau.axes if one.axis == name), None)
        for name in (AXES[conditions.along], AXES[1 - conditions.along])
    )
    if along is None:
        return math.nan, math.nan
    if across is None or all(one.shares_force for one in plateau.axes if one.axis != "z"):
        return along
    # errors of forces are relative; absolute weights would favour whichever came out low
    logs = np.log([along[0], across[0]])
    errors = np.array([along[1] / along[0], across[1] / across[0]])
    if abs(logs[0] - logs[1]) > CONSISTENT_SIGMAS * math.hypot(*errors):
        return along
    weights = errors**-2.0
    value = math.exp(float(weights @ logs / weights.sum()))
    return value, value * float(weights.sum() ** -0.5)


def _own(
    one: AxisResult, plateau: PlateauResult, conditions: Conditions
) -> tuple[float, float] | None:
    """Force and its standard error from this plateau alone; None where there is no force."""
    if one.force is None or one.force.status != "ok" or one.posterior is None:
        return None
    lever = conditions.lever_nm(AXES.index(one.axis), plateau.extension_nm)
    stiffness = one.posterior.stiffness
    if lever is None:
        return None
    relative = math.hypot(stiffness.stderr / stiffness.value, plateau.extension_stderr_nm / lever)
    return one.force.value, one.force.value * relative

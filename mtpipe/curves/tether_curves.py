"""From a calibration to the force–extension curve of every bead."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy import stats

from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.calibration import Calibration, calibrate
from mtpipe.calibration.recommended_force import named_forces
from mtpipe.calibration.series_choice import CONTRADICTION_P
from mtpipe.curves.extension_curve import ForceExtension, fit_curves
from mtpipe.diagnosis.forces_to_quote import recommended_forces
from mtpipe.diagnosis.mismatch import Mismatch
from mtpipe.fit.points import Assay, ExtensionPoints
from mtpipe.ground.estimate import Estimate
from mtpipe.recording.recording import AXES, Recording
from mtpipe.setup.conditions import Conditions

_Force = tuple[float, float]


def tether_curves(
    calibration: Calibration, instead: Mapping[str, Mapping[int, Estimate]] | None = None
) -> dict[str, ForceExtension]:
    """The curve of each bead that has a force in at least one plateau.

    Parameters
    ----------
    instead : by bead and plateau number, forces to take in place of those of the spectra.
    """
    conditions = calibration.conditions
    beads = {}
    for bead in calibration.beads:
        points = extension_points(bead, conditions)
        if instead is not None and bead.bead in instead:
            points = _with_forces(points, instead[bead.bead])
        assay = Assay(
            conditions.temperature_K,
            bead_turns=conditions.rotation,
            zero_stderr_nm=bead.z_zero_stderr_nm,
        )
        if points.usable().any():
            beads[bead.bead] = (points, assay)
    return fit_curves(beads)


def _with_forces(points: ExtensionPoints, forces: Mapping[int, Estimate]) -> ExtensionPoints:
    """Points with other forces, which no lever moves; those of other plateaus are left out."""
    there = [forces.get(int(number)) for number in points.plateau]
    return replace(
        points,
        force_pN=np.array([math.nan if one is None else one.value for one in there]),
        force_stderr_pN=np.array([math.nan if one is None else one.stderr for one in there]),
        lever_nm=None,
    )


def force_extension(
    of: Recording | Calibration, mismatch: Mismatch | None = None, *, seed: int = 0
) -> dict[str, ForceExtension]:
    """Fit the curve of every bead of a recording, or of its calibration.

    Parameters
    ----------
    of : a recording, drift already subtracted, which is calibrated first; or its calibration.
    mismatch : its diagnosis: a bead of which a cause was found has its forces from there, as in
        `mtpipe run`.
    seed : of the posteriors.

    Returns
    -------
    By name the curve (pN, nm) of every bead that has a force in at least one plateau.

    Raises
    ------
    SetupError : what calibration cannot do without is not known, such as the frame rate.
    """
    calibration = of if isinstance(of, Calibration) else calibrate(of, seed=seed)
    found = {} if mismatch is None else mismatch.beads
    return tether_curves(calibration, named_forces(recommended_forces(calibration, found)))


def extension_points(bead: BeadResult, conditions: Conditions) -> ExtensionPoints:
    """Force and mean extension of every plateau, nan where there is none.

    The force is the one that x and y share. Where they have forces of their own, it is that along
    the field, averaged with the one across (which needs the bead's radius and the modes of its
    rotation) if both agree in all plateaus of the bead. Its error is without that of z = 0 and
    of the stage's motion, which plateaus have in common.
    """
    pairs = [_along_and_across(plateau, conditions) for plateau in bead.plateaus]
    agree = _agree([pair for pair in pairs if pair[0] is not None and pair[1] is not None])
    forces = [
        _force(plateau, *pair, average=agree and not bead.left_out)
        for plateau, pair in zip(bead.plateaus, pairs, strict=True)
    ]
    return ExtensionPoints(
        plateau=np.array([p.plateau.number for p in bead.plateaus], dtype=np.int64),
        force_pN=np.array([f[0] for f in forces]),
        force_stderr_pN=np.array([f[1] for f in forces]),
        extension_nm=np.array([p.extension_nm for p in bead.plateaus]),
        extension_stderr_nm=np.array([p.extension_stderr_nm for p in bead.plateaus]),
        lever_nm=np.array([p.extension_nm for p in bead.plateaus]),
        stage_nm2=bead.stage_nm2,
    )


def _along_and_across(
    plateau: PlateauResult, conditions: Conditions
) -> tuple[_Force | None, _Force | None]:
    along, across = (
        next((_own(one, plateau, conditions) for one in plateau.axes if one.axis == name), None)
        for name in (AXES[conditions.along], AXES[1 - conditions.along])
    )
    return along, across


def _agree(pairs: Sequence[tuple[_Force | None, _Force | None]]) -> bool:
    """Whether the forces along and across agree, in each plateau and on the whole."""
    pulls = np.array([
        math.log(across[0] / along[0]) / math.hypot(along[1] / along[0], across[1] / across[0])
        for along, across in pairs
        if along is not None and across is not None
    ])  # fmt: skip
    if not len(pulls):
        return True
    scattered = float(stats.chi2.sf(np.sum(pulls**2), len(pulls)))
    common = float(stats.chi2.sf(np.sum(pulls) ** 2 / len(pulls), 1))
    return min(scattered, common) > CONTRADICTION_P


def _force(
    plateau: PlateauResult, along: _Force | None, across: _Force | None, *, average: bool
) -> _Force:
    if along is None:
        return math.nan, math.nan
    shared = all(one.shares_force for one in plateau.axes if one.axis != "z")
    if across is None or shared or not average:
        return along
    # errors of forces are relative; absolute weights would favour whichever came out low
    logs = np.log([along[0], across[0]])
    weights = np.array([along[1] / along[0], across[1] / across[0]]) ** -2.0
    value = math.exp(float(weights @ logs / weights.sum()))
    return value, value * float(weights.sum() ** -0.5)


def _own(
    one: AxisResult, plateau: PlateauResult, conditions: Conditions
) -> tuple[float, float] | None:
    """Force and its standard error from this plateau alone; None where there is none to use."""
    if one.force is None or plateau.status(one) != "ok" or one.posterior is None:
        return None
    lever = conditions.lever_nm(AXES.index(one.axis), plateau.extension_nm)
    stiffness = one.posterior.stiffness
    if lever is None:
        return None
    relative = math.hypot(stiffness.stderr / stiffness.value, plateau.own_stderr_nm / lever)
    return one.force.value, one.force.value * relative

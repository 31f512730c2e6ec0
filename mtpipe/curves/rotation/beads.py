"""All beads of a recording that the magnets turn, each with its verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.curves.rotation.kinds import Known
from mtpipe.curves.rotation.turned import Turned, turned_stretches
from mtpipe.curves.rotation.verdict import CANNOT_TELL, Verdict, verdict_of
from mtpipe.ground.notice import Notice
from mtpipe.ground.steps import Steps
from mtpipe.physics.tether import Chain, mean_extension_nm
from mtpipe.recording.recording import Recording
from mtpipe.setup.conditions import Conditions

# Least relative errors of force and contour length, however well stated: the magnets are turned at
# a force measured before or after, and a bead's own tether is not quite that of the setup.
LEAST_FORCE_ERROR, LEAST_CONTOUR_ERROR = 0.1, 0.1
# Force (pN) taken where a bead's own is not known, the usual one for turning; its spread in ln F.
USUAL_FORCE_PN, USUAL_FORCE_SPREAD = 0.7, 1.2
# Relative error of a contour length known only by the extension; radius and persistence length (nm)
# taken where they are not known.
CONTOUR_ERROR_FROM_HEIGHT, USUAL_RADIUS_NM, USUAL_PERSISTENCE_NM = 0.2, 500.0, 50.0
SHOWN = {
    "nicked": "held by one nicked molecule",
    "supercoilable": "held by one supercoilable molecule",
    "several tethers": "held by several tethers, so that its forces are not those of one",
}
# Least contour length (nm) taken from a height: shorter tethers cannot be told by it.
LEAST_CONTOUR_NM = 50.0


@dataclass(frozen=True)
class TurnedBead:
    """A bead in a stretch in which the magnets rotate.

    Attributes
    ----------
    force_pN, force_stderr_pN : at the magnets' position; nan where it is not known.
    """

    turned: Turned
    force_pN: float
    force_stderr_pN: float
    verdict: Verdict

    @property
    def notice(self) -> Notice:
        """What is to be said of the bead; more than one tether makes its forces wrong."""
        found, several = self.verdict, self.verdict.verdict == "several tethers"
        force = f" at {self.force_pN:.2g} pN" if self.force_pN > 0 else ""
        turned = f"Turned by {np.ptp(self.turned.turns):.0f} turns{force}"
        if found.verdict == CANNOT_TELL:
            said = f"{turned}, it does not show what holds it: {found.reason}."
        else:
            share = max(found.probability.values())
            said = f"{turned}, it shows that it is {SHOWN[found.verdict]} ({share:.1%}): "
            said += f"{found.reason}."
        if np.isfinite(found.buckling_turns) and found.verdict == "supercoilable":
            error = f"{found.buckling_turns:.1f} ± {found.buckling_stderr:.1f}"
            said += f" It buckles after {error} turns."
        return Notice("turned", "warning" if several else "info", said, self.turned.bead)


def turning(
    recording: Recording,
    forces: Mapping[str, BeadForces],
    conditions: Conditions,
    pool: Executor,
) -> Steps[tuple[TurnedBead, ...]]:
    """What each bead's extension says as the magnets turn, in steps; empty where they never do.

    Parameters
    ----------
    recording : drift already subtracted. forces : by bead. pool : over which beads are spread.
    """
    asked = []
    for turned in turned_stretches(recording):
        force, stderr = _force(recording, forces.get(turned.bead), turned.magnet_mm)
        known = _known(recording, conditions, turned, force, stderr)
        asked.append((turned, force, stderr, pool.submit(verdict_of, turned, known)))
    yield [verdict for _, _, _, verdict in asked]
    return tuple(
        TurnedBead(turned, force, stderr, verdict.result())
        for turned, force, stderr, verdict in asked
    )


def _force(
    recording: Recording, forces: BeadForces | None, magnet_mm: float | None
) -> tuple[float, float]:
    """Force and error of the bead's plateaus at this magnet position, or between neighbours."""
    if forces is None:
        return np.nan, np.nan
    estimates = {n: one.force for n, one in forces.recommended.items()}
    points = [
        (0.0 if plateau.magnet_mm is None else plateau.magnet_mm, force.value, force.stderr)
        for plateau in recording.plateaus
        if (force := estimates.get(plateau.number)) is not None and force.status == "ok"
    ]
    at, near = 0.0 if magnet_mm is None else magnet_mm, recording.setup.plateaus.tolerance_mm
    here = [one for one in points if abs(one[0] - at) <= near + 1e-6]
    if here:
        return _mean(here)
    if not points or not min(points)[0] < at < max(points)[0]:
        return np.nan, np.nan
    below, above = max(p for p in points if p[0] < at), min(p for p in points if p[0] > at)
    share = (at - below[0]) / (above[0] - below[0])
    between = float(np.exp((1 - share) * np.log(below[1]) + share * np.log(above[1])))
    return between, between * max(below[2] / below[1], above[2] / above[1])


def _mean(points: Sequence[tuple[float, float, float]]) -> tuple[float, float]:
    _, force, stderr = np.array(points).T
    weight = 1 / stderr**2
    return float(weight @ force / weight.sum()), float(weight.sum() ** -0.5)


def _known(
    recording: Recording, conditions: Conditions, turned: Turned, force: float, stderr: float
) -> Known:
    tether = recording.setup.tether
    persistence = tether.persistence_length_nm.value or USUAL_PERSISTENCE_NM
    error = max(stderr / force, LEAST_FORCE_ERROR) if force > 0 else USUAL_FORCE_SPREAD
    force = force if force > 0 else USUAL_FORCE_PN
    contour, contour_error = tether.contour_length_nm.value, LEAST_CONTOUR_ERROR
    if contour is None:
        chain = Chain(1.0, persistence, conditions.temperature_K)
        share = float(mean_extension_nm(chain, force))
        height = float(np.quantile(turned.extension_nm, 0.95))
        contour, contour_error = max(height / share, LEAST_CONTOUR_NM), CONTOUR_ERROR_FROM_HEIGHT
    radius = USUAL_RADIUS_NM if conditions.radius_nm is None else conditions.radius_nm[0]
    kT = conditions.thermal_energy_pN_nm
    return Known(force, error, contour, contour_error, persistence, kT, radius)

"""A force that a setup knows beforehand at a position of the magnets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mtpipe.ground.notice import Notice
from mtpipe.setup.setup import Setup

# Positions are stored to a nanometre.
ROUNDING_MM = 1e-6


@dataclass(frozen=True)
class KnownForce:
    """A force and its standard error; 0: exact."""

    force_pN: float
    stderr_pN: float


def known_force(setup: Setup, magnet_mm: float | None) -> KnownForce | None:
    """What `[[magnet]]` states at a position, within the setup's tolerance of positions.

    None where it states none, or the position is not known. Between positions nothing is assumed.
    Of positions within the tolerance the nearest counts.
    """
    if magnet_mm is None:
        return None
    near = [
        (abs(one.position_mm.value - magnet_mm), one.force_pN)
        for one in setup.magnet
        if one.position_mm.value is not None and _is_near(setup, one.position_mm.value, magnet_mm)
    ]
    if not near:
        return None
    force = min(near, key=lambda pair: pair[0])[1]
    return None if force.value is None else KnownForce(force.value, force.stderr)


def known_force_notices(setup: Setup, plateaus_mm: Sequence[float | None]) -> list[Notice]:
    """What is to be said of known forces: those that are exact, and those of no plateau.

    Parameters
    ----------
    plateaus_mm : positions of the plateaus' magnets.
    """
    notices = []
    exact, unused = [], []
    for one in setup.magnet:
        position = one.position_mm.value
        if position is None or one.force_pN.value is None:
            continue
        if not any(_is_near(setup, position, plateau) for plateau in plateaus_mm):
            unused.append(position)
        elif not one.force_pN.stderr:
            exact.append(position)
    if exact:
        notices.append(
            Notice(
                "known_force_exact",
                "info",
                f"The forces that [[magnet]] states at {_listed(exact)} have no error and are "
                "taken as exact in the cross-check. If they are not, add force_pN_stderr.",
            )
        )
    if unused:
        notices.append(
            Notice(
                "known_force_unused",
                "caution",
                f"No plateau has the position of [[magnet]] at {_listed(unused)}: what is stated "
                "there is not used. [plateaus] tolerance_mm sets how near a plateau has to be.",
            )
        )
    return notices


def _is_near(setup: Setup, position_mm: float, magnet_mm: float | None) -> bool:
    if magnet_mm is None:
        return False
    return abs(position_mm - magnet_mm) <= setup.plateaus.tolerance_mm + ROUNDING_MM


def _listed(positions_mm: Sequence[float]) -> str:
    return ", ".join(f"{position:g}" for position in positions_mm) + " mm"

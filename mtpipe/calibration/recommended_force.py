"""Which force to quote for a bead in a plateau: the rule of docs/forces.md, and its result.

The rungs of a ladder, from little that is assumed to much: the spectra of x and y (bead, camera and
extension), and the configured experiment (also the tether, its heights and z's power), without or
with what the diagnosis named. A rung is quoted if it was tested and not contradicted, the highest
first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from mtpipe.ground.estimate import Estimate

# Most forces that the line of a bead's forces spells out.
MOST_SHOWN = 4
Source = Literal["spectra", "heights", "named", "spectra_alone", "heights_alone", "none"]


@dataclass(frozen=True)
class RecommendedForce:
    """The force to quote of one bead in one plateau; `source` in a word."""

    force: Estimate
    source: Source


@dataclass(frozen=True, repr=False)
class BeadForces:
    """The forces of one bead.

    Attributes
    ----------
    recommended : by plateau number. configured, named : of the configured experiment, without and
        with what the diagnosis named; empty where there is none.
    mismatch : verdict of the diagnosis, "" without a cross-check.
    bound_percent : by how much what is left unexplained may move a force, at most over plateaus
        (68 %); 0 where nothing is left, nan without a cross-check.
    changed_percent : by how much what was named moved a force, at most over plateaus.
    """

    recommended: Mapping[int, RecommendedForce]
    configured: Mapping[int, Estimate] = field(default_factory=dict)
    named: Mapping[int, Estimate] = field(default_factory=dict)
    mismatch: str = ""
    bound_percent: float = float("nan")
    changed_percent: float = 0.0

    def __repr__(self) -> str:
        forces = [str(one.force) for one in self.recommended.values()]
        shown = ", ".join(forces[:MOST_SHOWN]) + (", …" if len(forces) > MOST_SHOWN else "")
        verdict = f"; {self.mismatch}" if self.mismatch else ""
        usable = f"{len(self.usable_pN)} of {len(forces)} to use"
        return f"BeadForces: {usable}{verdict}{f'; {shown}' if shown else ''}"

    @property
    def usable_pN(self) -> list[float]:
        """Forces that are numbers to use, in the order of the plateaus."""
        forces = [one.force for _, one in sorted(self.recommended.items())]
        return [force.value for force in forces if force.status == "ok"]

    def exceeds(self, tolerance: float) -> bool:
        """Whether what is left or what was named moves a force by more than this share."""
        return max(self.bound_percent, self.changed_percent) > 100 * tolerance


def named_forces(forces: Mapping[str, BeadForces]) -> dict[str, dict[int, Estimate]]:
    """Forces of beads whose recommended forces are those with what was named.

    A force that rests on heights and on the tether as stated says nothing new of the tether; only
    where something was named that changes the forces of the spectra, are these not to be used.
    """
    return {
        bead: {
            plateau: one.force
            for plateau, one in of_bead.recommended.items()
            if one.source == "named"
        }
        for bead, of_bead in forces.items()
        if any(one.source == "named" for one in of_bead.recommended.values())
    }

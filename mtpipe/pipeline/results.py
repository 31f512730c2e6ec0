"""What a run found: every step's results together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from mtpipe.calibration.calibration import Calibration
from mtpipe.calibration.comparison import MethodResult
from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.crosschecking.crosscheck import CrossCheck
from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.curves.rotation.beads import TurnedBead
from mtpipe.effects.catalogue import catalogue
from mtpipe.experiment.known_force import known_force_notices
from mtpipe.ground.notice import Notice
from mtpipe.ground.shown import Shown
from mtpipe.pipeline.tables import beads_table
from mtpipe.pipeline.verdict import BeadVerdict
from mtpipe.recording.recording import Recording
from mtpipe.report.marks import Mark
from mtpipe.setup.tables import ANHARMONIC, ROTATION

CHECK_FAILED = "crosscheck_failed"
TO_COME = Notice(
    "crosscheck_to_come",
    "caution",
    "The beads are not cross-checked yet. If the command that does it was stopped, give it again: "
    "it goes on from there.",
)


@dataclass(frozen=True, repr=False)
class Run(Shown):
    """Everything a run found out.

    `forces` are the forces to quote, of each tethered bead. `others` are forces by other methods,
    where asked for. `flags` are per bead, about its traces; `curves` exist for beads with enough
    forces; `checked` is the cross-check, unless left out; `mismatch`, `before_after` and
    `unexplained` are the content of the diagnosis's files. `marks` are the stretches of time that a
    reader had left out before. `content` is the identity of what went in (`pipeline.identity`);
    `complete` unless the cross-check is still to come. `turned` are the beads that the magnets
    turned.
    """

    recording: Recording
    calibration: Calibration
    forces: dict[str, BeadForces]
    others: tuple[MethodResult, ...]
    flags: dict[str, tuple[Notice, ...]]
    verdicts: tuple[BeadVerdict, ...]
    curves: dict[str, ForceExtension]
    checked: CrossCheck | None
    mismatch: dict[str, Any]
    before_after: dict[str, dict[str, Any]]
    unexplained: dict[str, dict[str, Any]]
    marks: tuple[Mark, ...]
    seed: int
    started: str
    seconds: dict[str, float]
    content: str
    complete: bool
    turned: tuple[TurnedBead, ...] = ()

    @property
    def failed(self) -> Mapping[str, str]:
        """Beads whose cross-check met a fault of the program."""
        return {} if self.checked is None else self.checked.failed

    def __repr__(self) -> str:
        counts = Counter(one.verdict for one in self.verdicts)
        beads = ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
        return f"Run of {self.recording.name}: {beads or 'no beads'}"

    @property
    def table(self) -> pd.DataFrame:
        """`beads.csv`, before any marks."""
        return beads_table(
            self.calibration, self.forces, self.verdicts, self.curves, self.recording.tracked
        )

    @property
    def notices(self) -> tuple[Notice, ...]:
        """All notices, in the order in which they arose."""
        flags = [notice for bead in self.flags.values() for notice in bead]
        curves = [notice for curve in self.curves.values() for notice in curve.notices]
        refused = {} if self.checked is None else self.checked.refused
        unchecked = [
            Notice("not_crosschecked", "info", f"It was not cross-checked: {reason}", bead)
            for bead, reason in refused.items()
        ]
        unchecked += [
            Notice(
                CHECK_FAILED,
                "warning",
                f"Its cross-check did not come to its end: {fault}",
                bead,
            )
            for bead, fault in self.failed.items()
        ]
        if not self.complete:
            unchecked.append(TO_COME)
        setup, positions = self.recording.setup, [p.magnet_mm for p in self.recording.plateaus]
        beyond = []
        if self.checked is not None:
            beyond = [
                *not_simulated(setup.model.effects),
                *known_force_notices(setup, positions),
            ]
        return (
            *self.recording.notices,
            *self.calibration.notices,
            *flags,
            *curves,
            *(one.notice for one in self.turned),
            *unchecked,
            *beyond,
        )


def not_simulated(listed: Sequence[str]) -> list[Notice]:
    """What is to be said where the setup lists effects that no fit and no simulation has."""
    known = {effect.name for effect in catalogue()}
    names = [name for name in listed if name not in known]
    if ANHARMONIC in listed and ROTATION not in listed:
        # only a bead that turns is followed through the whole potential
        names.append(f"{ANHARMONIC} without {ROTATION}")
    if not names:
        return []
    return [
        Notice(
            "effects_not_simulated",
            "caution",
            f"The setup lists {', '.join(names)}, which the simulations of the cross-check do not "
            "have: what such an effect does counts as a difference.",
        )
    ]

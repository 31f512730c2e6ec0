"""Effects that are seen in time or in the distribution of positions, and not as a spectrum.

They are found by their own sign in the traces and taken off them (stuck stretches blanked, a
tracker's response undone); what is left is fitted and checked again, which shows whether that was
all.
"""

from __future__ import annotations

from dataclasses import dataclass

from mtpipe.crosschecking.prepared_bead import PreparedBead


@dataclass(frozen=True)
class Strength:
    """One parameter of an effect, with its standard error."""

    name: str
    value: float
    stderr: float
    unit: str


@dataclass(frozen=True, eq=False)
class Correction:
    """An effect found in the traces.

    Attributes
    ----------
    name : as FORMATS section 5 has it; of a form, the form and its axis. case : with the effect
        taken off, fitted again.
    strengths : its parameters. cause : what it is, as in `Effect`.
    chance_p : p-value of a test that tells it from everything else that a recording may contain,
        a form from none; None where its own test does not.
    form, axes : of a term, where nothing tells which of several effects it is; else empty.
    """

    name: str
    case: PreparedBead
    strengths: tuple[Strength, ...]
    cause: str
    chance_p: float | None = None
    form: str = ""
    axes: tuple[str, ...] = ()

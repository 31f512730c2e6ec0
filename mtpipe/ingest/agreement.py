"""Whether what files say of themselves agrees with the setup: units and the frame rate.

A rate that contradicts the setup is refused, as contradicting time stamps are: one of the two is
wrong, and with it every force. So is a unit, unless the numbers show which is wrong
(`contradictions`). `[source] attributes = "setup"` puts the file's word aside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.notice import Notice
from mtpipe.ingest.clock import FASTEST_HZ, SLOWEST_HZ
from mtpipe.ingest.collect import OpenTable
from mtpipe.ingest.column_attributes import PLACEHOLDER_HZ, RATE_TOLERANCE, Stated
from mtpipe.ingest.columns import Assignment
from mtpipe.ingest.contradictions import ASIDE, Contradiction
from mtpipe.ingest.units import unit_of
from mtpipe.recording.recording import AXES
from mtpipe.setup.source_parts import UNKNOWN_UNIT
from mtpipe.setup.source_table import Source


@dataclass(frozen=True)
class StatedRate:
    """The frame rate by the files' own words; `hz` None where they do not say it."""

    hz: float | None
    words: str
    start_s: float
    notices: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class Use:
    """A column in use: what it is, the unit that the setup gives it, the key that says so."""

    column: int
    what: str
    unit: str | None
    key: str


Said = tuple[tuple[Notice, ...], tuple[Contradiction, ...]]


def check_columns(table: OpenTable, plan: Assignment, source: Source | None) -> Said:
    """Compare the units of a recording's columns with the setup; as `check_uses`."""
    aside = source is not None and source.attributes is not None
    return check_uses(table, list(_uses(plan, source)), aside=aside)


def check_uses(table: OpenTable, uses: Sequence[Use], *, aside: bool) -> Said:
    """Compare what a file says of columns in use with the setup, and say what is done with it.

    Parameters
    ----------
    aside : whether the setup puts the file's word aside.

    Returns
    -------
    Notices, and units in which file and setup contradict each other.

    Raises
    ------
    RecordingError : an attribute may change the numbers in a way that is not known.
    """
    told = {use: table.stated[use.column] for use in uses}
    if aside:
        return _put_aside(told, table), ()
    notices: dict[str, Notice] = {}
    contradictions = []
    changed: dict[str, list[str]] = {}
    for use, stated in told.items():
        name = table.names[use.column]
        if stated.unagreed:
            raise RecordingError(
                f"column {name} ({use.what}) has the attribute {stated.unagreed}, which may change "
                "its numbers in a way that programs do not agree on",
                where=str(table.path),
                mend='Say by scale in [source] what the numbers need, and attributes = "setup".',
            )
        found = _compared(use, stated, table)
        if isinstance(found, Contradiction):
            contradictions.append(found)
        elif found is not None:
            notices.setdefault(found.message, found)
        for words in stated.changed_by:
            changed.setdefault(words, []).append(name)
    for words, names in changed.items():
        said = f"The file's {words} of {_listed(names)} is applied."
        notices[said] = Notice("attributes_applied", "info", said)
    return tuple(notices.values()), tuple(contradictions)


def stated_rate(
    tables: Sequence[OpenTable],
    plans: Sequence[Assignment],
    source: Source | None,
    setup_hz: float | None,
) -> StatedRate:
    """The frame rate that the files give for their positions.

    Raises
    ------
    RecordingError : they contradict one another or the setup, or begin at different times.
    """
    if source is not None and source.attributes == "setup":
        return StatedRate(None, "", 0.0)
    found: dict[str, float] = {}
    starts: list[float] = []
    notices: list[Notice] = []
    for table, plan in zip(tables, plans, strict=True):
        uses = [use for use in _uses(plan, source) if use.what not in ("time", "frame")]
        starts.append(_start_s(table, uses))
        for stated in (table.stated[use.column] for use in uses):
            if stated.rate_against and stated.rate_hz is not None:
                raise _torn(f"{stated.rate_words} makes {stated.rate_hz:.6g}", stated.rate_against)
            if stated.rate_hz is not None:
                found.setdefault(f"{stated.rate_words} of {table.path.name}", stated.rate_hz)
    for words in [words for words, rate in found.items() if rate == PLACEHOLDER_HZ]:
        del found[words]
        if setup_hz is None or abs(setup_hz - PLACEHOLDER_HZ) > RATE_TOLERANCE:
            said = (
                f"{words} is what programs write that do not know the time between frames; it is "
                "put aside."
            )
            notices.append(Notice("rate_placeholder", "caution", said))
    if not found:
        return StatedRate(None, "", starts[0], tuple(notices))
    words, rate = next(iter(found.items()))
    for other, hz in found.items():
        if abs(hz / rate - 1) > RATE_TOLERANCE:
            raise _torn(f"{words} makes {rate:.6g}", f"{other} makes {hz:.6g}")
    if setup_hz is not None:
        check_rate(StatedRate(rate, words, starts[0]), setup_hz, "the setup says")
    elif not SLOWEST_HZ <= rate <= FASTEST_HZ:
        raise RecordingError(
            f"{words} makes {rate:.6g} frames per second, which no recording of beads has",
            mend=f"Give camera.frame_rate_hz. {ASIDE}",
        )
    return StatedRate(rate, words, starts[0], tuple(notices))


def _torn(one: str, other: str) -> RecordingError:
    return RecordingError(
        f"the files contradict themselves: {one} frames per second, {other}", mend=ASIDE
    )


def check_rate(stated: StatedRate, rate_hz: float, says: str) -> None:
    """Refuse a rate, of the setup or of time stamps, that the file contradicts.

    Raises
    ------
    RecordingError : they differ by more than 0.5 %.
    """
    if stated.hz is None or abs(stated.hz / rate_hz - 1) <= RATE_TOLERANCE:
        return
    raise RecordingError(
        f"{says} {rate_hz:.6g} frames per second, the file says {stated.hz:.6g} ({stated.words})",
        mend=f'Correct camera.frame_rate_hz (or write "unknown" to use the file\'s). {ASIDE}',
    )


def rate_notice(stated: StatedRate) -> Notice:
    """Says that the frame rate is the file's own."""
    said = f"The frame rate, {stated.hz:.6g} Hz, was taken from the file ({stated.words})."
    return Notice("frame_rate_derived", "info", said)


def _start_s(table: OpenTable, uses: Sequence[Use]) -> float:
    """Time of the first row by the file's own words, 0 where it says nothing."""
    starts = {table.stated[use.column].start_s: table.names[use.column] for use in uses}
    if len(starts) > 1:
        told = ", ".join(f"{name} at {start:g} s" for start, name in starts.items())
        raise RecordingError(
            f"columns begin at different times ({told})", where=str(table.path), mend=ASIDE
        )
    return next(iter(starts), 0.0)


def _uses(plan: Assignment, source: Source | None) -> Iterator[Use]:
    units = source.units if source is not None and source.beads else None
    for bead, columns in plan.beads.items():
        for axis, column in zip(AXES, columns, strict=True):
            if column >= 0:
                unit = "nm" if units is None else units.of(axis)
                yield Use(column, f"{bead} {axis}", unit, "[source.units]")
    time = source.time.unit if source is not None and source.time is not None else "s"
    magnet = source.magnet.unit if source is not None and source.magnet is not None else "mm"
    turns = source.rotation.unit if source is not None and source.rotation is not None else None
    for column, what, unit in (
        (plan.time, "time", time),
        (plan.frame, "frame", None),
        (plan.magnet, "magnet", magnet),
        (plan.rotation, "rotation", turns),
    ):
        if column >= 0:
            yield Use(column, what, unit, f"[source.{what}] unit")


def _compared(use: Use, stated: Stated, table: OpenTable) -> Notice | Contradiction | None:
    """What is to be said of a column's unit; None where it agrees or there is none."""
    name = table.names[use.column]
    if not stated.unit or use.unit is None:
        return None
    unit = unit_of(stated.unit)
    if unit == use.unit:
        return None
    if use.unit == UNKNOWN_UNIT:
        return Notice(
            "unit_derived", "info", f"The unit of column {name}, {unit}, is the file's own."
        )
    if unit is None:
        said = f"The unit {stated.unit!r} of column {name} is not known; {use.unit} is taken."
        return Notice("unit_not_known", "info", said)
    words, where = stated.unit_words, str(table.path)
    one = Contradiction(name, use.what, unit, use.unit, words, use.key, where)
    if stated.unit_in_name:
        said = one.refused().message
        return Notice("unit_contradicts", "caution", f"{said[0].upper()}{said[1:]}.")
    return one


def _put_aside(told: dict[Use, Stated], table: OpenTable) -> tuple[Notice, ...]:
    words: dict[str, list[str]] = {}
    for use, stated in told.items():
        unit = () if stated.unit_in_name else (stated.unit_words,)
        for one in (*unit, *stated.changed_by, stated.rate_words, stated.unagreed):
            if one:
                words.setdefault(one, []).append(table.names[use.column])
    if not words:
        return ()
    said = "; ".join(f"{one} of {_listed(names)}" for one, names in words.items())
    said = f'What the file says is put aside (attributes = "setup"): {said}.'
    return (Notice("attributes_put_aside", "caution", said),)


def _listed(names: Sequence[str]) -> str:
    different = list(dict.fromkeys(names))
    return ", ".join(different[:6]) + (", ..." if len(different) > 6 else "")

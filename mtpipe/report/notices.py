"""Notices as people read them: grouped by what they say, the most severe first, equal ones once."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from mtpipe.ground.notice import Notice
from mtpipe.report import words

# Findings about the recording, which come before all others whatever their severity.
FIRST_CODES = ("magnet_log_lag", "hidden_step")


@dataclass(frozen=True)
class Told:
    """One message, and all that it is about: the beads, and where in each of them."""

    beads: tuple[str, ...]
    place: str
    message: str


@dataclass(frozen=True)
class NoticeGroup:
    """Notices of one code, either on the recording as a whole or on single tethered beads.

    Attributes
    ----------
    severity : that of the worst of them.
    general : a finding about the recording, or on a reference bead, which concerns every bead.
    foremost : to be read before anything else, as one of them is no mere remark.
    items : what they say, equal messages once.
    beads : the beads concerned.
    """

    code: str
    severity: str
    general: bool
    foremost: bool
    items: tuple[Told, ...]
    beads: tuple[str, ...]

    @property
    def label(self) -> str:
        """The code in words."""
        return words.label(self.code)


def is_foremost(notice: Notice) -> bool:
    """Whether a notice is to be read before anything else: no mere remark."""
    return notice.code in FIRST_CODES or notice.severity != "info"


def told_once(notices: Iterable[Notice]) -> list[Told]:
    """Each message once, with the axes, plateaus and beads that share it, in order of appearance.

    A bead that is refused in 36 plateaus for one reason would else have 108 equal lines.
    """
    axes: dict[tuple[str, str, int | None], list[str]] = {}
    for one in notices:
        there = axes.setdefault((one.message, one.bead or "", one.plateau), [])
        if one.axis is not None:
            there.append(one.axis)
    plateaus: dict[tuple[str, str, frozenset[str]], list[int]] = {}
    for (message, bead, plateau), along in axes.items():
        inside = plateaus.setdefault((message, bead, frozenset(along)), [])
        if plateau is not None:
            inside.append(plateau)
    beads: dict[tuple[str, str], list[str]] = {}
    for (message, bead, shared), inside in plateaus.items():
        beads.setdefault((message, words.place(inside, shared)), []).append(bead)
    return [
        Told(tuple(filter(None, names)), place, message)
        for (message, place), names in beads.items()
    ]


def notice_groups(notices: Iterable[Notice], tethered: Collection[str]) -> list[NoticeGroup]:
    """Notices by code: findings about the recording, then the most severe first."""
    groups: dict[tuple[str, bool], list[Notice]] = {}
    for notice in notices:
        general = notice.bead not in tethered or notice.code in FIRST_CODES
        groups.setdefault((notice.code, general), []).append(notice)
    made = [
        NoticeGroup(
            code=code,
            severity=min((n.severity for n in group), key=words.SEVERITY_ORDER.__getitem__),
            general=general,
            foremost=any(map(is_foremost, group)),
            items=tuple(told_once(group)),
            beads=tuple(sorted({n.bead for n in group if n.bead}, key=words.natural)),
        )
        for (code, general), group in groups.items()
    ]
    return sorted(
        made,
        key=lambda group: (
            group.code not in FIRST_CODES,
            words.SEVERITY_ORDER[group.severity],
            group.code,
        ),
    )

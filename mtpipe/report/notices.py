"""Notices as the report lists them: grouped by what they say, the most severe first."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from mtpipe.ground.notice import Notice
from mtpipe.report import words

# Findings about the recording, which come before all others whatever their severity.
FIRST_CODES = ("magnet_log_lag", "hidden_step")


@dataclass(frozen=True)
class NoticeGroup:
    """Notices of one code, either on the recording as a whole or on single tethered beads.

    Attributes
    ----------
    severity : that of the worst of them.
    general : a finding about the recording, or on a reference bead, which concerns every bead.
    foremost : to be read before anything else, as one of them is no mere remark.
    items : (bead, place, message) of each.
    beads : the beads concerned.
    """

    code: str
    severity: str
    general: bool
    foremost: bool
    items: tuple[tuple[str, str, str], ...]
    beads: tuple[str, ...]

    @property
    def label(self) -> str:
        """The code in words."""
        return words.label(self.code)


def is_foremost(notice: Notice) -> bool:
    """Whether a notice is to be read before anything else: no mere remark."""
    return notice.code in FIRST_CODES or notice.severity != "info"


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
            items=tuple((n.bead or "", words.place(n.plateau, n.axis), n.message) for n in group),
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

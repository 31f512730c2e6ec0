"""Notices as the report lists them: grouped by code, the most severe first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from mtpipe.notice import Notice
from mtpipe.report import words


@dataclass(frozen=True)
class NoticeGroup:
    """All notices of one code; `items` are (bead, place, message), `beads` those concerned."""

    code: str
    severity: str
    items: tuple[tuple[str, str, str], ...]
    beads: tuple[str, ...]

    @property
    def label(self) -> str:
        """The code in words."""
        return words.label(self.code)


def notice_groups(notices: Iterable[Notice]) -> list[NoticeGroup]:
    """Notices by code, the most severe first; a group is as severe as its worst notice."""
    groups: dict[str, list[Notice]] = {}
    for notice in notices:
        groups.setdefault(notice.code, []).append(notice)
    made = [
        NoticeGroup(
            code=code,
            severity=min((n.severity for n in group), key=words.SEVERITY_ORDER.__getitem__),
            items=tuple(
                (n.bead or "", words.place(n.plateau, n.axis) if n.bead else "", n.message)
                for n in group
            ),
            beads=tuple(sorted({n.bead for n in group if n.bead}, key=words.natural)),
        )
        for code, group in groups.items()
    ]
    return sorted(made, key=lambda group: (words.SEVERITY_ORDER[group.severity], group.code))

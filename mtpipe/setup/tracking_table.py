"""The setup's `[tracking]` table: how `mtpipe track` goes about a stack of images.

Every key may be left out. Files are told relative to the setup. All keys with examples:
docs/tracking.md.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import Literal

from pydantic import Field, field_validator, model_validator

from mtpipe.ground.spreadsheets import FORMULA_MARKS
from mtpipe.setup.source_parts import Magnet, Table


class RegionOfBead(Table):
    """A bead by its name, the pixel at its centre (the first pixel is 0) and its region's side."""

    name: str
    x_px: float = Field(ge=0)
    y_px: float = Field(ge=0)
    size_px: int = Field(ge=16)

    @field_validator("name")
    @classmethod
    def _is_part_of_a_column(cls, name: str) -> str:
        if not re.fullmatch(r'[^,"\s]+', name) or not name.isprintable():
            raise ValueError("the name of a bead has no spaces, commas or quotes")
        if name.startswith(FORMULA_MARKS):
            raise ValueError("a spreadsheet would take the name of a bead for a formula")
        return name


class Tracking(Table):
    """How beads are found and tracked.

    `regions` are the beads; without them they are found. `size_px` is the side of the regions of
    beads that are found. `look_up_table` is that of every bead which has none of its own in
    `look_up_table_of`. `saturated_above` is the largest grey level of the camera, where its files
    do not say. `magnet` is a log of the magnets, as in `[source]`. `frames` says what the file
    calls its frames where it does not call them times; `times` that the setup's rate is right and
    the file's stamps are not; `incomplete` that what is there of a film cut off is to be taken.
    """

    method: str | None = None
    regions: tuple[RegionOfBead, ...] = ()
    size_px: int | None = Field(default=None, ge=16)
    look_up_table: str | None = None
    look_up_table_of: dict[str, str] = Field(default_factory=dict)
    saturated_above: float | None = Field(default=None, gt=0)
    magnet: Magnet | None = None
    frames: Literal["channels"] | None = None
    times: Literal["setup"] | None = None
    incomplete: Literal["take"] | None = None

    @model_validator(mode="after")
    def _is_possible(self) -> Tracking:
        twice = [name for name, n in Counter(r.name for r in self.regions).items() if n > 1]
        if twice:
            raise ValueError(f"regions: two are named {twice[0]!r}")
        if self.regions and self.size_px is not None:
            raise ValueError("size_px is for beads that are found; each of regions has its own")
        if self.magnet is not None and (self.magnet.file is None or not self.magnet.is_log):
            raise ValueError(
                "magnet: an image stack has no columns; name a file, with time_column or with "
                "row_by_row = true"
            )
        return self

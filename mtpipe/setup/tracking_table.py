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
from mtpipe.setup.source_parts import Table
from mtpipe.setup.source_signals import Magnet


class RegionOfBead(Table):
    """A bead by its name, the pixel at its centre (the first pixel is 0) and its region's side."""

    name: str = Field(description="Name of the bead.", examples=["b1"])
    x_px: float = Field(
        ge=0, description="Column of the pixel at its centre; the first is 0.", examples=[412.0]
    )
    y_px: float = Field(
        ge=0, description="Row of the pixel at its centre; the first is 0.", examples=[250.5]
    )
    size_px: int = Field(ge=16, description="Side of its square region.", examples=[64])

    @field_validator("name")
    @classmethod
    def _is_part_of_a_column(cls, name: str) -> str:
        if not re.fullmatch(r'[^,"\s]+', name) or not name.isprintable():
            raise ValueError("the name of a bead has no spaces, commas or quotes")
        if name.startswith(FORMULA_MARKS):
            raise ValueError("a spreadsheet would take the name of a bead for a formula")
        return name


class Tracking(Table):
    """How beads are found and tracked."""

    method: str | None = Field(
        default=None,
        description="How positions are found (docs/tracking-accuracy.md). Default: the most "
        "precise way.",
        examples=["auto_conv_multiline"],
    )
    regions: tuple[RegionOfBead, ...] = Field(
        default=(), description="The beads. Without it they are found."
    )
    size_px: int | None = Field(
        default=None,
        ge=16,
        description="Side of the regions of beads that are found. Default: as their rings "
        "have it. A bead with a look-up table has the size of its table.",
        examples=[64],
    )
    look_up_table: str | None = Field(
        default=None,
        description="Look-up table for z of every bead that has none of its own. Beads "
        "differ: that is told.",
        examples=["lut.npz"],
    )
    look_up_table_of: dict[str, str] = Field(
        default_factory=dict,
        description="Look-up tables by the name of the bead.",
        examples=[{"b1": "b1.npz"}],
    )
    saturated_above: float | None = Field(
        default=None,
        gt=0,
        description="Largest grey level of the camera, such as 4095 for 12 bits saved in 16. "
        "Default: what the bits of the file can hold.",
        examples=[4095.0],
    )
    magnet: Magnet | None = Field(
        default=None,
        description="Log of the magnets, with the keys of [source.magnet]. Without it there "
        "is one plateau.",
    )
    frames: Literal["channels"] | None = Field(
        default=None,
        description='"channels": the file calls its frames channels.',
        examples=["channels"],
    )
    times: Literal["setup"] | None = Field(
        default=None,
        description="\"setup\": the setup's frame rate is right, and the file's stamps are not.",
        examples=["setup"],
    )
    incomplete: Literal["take"] | None = Field(
        default=None,
        description='"take" takes what is there of a film that is cut off.',
        examples=["take"],
    )

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

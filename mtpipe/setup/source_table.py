"""The setup's `[source]` table: how a laboratory's own files are laid out.

Plain frozen data, validated on reading; nothing here opens a file. Columns are told by number,
counted from 1 as a spreadsheet does, or by name; in files that hold arrays instead of a table
(MATLAB, HDF5, TDMS, numpy) the name is the array's, with `[k]` for column k of a two-dimensional
one, `[j,k]` of a three-dimensional one. A key that is absent and can be guessed from the file is
guessed with a notice; units are never guessed. All keys with examples: docs/source-table.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from mtpipe.setup.presets import COLUMNS, DEKKER_TEXT, with_preset
from mtpipe.setup.source_parts import UNKNOWN_UNIT, BeadColumns, Layout, Rows, Scale, Units, listed
from mtpipe.setup.source_signals import Frame, Lost, Magnet, Rotation, Time, ZZero


class Source(Layout):
    """Layout of files that are not canonical.

    With `preset` the table is that of an instrument, and keys that stand beside it override it.
    Without `beads` the files are canonical, and the table only says which files, rows and beads
    to take, and how text is written. Rows count from 1 through all files, both ends included,
    before any is left out.
    """

    preset: str | None = Field(
        default=None,
        description="A layout known by name. Keys that stand beside it override it.",
        examples=["magscope-hdf5"],
    )
    files: Annotated[tuple[str, ...], BeforeValidator(listed)] = Field(
        default=(),
        description="The recording's files: a name, a pattern or a list of them, beside the "
        "setup. Numbers in names sort by value.",
        examples=["*.txt.gz"],
    )
    beads: Annotated[tuple[BeadColumns, ...], BeforeValidator(listed)] = Field(
        default=(),
        description="Which columns are the beads': a table or a list of them. Without it the "
        "files are canonical.",
    )
    leave_out: tuple[str, ...] = Field(
        default=(), description="Beads to leave out.", examples=[["b7"]]
    )
    units: Units = Field(
        default=Units(), description="Units of the positions. Required where beads is given."
    )
    scale: Scale = Field(default=Scale(), description="Factors on the positions.")
    time: Time | None = Field(
        default=None,
        description="The column of time stamps. Without it and without frame every row is the "
        "next frame.",
    )
    frame: Frame | None = Field(default=None, description="The column of frame numbers.")
    magnet: Magnet | None = Field(
        default=None,
        description="The magnet position: a column, or a log with its own clock. A log takes "
        "the keys of text as well.",
    )
    rotation: Rotation | None = Field(default=None, description="The rotation of the magnets.")
    lost: Lost = Field(default=Lost(), description="What means that the tracker lost a bead.")
    keep_rows: tuple[Rows, ...] = Field(
        default=(),
        description="Ranges of rows to take, both ends included. Rows count from 1 through "
        "all files, before any is left out.",
        examples=[[[401, 103875]]],
    )
    skip_rows: tuple[Rows, ...] = Field(
        default=(), description="Ranges of rows to leave out.", examples=[[[1, 400]]]
    )
    z_zero: ZZero | None = Field(default=None, description="Where z = 0 is, in one of four ways.")
    z_zero_of: dict[str, ZZero] = Field(
        default_factory=dict, description="The same for one bead by its name."
    )

    @property
    def canonical_text(self) -> Layout:
        """How the text of canonical files is written: with commas unless the table says else."""
        marks = self.delimiter is None and self.decimal == "."
        return Layout(
            format="canonical",
            delimiter="comma" if marks else self.delimiter,
            decimal=self.decimal,
            encoding=self.encoding,
            header=True,
            skip_lines=self.skip_lines,
            comment=self.comment,
            incomplete=self.incomplete,
            attributes=self.attributes,
        )

    @property
    def names_asked(self) -> tuple[str, ...]:
        """Names of columns that the table asks for, `{n}` included."""
        of_beads = [c for b in self.beads for c in (*b.axes.values(), b.first_column)]
        others = [t.column for t in (self.time, self.frame) if t is not None]
        if self.magnet is not None and not self.magnet.is_log:
            others.append(self.magnet.column)
        return tuple(c for c in (*of_beads, *others) if isinstance(c, str))

    @property
    def knows_its_files(self) -> bool:
        """Whether the table says which files of a folder are the recording's."""
        return bool(self.files) or self.preset not in (None, COLUMNS)

    @model_validator(mode="before")
    @classmethod
    def _over_its_preset(cls, data: Any) -> Any:
        return with_preset(data) if isinstance(data, Mapping) else data

    @model_validator(mode="after")
    def _is_complete(self) -> Source:
        for key, ranges in (("keep_rows", self.keep_rows), ("skip_rows", self.skip_rows)):
            for first, last in ranges:
                if not 1 <= first <= last:
                    raise ValueError(f"{key}: [{first}, {last}] is no range of rows (from 1)")
        has_log = self.magnet is not None and self.magnet.is_log
        if self.rotation is not None and self.rotation.in_log and not has_log:
            raise ValueError("rotation.in_log needs a magnet log ([source.magnet] time_column)")
        if self.beads:
            self._axes_have_units()
        elif self.preset == DEKKER_TEXT:
            pass  # the number of columns tells what they are
        elif self.format not in (None, "canonical"):
            raise ValueError(
                f'beads is missing: which columns of the "{self.format}" file are they?'
            )
        elif {"time", "frame", "magnet", "rotation", "units", "scale"} & self.model_fields_set:
            raise ValueError("beads is missing: which columns are the beads' positions?")
        elif self.header is False:
            raise ValueError(
                "header: a canonical file has a line of column names; if yours has none, beads is "
                "missing: which columns are the beads' positions?"
            )
        return self

    def _axes_have_units(self) -> None:
        if self.format == "canonical":
            raise ValueError('beads: a "canonical" file names its beads itself')
        axes = {a for b in self.beads for a in (b.axes or b.order.replace("_", ""))}
        for axis in sorted(axes):
            if self.units.of(axis) is None:
                raise ValueError(
                    f'units: the unit of {axis} is missing ("nm", "um", "mm", "m" or "pixel")'
                )
            if self.units.of(axis) == UNKNOWN_UNIT and self.attributes is not None:
                raise ValueError(
                    f'units: {axis} is "unknown", and attributes = "setup" puts the file\'s aside'
                )
            if axis == "z" and self.units.of("z") == "pixel":
                raise ValueError("units: z cannot be in pixels; give units.z")

"""Tracking files of MagScope: ragged records, written batch by batch in any order.

Group `/tracking`, `schema_version` 1 (7jameslondon/MagScope, `magscope/tracking_data.py`): every
frame has a record for each bead that was followed then, `frame_offsets` says which, and
`frame_batch_sequence` puts the batches in order. Seen from outside, a file is a table with a row
for each frame, in order: `time_s` since the recording's first frame, and `bead <id> x`, `y`, `z`
in nm, NaN where the bead was not followed. Files of a recording that MagScope split share both.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.errors import RecordingError
from mtpipe.ground.types import FloatArray
from mtpipe.ingest.announced import check_announced, check_room
from mtpipe.ingest.bounded import unpacked
from mtpipe.ingest.column_attributes import NOTHING, Stated
from mtpipe.ingest.data_files import is_packed, open_stream
from mtpipe.recording.recording import AXES

GROUP = "tracking"
SCHEMA = 1
BLOCK_FRAMES = 1 << 16
# The file has the unit in the name; the shorter names are those of the program's attributes.
TIMESTAMPS = ("frame_timestamps_ns", "frame_timestamps")
POSITIONS = ("positions_nm", "positions")
RECORDING = ("recording_id", "recording_start_ns")
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Frames:
    """The frames of one file as they stand in it.

    `time_ns` (n_frames,) since 1970; records offsets[i] to offsets[i + 1] are of frame i; `runs`
    are stretches of frames [start, stop) in the order of their batches; `beads` are all ids;
    `recording` is what the files of one recording have in common.
    """

    path: Path
    time_ns: Integers
    offsets: Integers
    runs: tuple[tuple[int, int], ...]
    beads: frozenset[int]
    recording: tuple[int, ...]


@dataclass(frozen=True)
class MagscopeTable:
    """A tracking file seen as a table; attributes as in `collect.OpenTable`."""

    frames: Frames
    start_ns: int
    beads: tuple[int, ...]
    guesses: tuple[str, ...] = ()
    has_names: bool = True
    unusable: Mapping[str, str] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list, compare=False)

    @property
    def path(self) -> Path:
        """The file."""
        return self.frames.path

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return ("time_s", *(f"bead {bead} {axis}" for bead in self.beads for axis in AXES))

    @property
    def stated(self) -> tuple[Stated, ...]:
        """Nothing that is not in the layout already."""
        return (NOTHING,) * len(self.names)

    def batches(self, wanted: Sequence[int]) -> Iterator[list[FloatArray]]:
        """Yield the wanted columns (positions from 0) piece by piece, frames in order.

        Raises
        ------
        RecordingError : a bead is there twice in one frame, or the file is damaged.
        """
        with _tracking(self.path) as group:
            ids, positions = group["bead_ids"], _dataset(group, POSITIONS, self.path)
            for run_start, run_stop in self.frames.runs:
                for start in range(run_start, run_stop, BLOCK_FRAMES):
                    stop = min(start + BLOCK_FRAMES, run_stop)
                    offsets = self.frames.offsets[start : stop + 1]
                    records = slice(int(offsets[0]), int(offsets[-1]))
                    try:
                        block = spread(offsets, ids[records], positions[records], self.beads)
                    except ValueError as error:
                        raise RecordingError(str(error), where=str(self.path)) from None
                    seconds = (self.frames.time_ns[start:stop] - self.start_ns) * 1e-9
                    table = np.column_stack([seconds, block.reshape(stop - start, -1)])
                    yield [table[:, k] for k in wanted]


def open_magscope(paths: Sequence[Path]) -> list[MagscopeTable]:
    """Open the files of a recording, in order of time whatever their names.

    Raises
    ------
    RecordingError : no tracking file of schema 1, or one whose datasets contradict each other.
    """
    files = sorted((_frames(path) for path in paths), key=lambda f: int(f.time_ns.min()))
    for file in files[1:]:
        if file.recording != files[0].recording:
            raise RecordingError(
                f"belongs to another recording than {files[0].path.name}",
                where=str(file.path),
                mend="Give one file, or name those of one recording with [source] files.",
            )
    start = int(files[0].time_ns.min())
    beads = tuple(sorted(frozenset().union(*(file.beads for file in files))))
    said = f"time counts from the first frame, {start // 10**9}.{start % 10**9:09d} s after 1970"
    return [MagscopeTable(file, start, beads, (said,)) for file in files]


def spread(
    offsets: Integers, ids: NDArray[Any], positions: NDArray[Any], beads: Sequence[int]
) -> FloatArray:
    """Give every bead its place in every frame.

    Parameters
    ----------
    offsets : (n_frames + 1,) bounds of the frames' records; the first record given is offsets[0].
    ids : (n_records,) bead of each record; all are among `beads`, which increase.
    positions : (n_records, 3)

    Returns
    -------
    (n_frames, n_beads, 3), NaN where a frame has no record of a bead.

    Raises
    ------
    ValueError : a bead is there twice in one frame.
    """
    n = len(offsets) - 1
    frame = np.repeat(np.arange(n), np.diff(offsets))
    place = np.searchsorted(np.asarray(beads), ids)
    taken = np.bincount(frame * len(beads) + place, minlength=n * len(beads))
    if taken.max(initial=0) > 1:
        bead = beads[int(np.argmax(taken)) % len(beads)]
        raise ValueError(f"bead {bead} is there twice in one frame")
    block = np.full((n, len(beads), 3), np.nan)
    block[frame, place] = positions
    return block


def in_order(sequence: NDArray[Any]) -> tuple[tuple[int, int], ...]:
    """Stretches of frames [start, stop) of a file in the order of their batches' numbers.

    Parameters
    ----------
    sequence : (n_frames,) number of the batch that each frame came in.
    """
    order = np.argsort(sequence, kind="stable")
    pieces = np.split(order, np.flatnonzero(np.diff(order) != 1) + 1)
    return tuple((int(piece[0]), int(piece[-1]) + 1) for piece in pieces)


def _frames(path: Path) -> Frames:
    """Read what a file says of its frames, and check that it holds together."""
    with _tracking(path) as group:
        time_ns = np.asarray(_dataset(group, TIMESTAMPS, path)).astype(np.int64)
        offsets = np.asarray(_dataset(group, ("frame_offsets",), path)).astype(np.int64)
        sequence = np.asarray(_dataset(group, ("frame_batch_sequence",), path))
        ids = np.asarray(_dataset(group, ("bead_ids",), path))
        shape = _dataset(group, POSITIONS, path).shape
        recording = tuple(int(group.attrs[name]) for name in RECORDING if name in group.attrs)
    for values in (time_ns, offsets, sequence, ids):
        if values.ndim != 1:
            said = f"has numbers of shape {values.shape} where one per frame or record is expected"
            raise RecordingError(said, where=str(path))
    n, records = len(time_ns), len(ids)
    faults = (
        (n == 0, "holds no frames"),
        (
            offsets.shape != (n + 1,),
            f"has {len(offsets)} frame_offsets for {n} frames, where {n + 1} are expected",
        ),
        (
            len(sequence) != n,
            f"has frame_batch_sequence for {len(sequence)} frames of {n}",
        ),
        (
            shape != (records, 3),
            f"has positions of shape {shape} for {records} bead_ids",
        ),
        (
            bool(len(offsets)) and (offsets[0] != 0 or bool(np.any(np.diff(offsets) < 0))),
            "has frame_offsets that do not increase from 0",
        ),
        (
            bool(len(offsets)) and offsets[-1] != records,
            f"has frame_offsets that end at {offsets[-1:].sum()}, but {records} records",
        ),
    )
    for wrong, message in faults:
        if wrong:
            raise RecordingError(
                message, where=str(path), mend="Was the program stopped while it wrote?"
            )
    beads = frozenset(np.unique(ids).tolist())
    return Frames(path, time_ns, offsets, in_order(sequence), beads, recording)


def _dataset(group: Any, names: tuple[str, ...], path: Path) -> Any:
    import h5py

    for name in names:
        node = group.get(name)
        if isinstance(node, h5py.Dataset) and node.dtype.kind in "iuf" and node.shape:
            announced = node.size * node.dtype.itemsize
            held = node.id.get_storage_size()
            check_announced(announced, held, node.chunks is not None, str(path))
            check_room(announced, str(path))
            return node
    raise RecordingError(f"has no dataset /{GROUP}/{names[0]} of numbers", where=str(path))


@contextmanager
def _tracking(path: Path) -> Iterator[Any]:
    """The group of a tracking file; whatever h5py raises on damage becomes an error in words."""
    import h5py

    from mtpipe.ingest.hdf5 import cut_off, watched_heaps

    try:
        with open_stream(path) as stream:
            whole = unpacked(stream, str(path)) if is_packed(stream) else stream
            if cut := cut_off(whole):
                raise RecordingError(cut, where=str(path), mend="Copy the file again.")
            with h5py.File(watched_heaps(whole), "r") as file:
                if GROUP not in file:
                    raise RecordingError(
                        f"has no group /{GROUP}, as a tracking file of MagScope has",
                        where=str(path),
                    )
                version = file[GROUP].attrs.get("schema_version")
                if np.ndim(version) or version != SCHEMA:
                    raise RecordingError(
                        f"has schema_version {version}, only {SCHEMA} is known", where=str(path)
                    )
                yield file[GROUP]
    except RecordingError:
        raise
    except Exception as error:  # h5py and numpy raise anything on a damaged file
        reason = f"{type(error).__name__}: {error}".splitlines()[0][:200]
        raise RecordingError(f"cannot be read as hdf5 ({reason})", where=str(path)) from error

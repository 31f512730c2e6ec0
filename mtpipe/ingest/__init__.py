"""Reading recordings: canonical files as FORMATS has them, and laboratories' own by `[source]`.

The way of a file through the modules: `files` finds it, `text` or `arrays` yields its columns
batch by batch, `columns` says which column is what, `collect` fills the arrays, `clock`,
`magnets` and `surface` make frame numbers, resting stretches and z = 0 of them, `checks` refuses
or remarks, and `read` puts it all together. `source` is the layout as the setup states it,
`presets` the layouts of known instruments, `instruments` what of those only the files can tell;
MagScope's ragged files have a reader of their own, `magscope`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mtpipe.recording.recording import Recording
    from mtpipe.setup.setup import Setup


def load(path: Path | str, setup: Path | str | Setup | None = None) -> Recording:
    """Read a recording with its setup.

    Parameters
    ----------
    path : a file; a folder, whose files in name order are one recording; or a `setup.toml` whose
        `[source] files` names the files.
    setup : a setup or its file; by default the `setup.toml` beside the recording.

    Returns
    -------
    Recording, positions in nm, times in s, with every remark on it in `notices`.

    Raises
    ------
    SetupError : the setup is missing or wrong.
    RecordingError : a file cannot be read, or going on would give a wrong force.
    """
    from mtpipe.ingest.read import read_recording  # here, as mtpipe.setup imports this package

    return read_recording(Path(path), setup)

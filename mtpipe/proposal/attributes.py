"""What a file says beside its columns: attributes of HDF5 files and properties of TDMS files."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mtpipe.setup.source_parts import Format


def said_beside(path: Path, kind: Format) -> dict[str, str | float]:
    """Attributes of a file and of all in it that are one number or a text, the first of each name.

    kind : what the file is; of others than HDF5 and TDMS nothing is said.
    """
    found: dict[str, str | float] = {}
    # what is damaged or of a type that the libraries do not know is not needed for a proposal
    with suppress(OSError, RuntimeError, TypeError, ValueError, KeyError):
        if kind == "hdf5":
            _of_hdf5(path, found)
        if kind == "tdms":
            _of_tdms(path, found)
    return found


def _of_hdf5(path: Path, found: dict[str, str | float]) -> None:
    import h5py

    from mtpipe.ingest.hdf5 import watched_heaps

    with path.open("rb") as stream, h5py.File(watched_heaps(stream), "r") as file:
        _add(file.attrs, found)
        file.visititems(lambda _, node: _add(node.attrs, found))


def _of_tdms(path: Path, found: dict[str, str | float]) -> None:
    import nptdms

    with nptdms.TdmsFile.open(path) as file:
        _add(file.properties, found)
        for group in file.groups():
            _add(group.properties, found)
            for channel in group.channels():
                _add(channel.properties, found)


def _add(attributes: Mapping[str, Any], found: dict[str, str | float]) -> None:
    for name, value in attributes.items():
        if isinstance(value, str):
            found.setdefault(name, value)
        elif np.ndim(value) == 0 and np.isreal(value) and not isinstance(value, np.datetime64):
            found.setdefault(name, float(value))

"""netCDF 3 files; those of netCDF 4 are HDF5."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any, BinaryIO, cast

from scipy.io import netcdf_file

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.column_attributes import stated_by
from mtpipe.ingest.contents import Contents

# For more than 4 GB in a variable; scipy does not know it.
VERSION_5 = b"CDF\x05"


def open_netcdf(stream: BinaryIO, stack: ExitStack) -> Contents:
    """List the variables of a netCDF 3 file.

    Raises
    ------
    RecordingError : it is of a version that is not read, or shorter than its header says.
    """
    if stream.read(4) == VERSION_5:
        raise RecordingError(
            "is a netCDF file of version 5, which is not read",
            mend="Convert it: nccopy -k nc4 old.nc new.nc",
        )
    stream.seek(0)
    try:
        file: Any = stack.enter_context(netcdf_file(cast(Any, stream), mmap=False))
    except Exception as error:  # scipy raises anything on a header that is not whole
        raise RecordingError(
            f"is cut off or damaged, and nothing is taken of a file of this kind ({error})",
            mend="Copy the file again.",
        ) from None
    contents = Contents()
    around = stated_by(file._attributes, where="the file")
    for name, one in file.variables.items():
        get = one.data.__getitem__
        contents.add(name, one.shape, one.data.dtype, get, one._attributes, around=around)
    return contents

"""All readers by name."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # run folders are made as by the tests

import readers_arrays
import readers_hdf5
import readers_images
import readers_parquet
import readers_runs
import readers_text

BY_NAME = {
    reader.name: reader
    for module in (
        readers_text,
        readers_arrays,
        readers_hdf5,
        readers_parquet,
        readers_images,
        readers_runs,
    )
    for reader in module.READERS
}

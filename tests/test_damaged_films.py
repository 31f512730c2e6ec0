"""Films of every carrier, damaged in any way: a film as it was, or one sentence."""

import struct
import tracemalloc

import numpy as np
import pytest
import tifffile

from mtpipe.ground.errors import MtpipeError
from mtpipe.tracking.stack import open_stack
from mtpipe.tracking.stack_look import Reading

pytestmark = pytest.mark.slow

FRAMES = np.random.default_rng(3).integers(1, 200, (12, 16, 20)).astype(np.uint8)
GREY = {"photometric": "minisblack"}
CARRIERS = {
    "pages.tif": {**GREY, "metadata": None},
    "shaped.tif": GREY,
    "packed.tif": {**GREY, "metadata": None, "compression": "zlib"},
    "big.tif": {**GREY, "metadata": None, "bigtiff": True},
    "imagej.tif": {"imagej": True, "metadata": {"axes": "TYX", "finterval": 0.01}},
    "film.ome.tif": {"metadata": {"axes": "TYX", "TimeIncrement": 0.01}},
}
MUTATIONS_EACH = 150
MOST_BYTES = 1 << 27  # the files have some kB, and a header may ask for any


def mutated(content, random):
    """A bit turned, bytes overwritten, cut off, zeroed to the end, or a piece doubled."""
    data = bytearray(content)
    at = int(random.integers(len(data)))
    kind = random.integers(5)
    if kind == 0:
        data[at] ^= 1 << int(random.integers(8))
    elif kind == 1:
        odd = random.choice([0, 1, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF])
        data[at : at + 4] = struct.pack("<I", int(odd))
    elif kind == 2:
        data = data[:at]
    elif kind == 3:
        data[at:] = bytes(len(data) - at)
    else:
        data[at:at] = data[at : at + int(random.integers(1, 40))]
    return bytes(data)


@pytest.mark.parametrize("take", [False, True])
@pytest.mark.parametrize("name", CARRIERS)
def test_any_damage_is_one_sentence_and_little_memory(tmp_path, name, take):
    path = tmp_path / name
    tifffile.imwrite(path, FRAMES, **CARRIERS[name])
    whole = path.read_bytes()
    random = np.random.default_rng(len(name))
    told = []
    tracemalloc.start()
    for _ in range(MUTATIONS_EACH):
        path.write_bytes(mutated(whole, random))
        try:
            stack = open_stack(path, reading=Reading(take_incomplete=take))
            for chunk in stack.chunks():
                assert chunk.ndim == 3
        except MtpipeError as error:
            told.append(str(error))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(told) > MUTATIONS_EACH / 10
    assert all(name in said and "\n" not in said for said in told)
    assert peak < MOST_BYTES

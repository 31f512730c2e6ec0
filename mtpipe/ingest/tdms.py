"""LabVIEW's TDMS files.

npTDMS applies NI's own scaling. It says on its log what it finds wrong in a file; here that is
asked for and told once.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any, BinaryIO, Literal

import nptdms
import numpy as np
from nptdms.log import log_manager

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest.column_attributes import stated_by
from mtpipe.ingest.contents import Contents

SCALES = {
    "Polynomial", "Linear", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add",
    "Subtract", "AdvancedAPI",
}  # fmt: skip
# What a segment begins with: its mark, its contents (of which this bit is the byte order), its
# version, how far it is to the next, and how far to the numbers (NI, TDMS file format, 2024).
LEAD_IN_BYTES = 28
BIG_ENDIAN = 1 << 6


def open_tdms(stream: BinaryIO, stack: ExitStack) -> Contents:
    """List the channels of a TDMS file; its columns are as long as what is there of them."""
    stack.enter_context(_quiet())
    file = stack.enter_context(nptdms.TdmsFile.open(stream))
    contents = Contents()
    groups = file.groups()
    whole = stated_by(file.properties, where="the file")
    for group in groups:
        around = stated_by(group.properties, where=group.name).within(whole)
        for channel in group.channels():
            _check_scales(channel.properties, group.properties, file.properties)
            name = channel.name if len(groups) == 1 else f"{group.name}/{channel.name}"
            scale = _unknown_scale(channel.properties)
            if scale:
                contents.unusable[name] = f"{len(channel)} values with a scale of NI's, {scale}"
                continue
            contents.add(
                name,
                (len(channel),),
                np.dtype(channel.dtype),
                partial(_values, channel),
                channel.properties,
                around=around,
            )
    contents.cut = _cut(file, stream)
    return contents


def _values(channel: nptdms.TdmsChannel, index: tuple[slice]) -> Any:
    return channel[index[0]]


def _cut(file: nptdms.TdmsFile, stream: BinaryIO) -> str:
    """A sentence if the last segment is not whole, "" if it is."""
    status = file.file_status
    lengths = [len(c) for group in file.groups() for c in group.channels() if len(c)]
    if not status.incomplete_final_segment and _ends_with_a_segment(stream):
        return ""
    missing = max(
        (one.expected_length - one.read_length for one in (status.channel_statuses or {}).values()),
        default=0,
    )
    least = min(lengths, default=0)
    return f"is cut off in its last segment: {least} rows are whole" + (
        f", at least {missing} are missing" if missing > 0 else ""
    )


def _ends_with_a_segment(stream: BinaryIO) -> bool:
    """Whether the file ends where its last segment does, and not within the head of another."""
    size, at = stream.seek(0, io.SEEK_END), 0
    while at + LEAD_IN_BYTES <= size:
        stream.seek(at)
        lead_in = stream.read(LEAD_IN_BYTES)
        order: Literal["big", "little"] = "big" if lead_in[4] & BIG_ENDIAN else "little"
        at += LEAD_IN_BYTES + int.from_bytes(lead_in[12:20], order)
    return at == size


def _unknown_scale(properties: dict[str, Any]) -> str:
    if properties.get("NI_Scaling_Status") == "scaled":
        return ""
    kinds = [v for k, v in properties.items() if re.fullmatch(r"NI_Scale\[\d+\]_Scale_Type", k)]
    return next((str(kind) for kind in kinds if kind not in SCALES), "")


def _check_scales(*properties: dict[str, Any]) -> None:
    """Raise RecordingError if more scales are announced than there are properties to state them."""
    for of_one in properties:
        announced = of_one.get("NI_Number_Of_Scales", 0)
        if isinstance(announced, (int, np.integer)) and announced > len(of_one):
            raise RecordingError(f"is damaged: it announces {announced} scales of NI's")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps npTDMS from writing on the terminal."""
    before = log_manager.log_level
    log_manager.set_level(logging.CRITICAL)
    try:
        yield
    finally:
        log_manager.set_level(before)

"""Blocks of whole lines: none lost, none cut, and nothing of Python's left to pyarrow's threads."""

import io
import threading

import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mtpipe.ground.errors import RecordingError
from mtpipe.ingest import lines, text
from mtpipe.ingest.lines import line_blocks
from mtpipe.ingest.text import open_text
from mtpipe.setup.source_parts import Layout

LINES = st.lists(st.text("0123456789.,;µ", max_size=12), min_size=1, max_size=60)


@given(
    rows=LINES,
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    last_ended=st.booleans(),
    size=st.integers(16, 40),
    skip=st.integers(0, 5),
    encoding=st.sampled_from(["utf-8", "latin-1", "utf-16"]),
)
def test_every_line_arrives_whole(rows, end, last_ended, size, skip, encoding):
    content = (end.join(rows) + (end if last_ended else "")).encode(encoding)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lines, "BLOCK_BYTES", size)
        blocks = [
            block.to_pybytes()
            for block in line_blocks(io.BytesIO(content), encoding, skip=skip, tabbed=False)
        ]
    # what is no UTF-16 is handed on byte for byte
    told = "latin-1" if encoding == "latin-1" else "utf-8"
    arrived = [row for block in blocks for row in block.decode(told).splitlines() if row]
    assert arrived == [row for row in rows[skip:] if row]


def test_blanks_within_a_line_become_one_tab():
    blocks = line_blocks(io.BytesIO(b"a b\n 1 \t 2 \n3   4"), "utf-8", skip=1, tabbed=True)
    assert [block.to_pybytes() for block in blocks] == [b"1\t2\n3\t4"]


def test_what_never_ends_a_line_is_not_held_whole(monkeypatch):
    monkeypatch.setattr(lines, "BLOCK_BYTES", 100)
    blocks = list(line_blocks(io.BytesIO(b"1" * 10_000), "utf-8", skip=0, tabbed=False))
    assert max(block.size for block in blocks) <= 200
    assert b"".join(block.to_pybytes() for block in blocks) == b"1" * 10_000


@pytest.mark.parametrize(("encoding", "delimiter"), [("utf-8", "comma"), ("utf-16", "whitespace")])
def test_only_the_caller_s_thread_reads_the_file(tmp_path, monkeypatch, encoding, delimiter):
    """Else, a file refused, a thread of pyarrow's may hold the stream when the process ends."""
    mark = {"comma": ",", "whitespace": " "}[delimiter]
    rows = [mark.join("abc")] + [mark.join("123")] * 4000
    rows[9] = mark.join("12x")
    path = tmp_path / "recording.csv"
    path.write_bytes("\n".join(rows).encode(encoding))
    readers = set()

    class Told(io.BytesIO):
        def read(self, size=-1):
            readers.add(threading.get_ident())
            return super().read(size)

        read1 = read

    monkeypatch.setattr(lines, "BLOCK_BYTES", 1024)
    monkeypatch.setattr(text, "open_stream", lambda path: Told(path.read_bytes()))
    table = open_text(path, Layout(header=True, delimiter=delimiter, encoding=encoding))
    with pytest.raises(RecordingError, match="'x' is no number") as caught:
        list(table.batches([0, 1, 2]))
    assert "line 10, column c" in str(caught.value.where)
    assert readers == {threading.get_ident()}


def test_blocks_are_in_memory_of_pyarrow_s_own():
    before = pa.total_allocated_bytes()
    (block,) = line_blocks(io.BytesIO(b"1,2\n" * 1000), "utf-8", skip=0, tabbed=False)
    assert pa.total_allocated_bytes() - before >= block.size == 4000

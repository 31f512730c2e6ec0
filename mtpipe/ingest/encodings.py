"""The encoding of a text file: by its byte-order mark, else UTF-8, else tried.

Single-byte encodings cannot be told from one another for certain. The one is taken that shows the
names the setup asks for, else the first that knows every byte; it is named in a notice.
"""

from __future__ import annotations

import codecs
from collections.abc import Callable

MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# In the order of how often they are met: Windows, old Macs, DOS, Cyrillic, East Asia.
TRIED = (
    "cp1252", "mac_roman", "cp437", "cp850", "cp1251", "koi8_r", "cp932", "gb18030", "cp949",
    "big5", "latin-1",
)  # fmt: skip
# Text of Latin letters in UTF-16 has a zero in nearly every second byte.
ZEROS_SHARE = 0.4


def marked_encoding(head: bytes) -> str | None:
    """UTF-8, UTF-16 or UTF-32 if the file begins with its mark, or by its zeros."""
    for mark, encoding in MARKS:
        if head.startswith(mark):
            return encoding
    zeros = [head[k::4].count(0) > 2 * ZEROS_SHARE * (len(head) // 4) for k in range(4)]
    if zeros in ([False, True, True, True], [True, True, True, False]):
        return "utf-32-be" if zeros[0] else "utf-32-le"
    pairs = len(head) // 2
    even, odd = head[0::2].count(0), head[1::2].count(0)
    if pairs and odd > 2 * ZEROS_SHARE * pairs and even < pairs // 10:
        return "utf-16-le"
    if pairs and even > 2 * ZEROS_SHARE * pairs and odd < pairs // 10:
        return "utf-16-be"
    return None


def encoding_of(head: bytes, found: Callable[[str], int]) -> tuple[str, str]:
    """The encoding of text that begins with these bytes, and what is to be said of it.

    Parameters
    ----------
    found : how many of the names that the setup asks for are in a text.
    """
    marked = marked_encoding(head)
    if marked is not None:
        return marked, "" if marked == "utf-8-sig" else f"the text is taken for {marked}"
    if _decoded(head, "utf-8") is not None:
        return "utf-8", ""
    texts = {one: text for one in TRIED if (text := _decoded(head, one)) is not None}
    best = max(texts, key=lambda one: found(texts[one]))  # of equals the first
    return best, f'the text is no UTF-8 and is taken for {best} (encoding = "..." says another)'


def _decoded(head: bytes, encoding: str) -> str | None:
    """The text, of which the last sign may be cut off; None where bytes have no meaning in it."""
    decoder = codecs.getincrementaldecoder(encoding)("strict")
    try:
        text = decoder.decode(head)
    except UnicodeDecodeError:
        return None
    # C1 control characters are in no text, but in Latin-1 for what Windows has as letters
    return None if encoding != "latin-1" and any("\x80" <= c < "\xa0" for c in text) else text

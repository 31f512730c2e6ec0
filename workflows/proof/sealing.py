"""Sealed answers: the hash of each is published before anything is diagnosed.

An answer holds a random salt, so that its hash cannot be found by trying out what it may say.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any


class BrokenSealError(Exception):
    """An answer that is not the one that was sealed."""


def text_of(answer: dict[str, Any]) -> str:
    """An answer as it is written."""
    return json.dumps(answer, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


def seal(answer: dict[str, Any]) -> str:
    """SHA-256 of an answer as it is written."""
    return hashlib.sha256(text_of(answer).encode()).hexdigest()


def unsealed(path: Path, digest: str) -> dict[str, Any]:
    """An answer that is what was sealed.

    Raises
    ------
    BrokenSealError : it is not.
    """
    content = path.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise BrokenSealError(f"{path.name} is not the answer that was sealed")
    found: dict[str, Any] = json.loads(content)
    return found

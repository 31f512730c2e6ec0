"""Write the bundled recordings anew: `python workflows/sample_data/make.py [FOLDER]`.

The folder is the checkout's `sample_data/` by default. The simulated ones come from fixed seeds;
those of the challenge set are copied when `../shared/challenge` is beside the checkout.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path
from typing import Any

import challenge_cases
import laboratory_text
import several_beads

CHECKOUT = Path(__file__).resolve().parents[2]
CHALLENGE = CHECKOUT.parent / "shared" / "challenge"


def main(folder: Path) -> None:
    """Write every recording that can be made here."""
    contents = {
        "several_beads": several_beads.files(),
        "laboratory_text": laboratory_text.files(),
    }
    if CHALLENGE.is_dir():
        for name, case in challenge_cases.CASES.items():
            contents[name] = challenge_cases.files(CHALLENGE, case)
    else:
        print(f"{CHALLENGE} is not there: the clean cases stay as they are")
    for name, files in contents.items():
        for file, content in files.items():
            path = folder / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(_packed(file, content))


def _packed(name: str, content: bytes | dict[str, Any]) -> bytes:
    if isinstance(content, dict):
        return (json.dumps(content, indent=1) + "\n").encode()
    if name.endswith(".gz") and not content.startswith(b"\x1f\x8b"):
        return gzip.compress(content, 9, mtime=0)
    return content


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "sample_data")

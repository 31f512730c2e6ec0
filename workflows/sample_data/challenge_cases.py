"""`clean_*`: two clean cases of the challenge set, where that is beside the checkout.

They come from a brute-force simulator that shares no code and no closed form with mtpipe.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

CHAIN = "marko-siggia"  # the formula of that simulator's potential
CASES = {"clean_short_tether": "rec_296fe416", "clean_long_tether": "rec_6cf4a54e"}


def files(challenge: Path, case: str) -> dict[str, bytes | dict[str, Any]]:
    """Content of the folder of one case: its own files as bytes, truth as a dictionary."""
    answers = json.loads((challenge / "answers.json").read_text(encoding="utf-8"))["cases"]
    answer = next(one for one in answers if one["name"] == case)
    folder = challenge / "cases" / case
    origin = f"# Case {case} of the challenge set: an independent brute-force simulator, clean.\n"
    return {
        "setup.toml": origin.encode() + (folder / "setup.toml").read_bytes(),
        "recording.csv.gz": (folder / "recording.csv.gz").read_bytes(),
        "truth.json": {answer["bead"]: _truth(answer)},
    }


def _truth(answer: dict[str, Any]) -> dict[str, Any]:
    plateaus, world = answer["plateaus"], answer["world"]
    return {
        "what": "one tether",
        "contour_length_nm": world["contour_nm"],
        "persistence_length_nm": world["persistence_nm"],
        "chain": CHAIN,
        "force_pN": [p["force_pN"] for p in plateaus],
        "extension_nm": [p["extension_nm"] for p in plateaus],
        "friction_pN_s_per_nm": [p["friction_xy_pN_s_per_nm"] for p in plateaus],
        "friction_z_pN_s_per_nm": [p["friction_z_pN_s_per_nm"] for p in plateaus],
    }

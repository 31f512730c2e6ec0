"""What testing the plateaus of real recordings finds: lags of the log, hidden steps.

    python workflows/plateaus/real.py

Reads ../shared/recordings beside the checkout (its README says what they are) and prints what is
said of the magnets' log, of steps that it does not show, and of beads that change alone.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import mtpipe
from mtpipe.states import with_states

CHECKOUT = Path(__file__).parents[2]
SETUP = CHECKOUT / "tests" / "data" / "real_setups" / "cmaddry-run2.toml"
# Of each recording what its setup has in place of cmaddry-run2's (recordings/README.md).
RECORDINGS = {
    "cmaddry-run1": {"touch_rows = [239516, 253575]": "touch_rows = [104601, 109100]"},
    "cmaddry-run2": {},
}
TOLD = ("magnet_log_lag", "hidden_step", "height_step")


def main() -> None:
    """Print what is found in each recording."""
    parser = argparse.ArgumentParser(description="Plateaus of real recordings.")
    parser.add_argument(
        "--recordings", type=Path, default=CHECKOUT.parent / "shared" / "recordings"
    )
    choice = parser.parse_args()
    if not choice.recordings.is_dir():
        parser.exit(1, f"{choice.recordings} is not there: the recordings are no part of mtpipe.\n")
    warnings.simplefilter("ignore")
    for name, changes in RECORDINGS.items():
        for line in found_in(choice.recordings / name, changes):
            print(line, flush=True)


def found_in(folder: Path, changes: dict[str, str]) -> list[str]:
    """What is said of one recording, and how often the rest."""
    text = SETUP.read_text(encoding="utf-8")
    for before, after in changes.items():
        text = text.replace(before, after)
    with tempfile.TemporaryDirectory() as scratch:
        setup = Path(scratch) / "setup.toml"
        setup.write_text(text, encoding="utf-8")
        raw = mtpipe.load(folder, setup)
    recording = mtpipe.subtract_drift(raw)
    tested = with_states(recording)
    notices = tested.notices[len(recording.notices) :]
    counted = Counter(notice.code for notice in notices)
    return [
        f"{folder.name}: {len(recording.plateaus)} plateaus by the log, {len(tested.plateaus)} "
        f"after the test; {dict(counted)}",
        *(f"  {notice.code}: {notice.message}" for notice in notices if notice.code in TOLD),
    ]


if __name__ == "__main__":
    main()

"""Write `sample_data/concealed/` anew: `python workflows/proof/sample.py [FOLDER]`.

Six short recordings of the proof's kind: one clean, three with an effect, one with two, one with
what no name describes. What each conceals is in `answers/`, the hashes of the answers in
`sealed.json`; `proof.py` makes larger sets of the same.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import generate
from generate import Form
from plan import Task

FOLDER = Path(__file__).resolve().parents[2] / "sample_data" / "concealed"
SEED = 20261121
FORM = Form(frames=1536, plateaus=4, digits=1)
TASKS = (
    Task("single", ("exposure",), "clear"),
    Task("outside", ("crosstalk",)),
    Task("single", ("wall_drag",), "clear"),
    Task("clean"),
    Task("pair", ("viscosity", "vibration"), "clear"),
    Task("single", ("reference_noise",), "moderate"),
)


def main(folder: Path) -> None:
    """Write recordings, answers and seals."""
    sealed = {}
    for number, task in enumerate(TASKS):
        case = generate.make(SEED, number, FORM, task)
        sealed[case.name] = generate.write(case, folder / "recordings", folder / "answers")
    (folder / "sealed.json").write_text(json.dumps(sealed, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)

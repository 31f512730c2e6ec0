"""One short answer for each of the other recordings that carry traces."""

from __future__ import annotations

import math
import tempfile
from collections import Counter
from pathlib import Path

from mtpipe import pipeline
from mtpipe.errors import MtpipeError

# recording (file, or folder with the file that the setup names), setup
OTHERS = (
    ("softmatterlab-water", "softmatterlab-water"),
    ("vbtpm/bead1_cal.mat", "vbtpm"),
    ("vbtpm/bead1_trj.mat", "vbtpm"),
    ("vbtpm/bead2_cal.mat", "vbtpm"),
    ("vbtpm/bead2_trj.mat", "vbtpm"),
    ("picotwist", "picotwist"),
    ("picotwist/grfile.gr", "picotwist-gr"),
    ("vannoort-stacks", "vannoort-tdms"),
    ("vannoort-stacks", "vannoort-hdf"),
)


def answers(recordings: Path, setups: Path) -> list[str]:
    """mtpipe's answer to every recording, a few lines each."""
    lines = []
    for where, setup in OTHERS:
        with tempfile.TemporaryDirectory() as folder:
            try:
                run = pipeline.run(
                    recordings / where, Path(folder), setup=setups / f"{setup}.toml", workers=1
                )
                lines += [f"{where} ({setup})", *_of_run(run)]
            except MtpipeError as error:
                lines += [f"{where} ({setup})", f"   refused on reading: {error}"]
    return lines


def _of_run(run: pipeline.Run) -> list[str]:
    lines = []
    if len(run.verdicts) > 1:
        found = Counter(verdict.verdict for verdict in run.verdicts)
        lines.append("   " + ", ".join(f"{n} beads {verdict}" for verdict, n in found.items()))
        reasons = Counter(reason for verdict in run.verdicts for reason in verdict.reasons)
        return lines + [f"   {n} x {reason}" for reason, n in reasons.most_common(4)]
    (verdict,) = run.verdicts
    lines.append(f"   {verdict.verdict}: {'; '.join(verdict.reasons)}")
    for plateau in run.calibration.beads[0].plateaus:
        for one in plateau.axes:
            if one.axis == "z" or one.estimates is None:
                continue
            k, noise = one.estimates.stiffness, one.estimates.noise.value
            radius = one.effective_radius.value if one.effective_radius else math.nan
            lines.append(
                f"   {one.axis}: stiffness {k.value:.4g} ± {k.stderr:.1g} pN/nm, "
                f"noise {noise:.3g} nm, effective radius {radius:.4g} nm"
            )
    return lines

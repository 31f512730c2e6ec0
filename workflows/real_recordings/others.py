"""One short answer for each of the other recordings that carry traces."""

from __future__ import annotations

import math
import statistics
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

from mtpipe.calibration.bead_results import AxisResult, BeadResult
from mtpipe.fit.trace import TraceFit, fit_model
from mtpipe.ground.errors import MtpipeError
from mtpipe.pipeline import run as pipeline

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

# Where the setup knows no exposure mtpipe assumes a whole frame.
SHARES_OF_EXPOSURE = (1.0, 0.9, 0.75, 0.5)


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
    refused = {} if run.checked is None else run.checked.refused
    reasons = Counter(reason.replace(bead, "…") for bead, reason in refused.items())
    compared = [
        f"   {n} x not compared with simulations: {reason}" for reason, n in reasons.items()
    ]
    if len(run.verdicts) > 1:
        return [*_of_many(run), *compared]
    (verdict,) = run.verdicts
    lines = [f"   {verdict.verdict}: {'; '.join(verdict.reasons)}", *compared]
    for one in _lateral(run.calibration.beads[0]):
        if one.estimates is None:
            continue
        k, noise = one.estimates.stiffness, one.estimates.noise.value
        radius = one.effective_radius.value if one.effective_radius else math.nan
        lines.append(
            f"   {one.axis}: stiffness {k.value:.4g} ± {k.stderr:.1g} pN/nm, "
            f"noise {noise:.3g} nm, effective radius {radius:.4g} nm"
        )
        if one.free is not None:
            lines += _exposures(one.free)
    return lines


def _of_many(run: pipeline.Run) -> list[str]:
    """Verdicts and reasons counted, and the range of what was measured."""
    found = Counter(verdict.verdict for verdict in run.verdicts)
    lines = ["   " + ", ".join(f"{n} beads {verdict}" for verdict, n in found.items())]
    reasons = Counter(reason for verdict in run.verdicts for reason in verdict.reasons)
    lines += [f"   {n} x {reason}" for reason, n in reasons.most_common(4)]
    told = [
        one.estimates.stiffness
        for bead in run.calibration.beads
        for one in _lateral(bead)
        if one.estimates is not None and one.estimates.stiffness.status == "ok"
    ]
    if told:
        values = sorted(k.value for k in told)
        errors = sorted(k.stderr / k.value for k in told)
        lines.append(
            f"   stiffness of {len(told)} traces: {values[0]:.2g} to {values[-1]:.2g} pN/nm, "
            f"relative errors {errors[0]:.2f} to {errors[-1]:.2f}, half of them to "
            f"{statistics.median(errors):.2f}"
        )
    return lines


def _exposures(free: TraceFit) -> list[str]:
    """Stiffness without any model of blur and noise, and under other exposures."""
    model = free.model
    plain = model.thermal_energy_pN_nm / model.spectrum.variance_nm2
    fits = [
        fit_model(replace(model, exposure_s=share * model.exposure_s))
        for share in SHARES_OF_EXPOSURE
    ]
    best = min(fit.deviance for fit in fits)
    return [f"      kT over the variance: {plain:.4g} pN/nm"] + [
        f"      exposure times {share:g}: stiffness {fit.stiffness.value:.4g} pN/nm, "
        f"noise {fit.noise.value:.3g} nm, {(fit.deviance - best) / 2:.1f} nats worse than the best"
        for share, fit in zip(SHARES_OF_EXPOSURE, fits, strict=True)
    ]


def _lateral(bead: BeadResult) -> list[AxisResult]:
    return [one for plateau in bead.plateaus for one in plateau.axes if one.axis != "z"]

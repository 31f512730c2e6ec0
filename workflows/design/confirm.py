"""Errors that `mtpipe design` predicts, beside those found with simulated recordings.

    python workflows/design/confirm.py [--repeats N] [--seed N] [--write docs/design.md]

Each repeat simulates x, y and z of one bead at every force, draws what the analyst believes
(friction, tracking noise) from the uncertainty that the design states, and fits with every method.
An error is relative to the true force; found errors have a standard error from their number.
"""

from __future__ import annotations

import argparse
import datetime
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import mtpipe
from mtpipe.design.likelihood import companions, empty_series
from mtpipe.design.methods import ACROSS, ALONG, BOTH, METHODS
from mtpipe.design.motion import axis_motion
from mtpipe.design.plan import Plan, plan_of
from mtpipe.fit.model import TraceModel
from mtpipe.fit.series import fit_series
from mtpipe.fit.trace import fit_positions
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.methods import fit_by_method
from mtpipe.physics.tethered_bead import lever_nm
from mtpipe.setup.setup import read_setup
from mtpipe.simulation.linear import simulate_motion

HERE = Path(__file__).parent
COLUMNS = (
    "force (pN)",
    "method",
    "axis",
    "fits",
    "bias: predicted",
    "found",
    "rms: predicted",
    "found",
)
# A force that is off by more than this factor is counted as no result.
LOST = 3.0


@dataclass(frozen=True)
class Confirmation:
    """One method at one force: relative errors predicted, and those found.

    `errors` : (fits,) of the repeats that gave a force.
    """

    force_pN: float
    method: str
    axis: str
    bias: float
    rms: float
    errors: FloatArray

    @property
    def found_bias(self) -> tuple[float, float]:
        """Median of the errors, and its standard error, were they Gaussian."""
        return float(np.median(self.errors)), 1.25 * self.scatter / math.sqrt(len(self.errors))

    @property
    def found_rms(self) -> tuple[float, float]:
        """Median and scatter together, and their standard error, were the errors Gaussian."""
        rms = math.hypot(float(np.median(self.errors)), self.scatter)
        return rms, self.scatter * math.sqrt(1.3 / len(self.errors))

    @property
    def scatter(self) -> float:
        """Half the width of the central 68 % of the errors: tails do not count."""
        low, high = np.quantile(self.errors, [0.1587, 0.8413])
        return float(high - low) / 2


@dataclass(frozen=True)
class Belief:
    """What one analyst takes for true: a part of the friction and of the noise."""

    friction: float
    noise: float


def confirm(
    plan: Plan, forces_pN: Sequence[float], repeats: int, seed: int, methods: Sequence[str]
) -> list[Confirmation]:
    """Predicted and found errors of each method on each of its axes at each force."""
    found: dict[tuple[float, str, str], list[float]] = {}
    for force in forces_pN:
        random = np.random.default_rng([seed, round(1e6 * force)])
        for _ in range(repeats):
            factor = plan.knowledge.noise_factor
            belief = Belief(
                math.exp(plan.knowledge.friction * random.normal()),
                math.exp(math.log(factor or 1.0) * random.normal()),
            )
            trace = recorded(plan, force, random)
            for name in methods:
                for axis in METHODS[name].axes:
                    one = (
                        series_force(plan, force, trace, random)
                        if axis == BOTH
                        else force_of(plan, force, trace, name, axis, belief)
                    )
                    found.setdefault((force, name, axis), []).append(one / force - 1)
    out = []
    for (force, name, axis), errors in found.items():
        predicted = METHODS[name].error(plan, force, axis)
        good = np.array([e for e in errors if 1 / LOST < e + 1 < LOST])
        out.append(Confirmation(force, name, axis, predicted.shift, predicted.total, good))
    return out


def recorded(plan: Plan, force_pN: float, random: np.random.Generator) -> FloatArray:
    """(frames, 3) positions of the bead as tracked."""
    motion = simulate_motion([(plan.state(force_pN), plan.frames)], plan.experiment.camera, random)
    return motion + np.array(plan.experiment.tracker.noise_nm) * random.normal(size=motion.shape)


def force_of(
    plan: Plan, force_pN: float, trace: FloatArray, method: str, axis: str, belief: Belief
) -> float:
    """Force by one trace; inf where the method gives none."""
    experiment, knowledge = plan.experiment, plan.knowledge
    number = experiment.along if axis == ALONG else 1 - experiment.along
    motion = axis_motion(plan, force_pN, number)
    expected = belief.friction * motion.friction
    friction = (expected, knowledge.friction * expected)
    noise_nm = belief.noise * experiment.tracker.noise_nm[number]
    known = knowledge.noise_factor is not None
    x = trace[:, number]
    if method.startswith("friction"):
        model = partial(
            TraceModel,
            exposure_s=experiment.camera.exposure_s,
            thermal_energy_pN_nm=experiment.fluid.thermal_energy_pN_nm,
            noise_variance_nm2=None if noise_nm else 0.0,
            noise_prior_nm=(noise_nm, knowledge.noise_factor) if noise_nm and known else None,
            friction=friction if method == "friction known" else None,
            modes=motion.modes,
        )
        fit = fit_positions(x, experiment.camera.frame_s, model)
    else:
        fit = fit_by_method(
            method,
            x,
            frame_rate_hz=1 / experiment.camera.frame_s,
            exposure_s=experiment.camera.exposure_s,
            temperature_K=experiment.fluid.temperature_K,
            tracking_noise_nm=noise_nm if known else 0.0,
            friction=friction if method == "equipartition" else None,
        )
    if fit.stiffness.value is None:
        return math.inf
    along = axis != ACROSS
    lever = float(lever_nm(trace[:, 2].mean(), experiment.bead.radius_nm, along=along))
    return fit.stiffness.value * lever


def series_force(
    plan: Plan, force_pN: float, trace: FloatArray, random: np.random.Generator
) -> float:
    """Force by the joint fit of this plateau and its companions.

    The analyst's beliefs are scattered by the uncertainties that the fit is told.
    """
    experiment, knowledge = plan.experiment, plan.knowledge
    forces = (force_pN, *companions(plan))
    recordings = [trace, *(recorded(plan, force, random) for force in forces[1:])]
    empty, _ = empty_series(plan, force_pN)
    traces = []
    for one in empty.traces:
        positions = recordings[one.plateau]
        fit = fit_positions(
            positions[:, one.axis],
            experiment.camera.frame_s,
            lambda spectrum, of=one: replace(of.model, spectrum=spectrum),
        )
        model = replace(one.model, spectrum=fit.spectrum)
        traces.append(replace(one, extension_nm=float(positions[:, 2].mean()), model=model))
    factor = knowledge.noise_factor or 1.0
    noise = tuple(
        None if prior is None else (prior[0] * factor ** random.normal(), factor)
        for prior in empty.bead.noise_nm
    )
    ln_stderr = empty.bead.friction_ln_stderr
    bead = replace(
        empty.bead,
        noise_nm=noise,
        viscosity_mPa_s=empty.bead.viscosity_mPa_s * math.exp(ln_stderr * random.normal()),
        radius_nm=(
            empty.bead.radius_nm[0] * (1 + knowledge.radius * random.normal()),
            empty.bead.radius_nm[1],
        ),
    )
    try:
        result = fit_series(replace(empty, traces=tuple(traces), bead=bead))
    except FitError:
        return math.inf
    return math.exp(result.theta[0]) if result.converged else math.inf


def rows(results: Sequence[Confirmation], repeats: int) -> list[str]:
    """A Markdown table."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "| --- " * len(COLUMNS) + "|"]
    for r in results:
        cells = [
            f"{r.force_pN:g}",
            METHODS[r.method].words,
            r.axis,
            f"{len(r.errors)} of {repeats}",
        ]
        if len(r.errors) < repeats / 2:
            found = ("-", "-")
        else:
            (bias, of_bias), (rms, of_rms) = r.found_bias, r.found_rms
            found = (f"{bias:+.1%} ± {of_bias:.1%}", f"{rms:.1%} ± {of_rms:.1%}")
        predicted = ("none", "none") if math.isinf(r.rms) else (f"{r.bias:+.1%}", f"{r.rms:.1%}")
        cells += [predicted[0], found[0], predicted[1], found[1]]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    """Print the table, or put it into a page between its marks."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--setup", type=Path, default=HERE / "small_bead.toml")
    parser.add_argument("--forces", default="0.06,0.3,1.2,5,9,15,30,45")
    parser.add_argument("--repeats", type=int, default=60)
    parser.add_argument("--frames", type=int, default=16_384)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--write", type=Path)
    given = parser.parse_args()
    plan, _ = plan_of(read_setup(given.setup), given.frames)
    forces = [float(word) for word in given.forces.split(",")]
    results = confirm(plan, forces, given.repeats, given.seed, tuple(METHODS))
    command = (
        f"python workflows/design/confirm.py --repeats {given.repeats} --frames {given.frames} "
        f"--seed {given.seed} --forces {given.forces}"
    )
    head = [
        f"Printed {datetime.date.today()} by mtpipe {mtpipe.__version__} with",
        "",
        f"    {command}",
        "",
    ]
    text = "\n".join([*head, *rows(results, given.repeats)])
    print(text)
    if given.write is not None:
        page = given.write.read_text(encoding="utf-8")
        marks = re.compile(r"(<!-- confirmation -->\n).*?(<!-- end -->)", re.DOTALL)
        given.write.write_text(marks.sub(rf"\g<1>{text}\n\g<2>", page), encoding="utf-8")


if __name__ == "__main__":
    main()

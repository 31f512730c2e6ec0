"""Simulated recordings whose magnet log lies, or does not: what becomes of their plateaus.

    python workflows/plateaus/study.py --count 200

Each recording is drawn: beads, tether, frame rate, forces, dwells, moves, noise; then its log is
spoiled: late or early by 0.2 to 15 s, on another clock, wrong at its first move alone, silent about
a step of 5 to 40 %, or not at all. No calibration: final plateaus are compared with the true course
of the force. Prints how many plateaus that mix forces are left as sound, how many sound ones are
cut or refused, and lags beside their errors. Beside plateaus whose force is off, it says how many
are off by more than the force's own standard error. docs/plateaus.md has the figures.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from mtpipe.drift import subtract_drift
from mtpipe.experiment.description import Experiment, Rest, Stage
from mtpipe.ground.types import FloatArray
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Plateau, Recording
from mtpipe.setup.setup import Setup, parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.setup_experiment import stated_experiment
from mtpipe.simulation.simulate import simulate_experiment, timetable
from mtpipe.states import with_states
from mtpipe.states.blocks import relaxation_frames
from mtpipe.states.edges import edges_of
from mtpipe.states.lag import find_lag
from mtpipe.states.motion import middle, motion_of

KINDS = ("sound", "lag", "hidden", "clock", "first edge")
SHARES = (0.35, 0.27, 0.27, 0.055, 0.055)
# What "mixes forces by more than 5 %" means, in two ways: the force that the plateau's variance
# gives is off by that, or that share of its frames have a force that is off by that.
MIXED = 0.05
LONGEST_FRAMES = 90_000
PRINTED_EVERY = 20


@dataclass(frozen=True)
class Drawn:
    """A recording with a log that may lie, and the truth.

    `force_pN` (n_frames,) is the true course; `lag_s` the true lag (positive: the log is early),
    nan where there is not one; `step` the hidden relative step, 0 without.
    """

    kind: str
    recording: Recording
    force_pN: FloatArray
    lag_s: float
    step: float


@dataclass(frozen=True)
class Outcome:
    """What became of one recording's plateaus.

    Attributes
    ----------
    biased, mixed : plateaus that read ok and whose force is off by more than MIXED, or of which
        more than that share of frames have another force. beyond : those of `biased` that are off
        by more than the standard error of one bead's force. ok : plateaus that read ok.
    sound, harmed : logged plateaus of one force, and those of them that were cut or refused.
    lag_pull : error of the lag over its stated error; nan where there is none.
    """

    kind: str
    biased: int
    beyond: int
    mixed: int
    ok: int
    sound: int
    harmed: int
    lag_pull: float
    lag_error_s: float
    seconds: float
    told: str


def main() -> None:
    """Draw, test and print."""
    parser = argparse.ArgumentParser(description="Plateaus of recordings whose log lies.")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first recording")
    parser.add_argument(
        "--each", action="store_true", help="print each that fails, and figures now and then"
    )
    choice = parser.parse_args()
    outcomes = []
    for seed in range(choice.first, choice.first + choice.count):
        outcome = examined(drawn(seed))
        outcomes.append(outcome)
        if choice.each and len(outcomes) % PRINTED_EVERY == 0:
            print("\n".join(table(outcomes)), flush=True)
        if choice.each and (outcome.mixed or outcome.harmed):
            print(f"seed {seed}: {outcome}", flush=True)
    print("\n".join(table(outcomes)))


def drawn(seed: int) -> Drawn:
    """One recording with its log, from its seed."""
    random = np.random.default_rng([seed, 35])
    kind = str(random.choice(KINDS, p=SHARES))
    rate_hz = float(np.round(np.exp(random.uniform(np.log(60), np.log(1000)))))
    count = int(random.integers(4, 10))
    dwell_s = float(np.exp(random.uniform(np.log(6), np.log(45))))
    dwell_s = min(dwell_s, max(6.0, LONGEST_FRAMES / rate_hz / count))
    move_s = float(random.choice([0.0, 0.3, 1.0, 2.0]))
    forces = _forces(random, count)
    setup = _setup(random, rate_hz)
    dwells = dwell_s * random.uniform(0.8, 1.5, count)
    if random.random() < 0.4:
        dwells[:] = dwell_s
    noise = (float(random.uniform(1, 5)),) * 2 + (float(random.uniform(1, 8)),)
    beads = int(random.integers(1, 6))
    base, _ = stated_experiment(setup, forces.tolist(), 100, noise_nm=noise, beads=beads)
    # magnets fall off steadily: ln F is a straight line of their position
    positions = np.round(9.0 - 1.6 * np.log(forces / 0.1), 3)
    rests = [
        Rest(float(f), round(float(t) * rate_hz), float(p))
        for f, t, p in zip(forces, dwells, positions, strict=True)
    ]
    step, hidden = 0.0, -1
    if kind == "hidden":
        hidden = int(random.integers(0, count))
        step = float(np.exp(random.uniform(np.log(0.05), np.log(0.4)))) * random.choice([-1, 1])
        rests, hidden = _with_hidden(rests, hidden, step, float(random.uniform(0.15, 0.85)))
    drift = float(random.uniform(0.5, 4.0))
    experiment = replace(
        base,
        rests=tuple(rests),
        move_s=move_s,
        stage=Stage(random_nm_per_root_s=(drift, drift, drift)),
    )
    recording = simulate_experiment(experiment, setup, random)
    table = timetable(experiment)
    force = np.repeat(table.force_pN, np.diff(table.edges))
    number = np.repeat(table.rest, np.diff(table.edges))
    magnet, lag_s = _log(kind, random, experiment, table.magnet_mm, number, hidden, rate_hz)
    plateaus = find_plateaus(recording.time_s, magnet, setup.plateaus)
    return Drawn(kind, replace(recording, magnet_mm=magnet, plateaus=plateaus), force, lag_s, step)


def _forces(random: np.random.Generator, count: int) -> FloatArray:
    """A staircase up or down, or up and down, within 0.15 to 15 pN."""
    ratios = random.uniform(0.18, 0.9, count - 1)
    signs = np.ones(count - 1) if random.random() < 0.6 else random.choice([-1, 1], count - 1)
    logs = np.concatenate([[0.0], np.cumsum(ratios * signs)])
    room = np.log(15 / 0.15) - np.ptp(logs)
    if room < 0:
        logs, room = logs * np.log(15 / 0.15) / np.ptp(logs), 0.0
    forces = np.exp(np.log(0.15) + logs - logs.min() + random.uniform(0, room))
    return np.asarray(forces[::-1] if random.random() < 0.5 else forces)


def _setup(random: np.random.Generator, rate_hz: float) -> Setup:
    radius = float(random.choice([500.0, 1400.0]))
    contour = float(np.exp(random.uniform(np.log(700), np.log(5000))))
    return parse_setup(
        exact(
            {
                "schema": 1,
                "camera": {"frame_rate_hz": rate_hz, "exposure_s": 0.9 / rate_hz},
                "beads": {
                    "radius_nm": radius,
                    "reference": ["ref1", "ref2"][: random.integers(1, 3)],
                },
                "tether": {"contour_length_nm": contour, "persistence_length_nm": 50.0},
                "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
                "field": {"direction": "x"},
                "model": {"effects": ["wall_drag", "rotation_coupling", "tracking_noise"]},
            }
        )
    )


def _with_hidden(
    rests: list[Rest], place: int, step: float, share: float
) -> tuple[list[Rest], int]:
    """Rests of which one has a step that the log will not show, and the number of the new one."""
    rest = rests[place]
    first = replace(rest, frames=round(share * rest.frames * 2))
    # the dwell goes on: both parts together last twice as long, so that each may be a plateau
    second = replace(
        rest,
        frames=2 * rest.frames - first.frames,
        force_pN=rest.force_pN * (1 + step),
        magnet_mm=rest.magnet_mm - 1.6 * math.log1p(step),
    )
    return [*rests[:place], first, second, *rests[place + 1 :]], place + 1


def _log(
    kind: str,
    random: np.random.Generator,
    experiment: Experiment,
    magnet: FloatArray,
    number: NDArray[np.int64],
    hidden: int,
    rate_hz: float,
) -> tuple[FloatArray, float]:
    """The magnet column as it is written, and its lag in s."""
    rows = np.arange(len(magnet))
    if kind == "hidden":
        shown = experiment.rests[hidden - 1].magnet_mm
        first = int(np.flatnonzero(number == hidden - 1)[-1])
        last = int(np.flatnonzero(number == hidden)[-1])
        written = magnet.copy()
        written[first : last + 1] = shown
        return written, math.nan
    lag_s = float(np.exp(random.uniform(np.log(0.2), np.log(15.0)))) * random.choice([-1, 1])
    lag_s = float(np.clip(lag_s, -0.2 * len(rows) / rate_hz, 0.2 * len(rows) / rate_hz))
    if kind == "lag":
        return magnet[np.clip(rows + round(lag_s * rate_hz), 0, len(rows) - 1)], lag_s
    if kind == "clock":
        late = np.round(lag_s * rate_hz * rows / len(rows)).astype(int)
        return magnet[np.clip(rows + late, 0, len(rows) - 1)], math.nan
    if kind == "first edge":
        middle = int(np.flatnonzero(number == 1)[len(np.flatnonzero(number == 1)) // 2])
        most = 0.4 * min(np.sum(number == 0), np.sum(number == 1))
        late = round(float(np.clip(lag_s * rate_hz, -most, most)))
        written = magnet[np.clip(rows + late, 0, len(rows) - 1)]
        return np.where(rows < middle, written, magnet), math.nan
    return magnet, math.nan


def examined(case: Drawn) -> Outcome:
    """Test a recording's plateaus and hold them against the truth."""
    recording = subtract_drift(case.recording)
    began = time.process_time()
    tested = with_states(recording)
    seconds = time.process_time() - began
    assert tested.states is not None
    unusable = {*tested.states.refused, *tested.states.doubtful}
    left = [
        plateau
        for plateau in tested.plateaus
        if any((bead, plateau.number) not in unusable for bead in tested.tethered)
    ]
    final = [p for p in left if p.number not in tested.states.unbelieved]
    sound = [p for p in recording.plateaus if _spread(case, p) == 0]
    pull, error_s = math.nan, math.nan
    if math.isfinite(case.lag_s):
        motion = motion_of(recording)
        lag = find_lag(motion, edges_of(recording.plateaus, recording.magnet_mm))
        if lag is not None and lag.common_error > 0:
            error_s = lag.common * motion.frame_s - case.lag_s
            pull = error_s / (lag.common_error * motion.frame_s)
    codes = Counter(n.code for n in tested.notices[len(recording.notices) :])
    return Outcome(
        case.kind,
        sum(abs(_bias(case, p)) > MIXED for p in left),
        sum(abs(_bias(case, p)) > max(MIXED, _error(tested, p)) for p in left),
        sum(_spread(case, p) > MIXED for p in left),
        len(left),
        len(sound),
        sum(not _kept(p, final) for p in sound),
        pull,
        error_s,
        seconds,
        f"lag {case.lag_s:.2f} s, step {case.step:+.2f}, {len(recording.tethered)} beads, "
        f"{dict(codes)}, plateaus {[(p.start, p.stop) for p in left if _spread(case, p) > MIXED]}",
    )


def _kept(plateau: Plateau, final: Sequence[Plateau]) -> bool:
    """Whether one final plateau has all but a tenth of a logged one."""
    frames = plateau.stop - plateau.start
    common = [min(p.stop, plateau.stop) - max(p.start, plateau.start) for p in final]
    return max(common, default=0) >= 0.9 * frames


def _bias(case: Drawn, plateau: Plateau) -> float:
    """Relative error of the force from the variance of a plateau, against most of it."""
    force = case.force_pN[plateau.start : plateau.stop]
    return float(1 / np.mean(1 / force) / np.median(force) - 1)


def _error(recording: Recording, plateau: Plateau) -> float:
    """Relative standard error of one bead's force in a plateau, at best.

    A coordinate that relaxes within τ, of known friction, followed for a time T tells its stiffness
    with a relative variance of 2 τ / T at best (Cramér and Rao); x and y together have half of it.
    Of several beads the median.
    """
    errors = []
    for bead in recording.tethered:
        xyz = recording.trace_nm(bead, plateau)
        slow = [max(relaxation_frames(middle(column)), 1.0) for column in xyz.T[:2]]
        told = sum(len(xyz) / (2 * one) for one in slow)
        errors.append(told**-0.5)
    return float(np.median(errors))


def _spread(case: Drawn, plateau: Plateau) -> float:
    """Share of a plateau's frames whose force is off by more than MIXED from that of most."""
    force = case.force_pN[plateau.start : plateau.stop]
    return float(np.mean(np.abs(force / np.median(force) - 1) > MIXED))


def table(outcomes: list[Outcome]) -> list[str]:
    """Figures by kind and of all, with 95 % intervals (Clopper and Pearson)."""
    lines = [
        "kind | recordings | read ok | force off > 5 % | and > its standard error | "
        "> 5 % of frames off | sound | cut or refused"
    ]
    for kind in (*KINDS, "all"):
        ones = [one for one in outcomes if kind in ("all", one.kind)]
        total = {
            name: sum(getattr(one, name) for one in ones)
            for name in ("biased", "beyond", "mixed", "ok", "sound", "harmed")
        }
        lines.append(
            f"{kind} | {len(ones)} | {total['ok']} | {_counted(total['biased'], total['ok'])} | "
            f"{total['beyond']} | "
            f"{_counted(total['mixed'], total['ok'])} | {total['sound']} | "
            f"{_counted(total['harmed'], total['sound'])}"
        )
    pulls = np.array([one.lag_pull for one in outcomes if math.isfinite(one.lag_pull)])
    errors = np.array([one.lag_error_s for one in outcomes if math.isfinite(one.lag_error_s)])
    if len(pulls):
        within = int(np.sum(np.abs(pulls) < 1))
        lines += [
            f"lags: {len(pulls)}, median |error| {np.median(np.abs(errors)):.3f} s, largest "
            f"{np.max(np.abs(errors)):.2f} s; within one stated error {within} of {len(pulls)}, "
            f"within three {int(np.sum(np.abs(pulls) < 3))}"
        ]
    lines.append(f"seconds per recording: {np.mean([one.seconds for one in outcomes]):.2f}")
    return lines


def _counted(count: int, total: int) -> str:
    if total == 0:
        return "-"
    found = stats.binomtest(count, total).proportion_ci(0.95)
    return f"{count} ({100 * count / total:.1f} %, {100 * found.low:.1f} to {100 * found.high:.1f})"


if __name__ == "__main__":
    main()

"""Effects that no name of the catalogue describes: physics and faults the diagnosis never heard of.

Each has its size in physical units, relative to the bead's own motion or to what it changes, large
enough that a recording of a few thousand frames per plateau should show it, and says where it is.
They exist here only; a name of the catalogue given to one of them is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtpipe.experiment.changes import scaled_contour_length, scaled_viscosity
from mtpipe.experiment.description import Experiment
from mtpipe.ground.types import FloatArray
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup
from mtpipe.simulation.simulate import Engine, simulate_experiment

# Pieces in which something changes over a whole recording.
PIECES = 12
BEAD = "b1"


@dataclass(frozen=True)
class Scene:
    """What is to be simulated: the experiment, its setup, the engine, and the seed."""

    experiment: Experiment
    setup: Setup
    engine: Engine
    seed: int

    def played(self, experiment: Experiment | None = None) -> Recording:
        """The recording of an experiment; the same seed draws the same motion."""
        there = experiment or self.experiment
        return simulate_experiment(there, self.setup, self.seed, engine=self.engine)

    @property
    def frame_s(self) -> float:
        """Frame interval."""
        return self.experiment.camera.frame_s


@dataclass(frozen=True, eq=False)
class Outcome:
    """A recording with something in it, its size in numbers, and where it shows.

    Attributes
    ----------
    axes : names of axes, or of two together. plateaus : numbers, None: all or any.
    band_hz : None: no matter of frequency, or all of them.
    """

    recording: Recording
    told: dict[str, float]
    axes: tuple[str, ...]
    plateaus: tuple[int, ...] | None = None
    band_hz: tuple[float, float] | None = None


Effect = Callable[[Scene, np.random.Generator], Outcome]
EVERYWHERE = ("x", "y", "z", "xy", "xz", "yz", "")


def fouling(scene: Scene, random: np.random.Generator) -> Outcome:
    """Something grows on the bead: its friction rises while the recording lasts."""
    rise = random.uniform(0.4, 0.9)
    scene = replace(scene, engine="linear")
    raw = _changing(scene, lambda there, t: scaled_viscosity(there, math.log1p(rise * t)))
    late = tuple(range(len(raw.plateaus) // 2, len(raw.plateaus)))
    return Outcome(raw, {"relative_rise_of_friction": rise}, EVERYWHERE, late)


def shortening(scene: Scene, random: np.random.Generator) -> Outcome:
    """Proteins fold up the tether: from some time on it is shorter, and then stays so."""
    lost, begin = random.uniform(0.04, 0.12), random.uniform(0.35, 0.65)
    scene = replace(scene, engine="linear")
    shorter = math.log1p(-lost)
    raw = _changing(
        scene, lambda there, t: scaled_contour_length(there, shorter if t >= begin else 0.0)
    )
    after = tuple(p.number for p in raw.plateaus if p.stop > begin * len(raw.time_s))
    told = {"share_lost": lost, "at_share_of_time": begin}
    return Outcome(raw, told, ("z", "x", "y", ""), after)


def flicker(scene: Scene, random: np.random.Generator) -> Outcome:
    """The lamp flickers: the tracker's noise goes as 1/f, without a shortest or longest time."""
    raw = scene.played()
    share = random.uniform(0.6, 1.0)
    size = share * _spread(raw, np.median)
    xyz = raw.positions_nm[BEAD]
    pink = np.column_stack([_pink(len(xyz), random) for _ in range(3)])
    band = (0.0, 0.25 / scene.frame_s)
    return Outcome(
        _with(raw, xyz + size * pink), {"rms_nm": float(size[0])}, EVERYWHERE, None, band
    )


def knocks(scene: Scene, random: np.random.Generator) -> Outcome:
    """Doors and steps: the microscope rings for a moment, each time at another frequency."""
    raw = scene.played()
    xyz = raw.positions_nm[BEAD].copy()
    rows, time_s = len(xyz), scene.frame_s * np.arange(len(xyz))
    along = int(random.integers(2))
    size = random.uniform(2.0, 4.0) * float(_spread(raw, np.median)[along])
    count = max(round(random.uniform(0.05, 0.1) * time_s[-1]), 6)
    for start in random.integers(0, rows, size=count):
        ring_hz, decay_s = random.uniform(1.0, 8.0), random.uniform(0.1, 0.4)
        after = np.maximum(time_s - time_s[start], 0.0)
        ring = np.exp(-after / decay_s) * np.sin(2 * np.pi * ring_hz * after)
        xyz[:, along] += size * random.uniform(0.5, 1.5) * ring
    return Outcome(
        _with(raw, xyz), {"amplitude_nm": size, "number": count}, ("xy"[along],), None, (0.0, 16.0)
    )


def outliers(scene: Scene, random: np.random.Generator) -> Outcome:
    """The tracker is now and then a little wrong, by more than its noise and less than a bead."""
    raw = scene.played()
    xyz = raw.positions_nm[BEAD].copy()
    share = random.uniform(0.01, 0.03)
    hit = random.random(len(xyz)) < share
    size = random.uniform(2.0, 3.0) * _spread(raw, np.median)
    xyz[hit] += size * random.laplace(size=(int(hit.sum()), 3))
    told = {"share": share, "scale_x_nm": float(size[0])}
    return Outcome(_with(raw, xyz), told, EVERYWHERE)


def kink(scene: Scene, random: np.random.Generator) -> Outcome:
    """The look-up table of z has a kink: above some height its scale is another."""
    raw = scene.played()
    excess = random.uniform(0.06, 0.15) * float(random.choice([-1, 1]))
    xyz = raw.positions_nm[BEAD].copy()
    means = [float(np.nanmean(xyz[p.start : p.stop, 2])) for p in raw.plateaus]
    ordered = sorted(means)
    middle = len(ordered) // 2
    height = 0.5 * (ordered[middle - 1] + ordered[middle])
    xyz[:, 2] += excess * np.maximum(xyz[:, 2] - height, 0.0)
    above = tuple(i for i, mean in enumerate(means) if mean > height)
    told = {"excess_of_scale": excess, "from_nm": height}
    return Outcome(_with(raw, xyz), told, ("z",), above)


def crosstalk(scene: Scene, random: np.random.Generator) -> Outcome:
    """The optical axis is tilted: a share of z's motion appears in one lateral axis."""
    raw = scene.played()
    along = int(random.integers(2))
    share = random.uniform(0.6, 1.2) * float(random.choice([-1, 1]))
    xyz = raw.positions_nm[BEAD].copy()
    xyz[:, along] += share * (xyz[:, 2] - np.nanmean(xyz[:, 2]))
    name = "xy"[along]
    return Outcome(_with(raw, xyz), {"share": share}, (f"{name}z", name))


def smoothing(scene: Scene, random: np.random.Generator) -> Outcome:
    """The tracker's software smooths: it stores the mean of a frame and the two before it."""
    raw = scene.played()
    share = random.uniform(0.7, 1.0)
    xyz = raw.positions_nm[BEAD]
    before, last = np.roll(xyz, 1, axis=0), np.roll(xyz, 2, axis=0)
    smooth = (1 - share) * xyz + share * (xyz + before + last) / 3
    smooth[:2] = xyz[:2]
    return Outcome(_with(raw, smooth), {"share_of_the_mean_of_three": share}, EVERYWHERE)


def digits(scene: Scene, random: np.random.Generator) -> Outcome:
    """Positions were stored in coarse steps, coarser than the motion at the highest force."""
    raw = scene.played()
    step_nm = random.uniform(3.0, 5.0) * float(_spread(raw, np.min)[:2].min())
    xyz = raw.positions_nm[BEAD]
    stored = np.column_stack([step_nm * np.round(xyz[:, :2] / step_nm), xyz[:, 2]])
    return Outcome(_with(raw, stored), {"step_nm": step_nm}, ("x", "y", "xy"))


EFFECTS: dict[str, Effect] = {
    "fouling": fouling,
    "shortening": shortening,
    "flicker": flicker,
    "knocks": knocks,
    "outliers": outliers,
    "kink": kink,
    "crosstalk": crosstalk,
    "smoothing": smoothing,
    "digits": digits,
}


def _with(raw: Recording, xyz: FloatArray) -> Recording:
    return replace(raw, positions_nm=raw.positions_nm | {BEAD: xyz})


def _spread(raw: Recording, over: Any) -> FloatArray:
    """(3,) standard deviation within plateaus, the median or another choice among them."""
    xyz = raw.positions_nm[BEAD]
    return np.asarray(
        over([np.nanstd(xyz[plateau.start : plateau.stop], axis=0) for plateau in raw.plateaus], 0)
    )


def _changing(scene: Scene, change: Callable[[Experiment, float], Experiment]) -> Recording:
    """Pieces of recordings of a changing experiment, drawn alike so that they join.

    Parameters
    ----------
    change : the experiment at a share of the recording's time.
    """
    shares = (np.arange(PIECES) + 0.5) / PIECES
    each = [scene.played(change(scene.experiment, float(share))) for share in shares]
    rows = np.array_split(np.arange(len(each[0].time_s)), PIECES)
    joined = [one.positions_nm[BEAD][part] for one, part in zip(each, rows, strict=True)]
    return _with(each[0], np.concatenate(joined))


def _pink(rows: int, random: np.random.Generator) -> FloatArray:
    """(rows,) of noise whose power goes as 1/f, of variance 1."""
    spectrum = np.fft.rfft(random.normal(size=rows))
    spectrum[1:] /= np.sqrt(np.arange(1, len(spectrum)))
    spectrum[0] = 0.0
    pink = np.fft.irfft(spectrum, rows)
    return np.asarray(pink / pink.std())

"""A simulated recording: the same type as a laboratory's, and the truth it was made from.

Beads move about their anchors, the stage carries all of them, the tracker adds noise and loses
frames, the magnets rest and move. The same experiment and seed give the same recording. Every bead
draws from a stream of its own, so that more beads leave those that are there as they were.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mtpipe.experiment.changes import with_bead
from mtpipe.experiment.description import Experiment, changes_bead
from mtpipe.experiment.recorded_modes import BeadState, recorded_modes
from mtpipe.experiment.state import has_whole_motion, states_in
from mtpipe.ground.notice import Notice
from mtpipe.ground.progress import of_step
from mtpipe.ground.types import FloatArray, Progress
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import Setup
from mtpipe.setup.tables import ANHARMONIC, ROTATION
from mtpipe.simulation.linear import simulate_motion
from mtpipe.simulation.readout import force_pieces, height_within_pieces, recorded, reference_motion
from mtpipe.simulation.setup_experiment import stated_experiment

Engine = Literal["linear", "brownian"]
# Standard deviations of a spring's heights below their mean: fewer than one frame in a thousand.
OFF_SURFACE = 3.0
ENGINES: tuple[Engine, ...] = ("linear", "brownian")
# Beads stand well apart; where they stand has no influence.
SPACING_NM = 8000.0
# A move is cut into stretches of constant force no further apart than this in ln F.
MOVE_STEP_LN = 0.1


@dataclass(frozen=True, eq=False)
class Timetable:
    """What the magnets do, frame by frame.

    Attributes
    ----------
    magnet_mm : (frames,). edges : of the stretches of constant force, from 0 to all frames.
    force_pN : of each stretch. rest : of each stretch, number of its plateau, or -1 in a move.
    """

    magnet_mm: FloatArray
    edges: tuple[int, ...]
    force_pN: tuple[float, ...]
    rest: tuple[int, ...]

    def rows(self, plateau: int, frames: int) -> slice:
        """Rows of a plateau, given its number of frames."""
        start = self.edges[self.rest.index(plateau)]
        return slice(start, start + frames)


def simulate(
    setup: Setup,
    forces_pN: Sequence[float],
    frames: int = 16_384,
    seed: int | np.random.Generator = 0,
    *,
    beads: int = 1,
    noise_nm: tuple[float, float, float] | None = None,
    lost_share: float = 0.0,
    engine: Engine = "linear",
    progress: Progress | None = None,
) -> Recording:
    """Simulate a recording of the experiment that a setup describes.

    Parameters
    ----------
    setup : as `mtpipe.read_setup` gives it.
    forces_pN : force of each plateau, in time order.
    frames : per plateau.
    seed : the same seed gives the same recording.
    beads : tethered beads b1, b2, …; the reference beads are those the setup names.
    noise_nm : tracking noise along x, y, z; default: as `experiment_of` says.
    lost_share : of each bead's frames, lost by the tracker at random.
    engine : "linear": exact for the linear motion, see `mtpipe.simulation.linear`; "brownian": step
        by step with all that is not linear, see `mtpipe.simulation.brownian`, far slower.
    progress : called with (beads done, of how many); default: a bar in a notebook.

    Returns
    -------
    Recording, raw: stage and reference beads are in it. What was assumed is in its notices.

    Raises
    ------
    SetupError : the setup does not state what a simulation needs, or an argument cannot be.
    FitError : a force does not hold the bead off the surface.
    """
    experiment, notices = stated_experiment(
        setup,
        forces_pN,
        frames,
        noise_nm=noise_nm,
        beads=beads,
        lost_share=lost_share,
    )
    say = of_step(progress, "simulating beads")
    return simulate_experiment(
        experiment,
        setup,
        seed,
        engine=engine,
        notices=notices,
        progress=say,
    )


def simulate_experiment(
    experiment: Experiment,
    setup: Setup,
    seed: int | np.random.Generator,
    *,
    engine: Engine = "linear",
    notices: tuple[Notice, ...] = (),
    progress: Progress | None = None,
) -> Recording:
    """Simulate a described experiment; the setup says what its analyst believes.

    Raises
    ------
    FitError : a force does not hold the bead off the surface.
    """
    references = setup.beads.reference[: experiment.references]
    names = free_names(experiment.tethered, setup.beads.reference)
    streams = np.random.default_rng(seed).spawn(2 + len(references) + len(names))
    clock = streams.pop()
    table = timetable(experiment)
    frames = table.edges[-1]
    stage = stage_motion(experiment, frames, streams.pop(0))
    fixed: dict[str, FloatArray] = {}
    for i, name in enumerate(references):
        noise = experiment.tracker.reference_noise_nm
        random = streams.pop(0)
        own = reference_motion(experiment, frames, random) if i == 0 else 0.0
        fixed[name] = _tracked(stage + own, _place(-1 - i), noise, experiment, random)
    force_pN = np.repeat(table.force_pN, np.diff(table.edges))
    plateaus = [table.rows(i, rest.frames) for i, rest in enumerate(experiment.rests)]
    motion = _brownian(experiment, table) if engine == "brownian" else _linear(experiment, table)
    positions: dict[str, FloatArray] = {}
    for i, (name, random) in enumerate(zip(names, streams, strict=True)):
        if progress is not None:
            progress(i, len(names))
        seen = recorded(motion(random), force_pN, experiment, random, plateaus) + stage
        positions[name] = _tracked(seen, _place(i), (0.0, 0.0, 0.0), experiment, random)
    everything = positions | fixed
    if progress is not None:
        progress(len(names), len(names))
    rows = rows_in_file(table.edges[-1], experiment.clock.dropped_share, clock)
    frames = len(rows)
    time_s = np.asarray(experiment.camera.frame_s * np.arange(frames))
    return Recording(
        name="simulated",
        setup=setup,
        time_s=time_s,
        frame=np.arange(frames, dtype=np.int64),
        positions_nm={name: xyz[rows] for name, xyz in everything.items()},
        magnet_mm=table.magnet_mm[rows],
        plateaus=find_plateaus(time_s, table.magnet_mm[rows], setup.plateaus),
        notices=notices + _departures(experiment, engine),
    )


def _linear(
    experiment: Experiment, table: Timetable
) -> Callable[[np.random.Generator], FloatArray]:
    """Motion of one bead, (frames, 3), from a generator: mode by mode."""
    frames = np.diff(table.edges).tolist()
    # in a move the bead is as in the plateau that it leads to
    plateaus = [next(i for i in table.rest[k:] if i >= 0) for k in range(len(table.rest))]
    stretches = list(zip(states_in(experiment, table.force_pN, plateaus), frames, strict=True))
    within = np.zeros((table.edges[-1], 3))
    for i, rest in enumerate(experiment.rests):
        heights = height_within_pieces(experiment, i, rest.force_pN, rest.frames)
        within[table.rows(i, rest.frames), 2] = heights
    return lambda random: simulate_motion(stretches, experiment.camera, random) + within


def _brownian(
    experiment: Experiment, table: Timetable
) -> Callable[[np.random.Generator], FloatArray]:
    """The same step by step."""
    from mtpipe.simulation.bead import brownian_bead
    from mtpipe.simulation.brownian import simulate_bead

    forces = np.repeat(table.force_pN, np.diff(table.edges))
    bead = brownian_bead(with_bead(experiment, turns=True), forces)
    frames = table.edges[-1]
    return lambda random: simulate_bead(bead, experiment.camera, frames, random).position_nm


def rows_in_file(
    frames: int, dropped_share: float, random: np.random.Generator
) -> NDArray[np.int64]:
    """The camera's frames that the file has; it counts them as if none were missing."""
    every = np.arange(frames)
    return every if dropped_share <= 0 else every[random.random(frames) >= dropped_share]


def _departures(experiment: Experiment, engine: Engine) -> tuple[Notice, ...]:
    """What an engine does otherwise than the experiment says."""
    found = []
    if engine == "brownian" and experiment.fluid.memory > 0:
        said = "The step-by-step engine has no hydrodynamic memory, although the setup lists it."
        found.append(Notice("no_memory", "caution", said))
    if engine == "linear" and experiment.anharmonic and not has_whole_motion(experiment):
        said = (
            f"{ANHARMONIC} is not in the simulation: it is only simulated for a "
            f"bead that turns ({ROTATION}) and does not lean."
        )
        found.append(Notice("effects_not_simulated", "caution", said))
    if engine == "linear":
        found += _through_surface(experiment)
    if engine == "brownian" and any(changes_bead(step) for step in experiment.steps):
        said = "The step-by-step engine has a bead and a tether that stay as they are."
        found.append(Notice("no_course", "caution", said))
    if engine == "brownian" and not experiment.bead.turns:
        said = (
            "The step-by-step engine lets the bead turn about the field's axis, although the setup "
            f"does not list {ROTATION}."
        )
        found.append(Notice("turns_anyway", "info", said))
    return tuple(found)


def _through_surface(experiment: Experiment) -> list[Notice]:
    """Said of forces at which a bead on a spring would now and then be below the surface."""
    if experiment.anharmonic and has_whole_motion(experiment):
        return []
    forces = [rest.force_pN for rest in experiment.rests]
    low = [
        force
        for force, state in zip(
            forces, states_in(experiment, forces, range(len(forces))), strict=True
        )
        if state.extension_nm < OFF_SURFACE * math.sqrt(_height_variance_nm2(state))
    ]
    if not low:
        return []
    said = (
        f"At {', '.join(f'{force:g}' for force in low)} pN heights are those of a spring without a "
        f"surface, and the bead passes through it: list {ANHARMONIC}, or take the engine "
        "brownian."
    )
    return [Notice("through_surface", "caution", said)]


def _height_variance_nm2(state: BeadState) -> float:
    return float(recorded_modes(state).covariance_nm2[:, 2, 2].sum())


def free_names(count: int, taken: Sequence[str]) -> list[str]:
    """The first names b1, b2, … that no reference bead has."""
    candidates = (f"b{i}" for i in range(1, count + len(taken) + 1))
    return [name for name in candidates if name not in taken][:count]


def timetable(experiment: Experiment) -> Timetable:
    """Rests and moves of the magnets; in a move ln F and position change steadily."""
    rests = experiment.rests
    move = round(experiment.move_s / experiment.camera.frame_s)
    magnet: list[FloatArray] = []
    edges, forces, numbers = [0], [], []
    for i, rest in enumerate(rests):
        if i and move:
            before = rests[i - 1]
            magnet.append(np.linspace(before.magnet_mm, rest.magnet_mm, move + 2)[1:-1])
            ratio = math.log(rest.force_pN / before.force_pN)
            pieces = min(max(math.ceil(abs(ratio) / MOVE_STEP_LN), 1), move)
            for k, part in enumerate(np.array_split(np.arange(move), pieces)):
                edges.append(edges[-1] + len(part))
                forces.append(before.force_pN * math.exp(ratio * (k + 0.5) / pieces))
                numbers.append(-1)
        magnet.append(np.full(rest.frames, rest.magnet_mm))
        for change, frames in force_pieces(experiment, i, rest.frames):
            edges.append(edges[-1] + frames)
            forces.append(rest.force_pN * (1 + change))
            numbers.append(i)
    return Timetable(np.concatenate(magnet), tuple(edges), tuple(forces), tuple(numbers))


def stage_motion(experiment: Experiment, frames: int, random: np.random.Generator) -> FloatArray:
    """(frames, 3) motion of the stage in nm, from 0 at the first frame."""
    frame_s, stage = experiment.camera.frame_s, experiment.stage
    steps = math.sqrt(frame_s) * np.asarray(stage.random_nm_per_root_s) * random.normal(
        size=(frames, 3)
    ) + frame_s * np.asarray(stage.steady_nm_per_s)
    steps[0] = 0
    return np.asarray(np.cumsum(steps, axis=0))


def _place(number: int) -> FloatArray:
    return np.array([SPACING_NM * (number + 3), SPACING_NM * 2, 0.0])


def _tracked(
    motion_nm: FloatArray,
    place_nm: FloatArray,
    noise_nm: tuple[float, float, float],
    experiment: Experiment,
    random: np.random.Generator,
) -> FloatArray:
    seen = motion_nm + place_nm
    if any(noise_nm):
        seen = seen + np.asarray(noise_nm) * random.normal(size=motion_nm.shape)
    if experiment.tracker.lost_share:
        seen[random.random(len(seen)) < experiment.tracker.lost_share] = np.nan
    return seen

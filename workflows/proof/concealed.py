"""Effects of the catalogue as the proof conceals them: what the true experiment has, and how much.

Nothing here comes from `mtpipe.effects`, whose hypotheses are under test. Each effect is a family:
drawn once (which line, which direction, which course), then changed in size until it has the
strength that is wanted (`strength`). Ranges are those of PHYSICS section 3. What spectra do not
measure (sticking, pixel locking) has its size from a table instead, and is done to the traces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import spoiled_traces

from mtpipe.effects.hopping import Hopping
from mtpipe.effects.z_crosstalk import Crosstalk
from mtpipe.experiment import changes
from mtpipe.experiment.changes import with_step
from mtpipe.experiment.description import Experiment, ForceCourse, Line
from mtpipe.physics.camera import Camera
from mtpipe.recording.recording import Recording

Change = Callable[[Experiment, float], Experiment]
Spoil = Callable[[Recording, Experiment, float, np.random.Generator], Recording]


@dataclass(frozen=True)
class Family:
    """An effect in one form, of any size.

    Attributes
    ----------
    change : of the experiment, for a size. ends : smallest and largest size. unit : of the size.
    told : what else was drawn.
    axes : where it shows; plateaus, band_hz : and at which forces and frequencies, None: at all.
    """

    change: Change
    ends: tuple[float, float]
    unit: str = ""
    told: dict[str, Any] = field(default_factory=dict)
    axes: str = "xyz"
    plateaus: tuple[int, ...] | None = None
    band_hz: tuple[float, float] | None = None


@dataclass(frozen=True)
class Effect:
    """One name of FORMATS section 5.

    Attributes
    ----------
    family : drawn for an experiment; None where the effect has no size, because it is there or not.
    parameters : numbers that name it, for the penalty.
    kind : effects of one kind are not concealed together, as they cannot be told apart or are seen
        in different regimes.
    spoil, sizes : what is done to the raw recording, for a size; sizes by strength.
    regime : of the experiments in which it is concealed (`configurations.REGIMES`).
    """

    name: str
    kind: str
    parameters: int = 1
    family: Callable[[Experiment, np.random.Generator], Family] | None = None
    spoil: Spoil | None = None
    sizes: dict[str, tuple[float, float]] = field(default_factory=dict)
    unit: str = ""
    regime: str = "usual"


def _sign(random: np.random.Generator) -> float:
    return float(random.choice([-1.0, 1.0]))


def _factor(
    change: Change, ends: tuple[float, float]
) -> Callable[[Experiment, np.random.Generator], Family]:
    """A configured value that is too large or too small by a factor; the size is its ln."""

    def family(experiment: Experiment, random: np.random.Generator) -> Family:
        sign = _sign(random)
        return Family(
            lambda there, size: change(there, sign * size), ends, "|ln factor|", {"sign": sign}
        )

    return family


def _lateral_scale(experiment: Experiment, ln_factor: float) -> Experiment:
    return changes.with_optics(experiment, lateral_scale=math.exp(ln_factor))


def _axial_scale(experiment: Experiment, ln_factor: float) -> Experiment:
    return changes.with_optics(experiment, axial_scale=math.exp(ln_factor))


def _simple(
    change: Change, ends: tuple[float, float], unit: str, axes: str = "xyz"
) -> Callable[[Experiment, np.random.Generator], Family]:
    return lambda experiment, random: Family(change, ends, unit, axes=axes)


def _offset(experiment: Experiment, share: float) -> Experiment:
    return changes.with_bead(experiment, offset_nm=share * experiment.bead.radius_nm)


def _noise(experiment: Experiment, size_nm: float) -> Experiment:
    noise = (size_nm, size_nm, 1.5 * size_nm)
    return replace(
        experiment, tracker=replace(experiment.tracker, noise_nm=noise, reference_noise_nm=noise)
    )


def _exposure(experiment: Experiment, random: np.random.Generator) -> Family:
    frame_s, exposure_s = experiment.camera.frame_s, experiment.camera.exposure_s
    longest, shortest = math.log(frame_s / exposure_s), math.log(exposure_s / (0.1 * frame_s))
    sign = 1.0 if random.random() < longest / (longest + shortest) else -1.0
    most = longest if sign > 0 else shortest

    def change(there: Experiment, size: float) -> Experiment:
        camera = Camera(frame_s, min(exposure_s * math.exp(sign * size), frame_s))
        return replace(there, camera=camera)

    return Family(change, (min(0.01, 0.5 * most), min(most, 1.2)), "|ln factor|", {"sign": sign})


def _weights(random: np.random.Generator) -> np.ndarray[Any, Any]:
    return np.asarray(np.exp(0.3 * random.uniform(-1, 1, size=3)))


def _triple(values: np.ndarray[Any, Any]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _drift(experiment: Experiment, random: np.random.Generator) -> Family:
    weights = _weights(random)

    def change(there: Experiment, size: float) -> Experiment:
        return changes.with_stage(there, unsubtracted_nm_per_root_s=_triple(size * weights))

    return Family(change, (0.02, 30.0), "nm/√s", {"weights": weights.tolist()}, band_hz=(0, 2.0))


def _reference(experiment: Experiment, random: np.random.Generator) -> Family:
    weights, relaxation_s = _weights(random), math.exp(random.uniform(math.log(0.2), math.log(3.0)))

    def change(there: Experiment, size: float) -> Experiment:
        size_nm = _triple(size * weights)
        return changes.with_stage(there, reference_nm=size_nm, reference_s=relaxation_s)

    told = {"weights": weights.tolist(), "relaxation_s": relaxation_s}
    return Family(change, (0.1, 20.0), "nm", told, band_hz=(0, 3 / relaxation_s))


def _vibration(experiment: Experiment, random: np.random.Generator) -> Family:
    highest = 0.9 * experiment.camera.nyquist_hz
    line_hz = math.exp(random.uniform(math.log(3.0), math.log(highest)))
    along = int(random.integers(3)) if random.random() < 0.8 else None
    steady = random.random() < 0.5
    coherence_s = math.inf if steady else math.exp(random.uniform(math.log(2.0), math.log(20.0)))

    def change(there: Experiment, size: float) -> Experiment:
        amplitude = _triple(size * (np.ones(3) if along is None else np.eye(3)[along]))
        line = Line(line_hz, amplitude, coherence_s)
        return changes.with_stage(there, lines=(*there.stage.lines, line))

    axes = "xyz" if along is None else "xyz"[along]
    near = (0.95 * line_hz, 1.05 * line_hz)
    told = {"line_hz": line_hz} | ({} if steady else {"coherence_s": coherence_s})
    return Family(change, (0.01, 20.0), "nm", told, axes, None, near)


def _dropped(experiment: Experiment, share: float) -> Experiment:
    return replace(experiment, clock=replace(experiment.clock, dropped_share=share))


def _turned(experiment: Experiment, random: np.random.Generator) -> Family:
    sign = _sign(random)

    def change(there: Experiment, size: float) -> Experiment:
        return changes.with_optics(there, angle_rad=math.radians(sign * size))

    return Family(change, (2.0, 90.0), "°", {"sign": sign}, axes="xy")


def _crosstalk(experiment: Experiment, random: np.random.Generator) -> Family:
    direction = random.uniform(0, 2 * math.pi)
    x, y = math.cos(direction), math.sin(direction)

    def change(there: Experiment, size: float) -> Experiment:
        return changes.with_step(there, Crosstalk(size * x, size * y))

    return Family(change, (0.001, 0.6), "of x and y", {"x": x, "y": y}, axes="z")


def _rocking(experiment: Experiment, random: np.random.Generator) -> Family:
    sign, power = _sign(random), float(random.uniform(0.3, 1.0))
    torque_pN_nm = float(np.exp(random.uniform(math.log(1500), math.log(6000))))

    def change(there: Experiment, size: float) -> Experiment:
        there = changes.with_magnets(there, alignment_pN_nm=torque_pN_nm, alignment_power=power)
        return changes.with_bead(there, offset_nm=sign * size * there.bead.radius_nm)

    given = {"sign": sign, "torque_pN_nm": torque_pN_nm, "power": power}
    return Family(change, (0.01, 0.7), "of the radius", given)


def _turning(experiment: Experiment, random: np.random.Generator) -> Family:
    if not experiment.bead.turns:
        raise ValueError("a bead that does not turn is not seen to")
    sign = _sign(random)

    def change(there: Experiment, size: float) -> Experiment:
        return changes.with_bead(there, z_per_turn_nm=sign * size)

    return Family(change, (1.0, 800.0), "nm/rad", {"sign": sign}, axes="z")


def _aligned(experiment: Experiment, softness: float) -> Experiment:
    return changes.with_magnets(experiment, alignment_pN_nm=1e6 / softness)


def _sideways(experiment: Experiment, per_mm: float) -> Experiment:
    return changes.with_magnets(experiment, sideways_per_nm=1e-6 * per_mm)


def _stretching(experiment: Experiment, per_nN: float) -> Experiment:
    formula = "extensible-marko-siggia" if experiment.chain.formula == "marko-siggia" else (
        "extensible"
    )  # fmt: skip
    return changes.with_chain(experiment, formula=formula, stretch_modulus_pN=1000.0 / per_nN)


def _tethers(experiment: Experiment, random: np.random.Generator) -> Family:
    number = int(random.choice([2, 2, 3]))
    length = experiment.chain.persistence_length_nm / number
    change = partial(_persistence, length)
    return Family(change, (1.0, 1.0), "", {"number": number})


def _persistence(length_nm: float, experiment: Experiment, _: float) -> Experiment:
    return changes.with_chain(experiment, persistence_length_nm=length_nm)


def _hopping(experiment: Experiment, random: np.random.Generator) -> Family:
    forces = sorted(rest.force_pN for rest in experiment.rests)
    half_pN = math.exp(random.uniform(math.log(forces[1]), math.log(forces[-2])))
    rate_hz = math.exp(random.uniform(math.log(0.3), math.log(10.0)))

    def change(there: Experiment, size: float) -> Experiment:
        return with_step(there, Hopping(size, half_pN, rate_hz))

    told = {"half_force_pN": half_pN, "rate_hz": rate_hz}
    return Family(change, (1.0, 50.0), "nm", told, axes="z")


def _force_drift(experiment: Experiment, random: np.random.Generator) -> Family:
    """In all plateaus alike, or in about a third of them."""
    kind = ("ramp", "settling", "step")[int(random.integers(3))]
    sign, number = _sign(random), len(experiment.rests)
    at = random.uniform(0.1, 0.25) if kind == "settling" else random.uniform(0.3, 0.7)
    changing = np.arange(number)
    if random.random() < 0.5:
        changing = np.sort(random.choice(number, size=max(number // 3, 1), replace=False))
    where = tuple(int(i) for i in changing)

    def change(there: Experiment, size: float) -> Experiment:
        course = ForceCourse(sign * size, kind, 0.0 if kind == "ramp" else at)  # type: ignore[arg-type]
        courses = tuple(course if i in where else ForceCourse() for i in range(number))
        return changes.with_magnets(there, courses=courses)

    told = {"course": kind, "sign": sign, "at": at, "plateaus": list(where)}
    plateaus = where if len(where) < number else None
    return Family(change, (0.002, 0.5), "of the force", told, plateaus=plateaus)


def _memory(experiment: Experiment, share: float) -> Experiment:
    return changes.with_fluid(experiment, memory=share)


EFFECTS = (
    Effect("wall_drag", "friction", 0),
    Effect("rotation_coupling", "rotation", 0),
    Effect("off_center_attachment", "height", 1, _simple(_offset, (0.05, 0.95), "R", axes="xyz")),
    Effect("tracking_noise", "white", 3, _simple(_noise, (0.1, 15.0), "nm in x and y")),
    Effect("exposure", "white", 1, _exposure),
    Effect("drift", "slow", 3, _drift),
    Effect("reference_noise", "slow", 4, _reference),
    Effect("vibration", "line", 4, _vibration),
    Effect("viscosity", "friction", 1, _factor(changes.scaled_viscosity, (0.01, 0.4))),
    Effect("bead_radius", "friction", 1, _factor(changes.scaled_radius, (0.01, 0.2))),
    Effect("lateral_scale", "lateral", 1, _factor(_lateral_scale, (0.003, 0.15))),
    Effect("axial_scale", "height", 1, _factor(_axial_scale, (0.001, 0.3))),
    Effect("dropped_frames", "white", 1, _simple(_dropped, (0.002, 0.3), "of the frames")),
    Effect("field_rotation", "lateral", 1, _turned),
    Effect("magnetic_alignment", "tilt", 1, _simple(_aligned, (1.0, 1e3), "rad/(µN nm)")),
    Effect("lateral_magnet_stiffness", "lateral", 1, _simple(_sideways, (3.0, 4e3), "1/mm")),
    Effect("extensible_tether", "height", 1, _simple(_stretching, (0.1, 5.0), "1/nN")),
    Effect("contour_length", "height", 1, _factor(changes.scaled_contour_length, (0.001, 0.2))),
    Effect("multiple_tethers", "height", 1, _tethers),
    Effect("hopping", "hopping", 3, _hopping),
    Effect("force_drift", "course", 1, _force_drift),
    Effect("z_crosstalk", "crosstalk", 2, _crosstalk),
    Effect("bead_turning", "crosstalk", 1, _turning),
    Effect("bead_rocking", "tilt", 3, _rocking),
    Effect("anharmonic_tether", "regime", 0, regime="low force"),
    Effect(
        "hydrodynamic_memory",
        "regime",
        1,
        _simple(_memory, (0.05, 1.5), "of the bulk's"),
        regime="fast camera",
    ),
    Effect(
        "surface_sticking",
        "sticking",
        spoil=spoiled_traces.stick,
        sizes={"faint": (1.0, 2.0), "moderate": (3.0, 6.0), "clear": (8.0, 20.0)},
        unit="s",
    ),
    Effect(
        "z_response",
        "height",
        spoil=spoiled_traces.respond,
        sizes={"faint": (0.02, 0.04), "moderate": (0.06, 0.12), "clear": (0.15, 0.3)},
        unit="nm per nm",
    ),
    Effect(
        "pixel_locking",
        "pixel",
        spoil=spoiled_traces.lock,
        sizes={"faint": (0.5, 0.8), "moderate": (1.0, 1.8), "clear": (2.5, 4.0)},
        unit="nm",
    ),
)
BY_NAME = {effect.name: effect for effect in EFFECTS}
LISTING = ("wall_drag", "rotation_coupling", "tracking_noise", "anharmonic_tether")

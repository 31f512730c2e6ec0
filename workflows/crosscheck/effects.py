"""Effects put into otherwise clean recordings by hand, each in a few strengths.

Those of the experiment itself change its description before it is simulated; those of the
instrument spoil the raw recording. Neither shares code with `mtpipe.effects`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import clean
import numpy as np

from mtpipe.crosschecking.check import check_bead
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.experiment import changes
from mtpipe.experiment.description import Experiment, Rest
from mtpipe.ground.types import FloatArray
from mtpipe.physics.camera import Camera
from mtpipe.physics.langevin import simulate_mode
from mtpipe.recording.plateaus import find_plateaus
from mtpipe.recording.recording import Recording
from mtpipe.setup.setup import parse_setup
from mtpipe.setup.usual_errors import exact
from mtpipe.simulation.simulate import Engine

BEAD, REFERENCE = "b1", "ref1"
LISTED = ("wall_drag", "rotation_coupling", "tracking_noise")
FORCES_PN = np.geomspace(0.4, 12.0, 6)
FRAMES, NOISE_NM = 4096, (1.5, 1.5, 2.2)
PIXEL_NM = 100.0
FORCE_PIECES = 8


@dataclass(frozen=True)
class Effect:
    """What is done to a recording, as a function of the strength.

    Attributes
    ----------
    name, unit : of the effect and of its strength, as the table shows them.
    change : of the experiment; spoil : of the raw recording; unlisted : what the setup omits.
    engine : who simulates. rate_hz : of the camera.
    """

    name: str
    unit: str
    strengths: tuple[float, ...]
    change: Callable[[Experiment, float], Experiment] | None = None
    spoil: Callable[[Recording, float, np.random.Generator], Recording] | None = None
    unlisted: str = ""
    engine: Engine = "linear"
    rate_hz: float = 120.0


def base(unlisted: str = "", rate_hz: float = 120.0) -> clean.Clean:
    """The recording that all effects are put into: 1.4 µm beads, 2.7 µm of DNA."""
    setup = parse_setup(
        exact(
            {
                "schema": 1,
                "camera": {"frame_rate_hz": rate_hz, "exposure_s": 0.6 / rate_hz},
                "beads": {"radius_nm": 1400.0, "reference": [REFERENCE]},
                "tether": {"contour_length_nm": 2700.0, "persistence_length_nm": 50.0},
                "buffer": {"temperature_K": 298.15, "viscosity_mPa_s": 0.89},
                "field": {"direction": "x"},
                "model": {"effects": list(LISTED)},
                # at high rates the plateaus are short
                "plateaus": {"minimum_s": min(5.0, 0.8 * FRAMES / rate_hz)},
            }
        ),
        where="study",
    )
    found = clean.configured(setup, [float(force) for force in FORCES_PN], FRAMES, NOISE_NM)
    if unlisted:
        kept = tuple(name for name in LISTED if name != unlisted)
        model = setup.model.model_copy(update={"effects": kept})
        found = replace(found, setup=setup.model_copy(update={"model": model}))
    return found


def prepared(job: tuple[str, float, int, int], random: np.random.Generator) -> PreparedBead:
    """A bead with an effect, given its name, strength, the study's seed and a number."""
    name, strength, _, _ = job
    effect = next(one for one in EFFECTS if one.name == name)

    def change(experiment: Experiment, _: np.random.Generator) -> Experiment:
        return experiment if effect.change is None else effect.change(experiment, strength)

    def spoil(raw: Recording, own: np.random.Generator) -> Recording:
        return raw if effect.spoil is None else effect.spoil(raw, strength, own)

    configured = replace(base(effect.unlisted, effect.rate_hz), engine=effect.engine)
    return clean.prepared(configured, random, change=change, spoil=spoil)


def measure(job: tuple[str, float, int, int]) -> dict[str, Any]:
    """Cross-check one recording with an effect."""
    name, strength, seed, number = job
    random = generator(job)
    return {
        "effect": name,
        "strength": strength,
        "seed": seed,
        "number": number,
        "p_value": check_bead(prepared(job, random), random).p_value,
    }


def generator(job: tuple[str, float, int, int]) -> np.random.Generator:
    """Random numbers of one recording with an effect."""
    name, _, seed, number = job
    return np.random.default_rng([seed, number, *map(ord, name)])


def _viscosity(experiment: Experiment, factor: float) -> Experiment:
    fluid = experiment.fluid
    return replace(experiment, fluid=replace(fluid, viscosity_mPa_s=fluid.viscosity_mPa_s * factor))


def _radius(experiment: Experiment, factor: float) -> Experiment:
    return replace(
        experiment, bead=replace(experiment.bead, radius_nm=experiment.bead.radius_nm * factor)
    )


def _contour(experiment: Experiment, factor: float) -> Experiment:
    chain = experiment.chain
    return replace(
        experiment, chain=replace(chain, contour_length_nm=chain.contour_length_nm * factor)
    )


def _tethers(experiment: Experiment, number: float) -> Experiment:
    chain = experiment.chain
    return replace(
        experiment, chain=replace(chain, persistence_length_nm=chain.persistence_length_nm / number)
    )


def _memory(experiment: Experiment, share: float) -> Experiment:
    return changes.with_fluid(experiment, memory=share)


def _off_center(experiment: Experiment, share: float) -> Experiment:
    return changes.with_bead(experiment, offset_nm=share * experiment.bead.radius_nm)


def _aligned(experiment: Experiment, torque_stiffness_pN_nm: float) -> Experiment:
    return changes.with_magnets(experiment, alignment_pN_nm=torque_stiffness_pN_nm)


def _held_sideways(experiment: Experiment, per_mm: float) -> Experiment:
    return changes.with_magnets(experiment, sideways_per_nm=1e-6 * per_mm)


def _extensible(experiment: Experiment, stretch_modulus_pN: float) -> Experiment:
    return changes.with_chain(
        experiment, formula="extensible-marko-siggia", stretch_modulus_pN=stretch_modulus_pN
    )


def _weaker(experiment: Experiment, lowest_pN: float) -> Experiment:
    """All forces smaller by a factor; step by step the bead meets the wall, the chain its slack."""
    factor = lowest_pN / min(rest.force_pN for rest in experiment.rests)
    rests = tuple(replace(rest, force_pN=factor * rest.force_pN) for rest in experiment.rests)
    return replace(experiment, rests=rests)


def _exposure(experiment: Experiment, factor: float) -> Experiment:
    camera = experiment.camera
    return replace(experiment, camera=Camera(camera.frame_s, camera.exposure_s * factor))


def _force_drift(experiment: Experiment, relative: float) -> Experiment:
    """The force ramps through each plateau, in steps; the magnets jump from one to the next."""
    parts = np.linspace(-0.5, 0.5, FORCE_PIECES)
    rests = [
        Rest(rest.force_pN * (1 + relative * part), rest.frames // FORCE_PIECES, rest.magnet_mm)
        for rest, part in itertools.product(experiment.rests, parts)
    ]
    return replace(experiment, rests=tuple(rests), move_s=0.0)


def _moved(raw: Recording, bead: str, motion_nm: FloatArray) -> Recording:
    positions = raw.positions_nm | {bead: raw.positions_nm[bead] + motion_nm}
    return replace(raw, positions_nm=positions)


def _about_anchor(raw: Recording, matrix: FloatArray) -> Recording:
    """Recorded positions are a matrix times the true ones, from the anchor."""
    xyz = raw.positions_nm[BEAD]
    anchor = np.append(np.nanmean(xyz[:, :2], axis=0), 0.0)
    positions = raw.positions_nm | {BEAD: (xyz - anchor) @ matrix.T + anchor}
    return replace(raw, positions_nm=positions)


def _turned(raw: Recording, degrees: float, _: np.random.Generator) -> Recording:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return _about_anchor(raw, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))


def _vibration(raw: Recording, amplitude_nm: float, random: np.random.Generator) -> Recording:
    wave = np.sin(2 * np.pi * (31.7 * raw.time_s + random.random()))
    return _moved(raw, BEAD, amplitude_nm * np.outer(wave, [1.0, 0.0, 0.0]))


def _drift(raw: Recording, nm_per_root_s: float, random: np.random.Generator) -> Recording:
    step = nm_per_root_s * math.sqrt(float(np.median(np.diff(raw.time_s))))
    return _moved(raw, BEAD, np.cumsum(step * random.normal(size=(len(raw.time_s), 3)), axis=0))


def _reference(raw: Recording, size_nm: float, random: np.random.Generator) -> Recording:
    frame_s = float(np.median(np.diff(raw.time_s)))
    camera, frames = Camera(frame_s, 0.0), len(raw.time_s)
    motion = [simulate_mode(size_nm**2, 1.0, camera, frames, random) for _ in range(3)]
    return _moved(raw, REFERENCE, np.column_stack(motion))


def _dropped(raw: Recording, share: float, random: np.random.Generator) -> Recording:
    """Frames are missing, and the file's times go on as if they were not."""
    kept = np.flatnonzero(random.random(len(raw.time_s)) >= share)
    magnet = None if raw.magnet_mm is None else raw.magnet_mm[kept]
    time_s = raw.time_s[: len(kept)]
    return replace(
        raw,
        time_s=time_s,
        frame=raw.frame[: len(kept)],
        positions_nm={bead: xyz[kept] for bead, xyz in raw.positions_nm.items()},
        magnet_mm=magnet,
        plateaus=find_plateaus(time_s, magnet, raw.setup.plateaus),
    )


def _hopping(raw: Recording, step_nm: float, random: np.random.Generator) -> Recording:
    frame_s = float(np.median(np.diff(raw.time_s)))
    changed = random.random(len(raw.time_s)) < 3.0 * frame_s
    state = np.cumsum(changed) % 2
    return _moved(raw, BEAD, step_nm * np.outer(state, [0.0, 0.0, 1.0]))


def _sticking(raw: Recording, seconds: float, random: np.random.Generator) -> Recording:
    """Once, in the plateau of the lowest force, the bead stays where it is."""
    start = raw.plateaus[0].start + round(10.0 * 120.0)
    rows = slice(start, start + round(seconds * 120.0))
    xyz = raw.positions_nm[BEAD].copy()
    held = np.nanmean(xyz[start : start + 3], axis=0)
    xyz[rows] = held + np.asarray(NOISE_NM) * random.normal(size=xyz[rows].shape)
    return replace(raw, positions_nm=raw.positions_nm | {BEAD: xyz})


def _pixel(raw: Recording, amplitude_nm: float, _: np.random.Generator) -> Recording:
    xyz = raw.positions_nm[BEAD]
    bent = amplitude_nm * np.sin(2 * np.pi * xyz / PIXEL_NM)
    bent[:, 2] = 0.0
    return _moved(raw, BEAD, bent)


EFFECTS = (
    Effect("viscosity", "factor", (1.005, 1.01, 1.03, 1.1), _viscosity),
    Effect("bead_radius", "factor", (1.005, 1.01, 1.03, 1.1), _radius),
    Effect("wall_drag not listed", "", (1.0,), unlisted="wall_drag"),
    Effect("rotation_coupling not listed", "", (1.0,), unlisted="rotation_coupling"),
    Effect(
        "tracking_noise not listed",
        "nm in x and y",
        (0.3, 0.6, 1.2),
        lambda experiment, nm: replace(
            experiment,
            tracker=replace(
                experiment.tracker, noise_nm=(nm, nm, 1.5 * nm), reference_noise_nm=(nm, nm, nm)
            ),
        ),
        unlisted="tracking_noise",
    ),
    Effect("exposure", "factor", (0.9, 0.7, 0.4), _exposure),
    Effect("drift", "nm/√s", (0.3, 1.0, 3.0), spoil=_drift),
    Effect("reference_noise", "nm, for 1 s", (0.5, 2.0, 5.0), spoil=_reference),
    Effect("vibration", "nm in x", (0.3, 1.0, 3.0), spoil=_vibration),
    Effect(
        "lateral_scale",
        "factor",
        (1.005, 1.01, 1.03, 1.1),
        spoil=lambda raw, factor, _: _about_anchor(raw, np.diag([factor, factor, 1.0])),
    ),
    Effect(
        "axial_scale",
        "factor",
        (1.0003, 1.001, 1.003, 1.01, 1.03),
        spoil=lambda raw, factor, _: _about_anchor(raw, np.diag([1.0, 1.0, factor])),
    ),
    Effect("off_center_attachment", "of the radius", (0.03, 0.1, 0.3), _off_center),
    Effect("magnetic_alignment", "pN nm", (1e5, 3e4, 1e4), _aligned),
    Effect("lateral_magnet_stiffness", "of the force, 1/mm", (10.0, 30.0, 100.0), _held_sideways),
    Effect("extensible_tether", "pN", (10000.0, 3000.0, 1000.0), _extensible),
    Effect("anharmonic_tether", "pN, lowest force", (0.4, 0.2, 0.1), _weaker, engine="brownian"),
    Effect("hydrodynamic_memory", "of the bulk's", (1.0,), _memory),
    Effect(
        "hydrodynamic_memory at 4000 frames/s",
        "of the bulk's",
        (0.25, 0.5, 1.0),
        _memory,
        rate_hz=4000.0,
    ),
    Effect("field_rotation", "°", (3.0, 8.0, 20.0), spoil=_turned),
    Effect("dropped_frames", "share", (0.003, 0.02, 0.1), spoil=_dropped),
    Effect("contour_length", "factor", (1.0003, 1.001, 1.003, 1.01, 1.03), _contour),
    Effect("multiple_tethers", "chains", (1.02, 1.1, 2.0), _tethers),
    Effect("hopping", "nm", (1.0, 3.0, 10.0), spoil=_hopping),
    Effect("surface_sticking", "s", (1.0, 3.0, 10.0), spoil=_sticking),
    Effect("force_drift", "relative", (0.03, 0.1, 0.3), _force_drift),
    Effect("pixel_locking", "nm", (1.0, 3.0, 6.0), spoil=_pixel),
)

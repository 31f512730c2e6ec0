"""From a setup and a list of forces to the experiment it describes.

What a setup does not state (the stage's drift, the size of the tracking noise, where the magnets
stand for a force) is filled in with values that are typical, and each is said in a notice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mtpipe.experiment.description import (
    Bead,
    Experiment,
    Fluid,
    Rest,
    Stage,
    Tracker,
    Triple,
)
from mtpipe.ground.errors import SetupError
from mtpipe.ground.notice import Notice
from mtpipe.physics.camera import Camera
from mtpipe.physics.tether import Chain, Formula
from mtpipe.setup.conditions import conditions_of
from mtpipe.setup.measured import Measured
from mtpipe.setup.setup import Setup
from mtpipe.setup.tables import NOISE

TYPICAL_NOISE_NM: Triple = (2.0, 2.0, 3.0)
TYPICAL_STAGE = Stage(random_nm_per_root_s=(1.0, 1.0, 1.5))
# Magnets of Lipfert et al. 2009 (Biophys J 96:5040): force falls off by e within 1.6 mm or so.
STRONGEST_PN, NEAREST_MM, DECAY_MM = 60.0, 0.1, 1.6


def experiment_of(
    setup: Setup,
    forces_pN: Sequence[float],
    frames: int,
    *,
    noise_nm: Triple | None = None,
    stage: Stage | None = None,
    beads: int = 1,
    lost_share: float = 0.0,
    formula: Formula = "marko-siggia",
) -> tuple[Experiment, tuple[Notice, ...]]:
    """The experiment a setup describes, at these forces.

    Parameters
    ----------
    forces_pN : one plateau each, in time order.
    frames : per plateau.
    noise_nm : tracking noise along x, y, z of every bead; None: `[model.tracking_noise] noise_nm`
        of the setup, a typical one if the setup lists the effect without a size, else zero.
    stage : its motion; None: a typical one.
    beads : number of tethered beads. References are those that the setup names.
    lost_share : of each bead's frames, at least 0 and below 1.
    formula : of the worm-like chain; the setup does not say.

    Returns
    -------
    The experiment, and notices of what was assumed.

    Raises
    ------
    SetupError : what a simulation needs is unknown, or a force, a length or a noise cannot be.
    """
    for force in forces_pN:
        if not (force > 0 and math.isfinite(force)):
            raise SetupError(
                f"a force of {force:g} pN cannot be simulated", mend="Give it above 0."
            )
    if not len(forces_pN):
        raise SetupError("no force is given", mend="Give at least one, in pN.")
    if frames < 2 or beads < 1:
        raise SetupError(f"{frames} frames of {beads} beads cannot be simulated")
    conditions, notices = conditions_of(setup)
    if conditions.radius_nm is None:
        raise _unknown("[beads] radius_nm")
    # what is said of pinned parameters there is about fits
    assumed = [notice for notice in notices if notice.code != "pinned_not_used"]
    if stage is None:
        stage = TYPICAL_STAGE
        steps = ", ".join(f"{step:g}" for step in stage.random_nm_per_root_s)
        said = f"The stage moves at random by {steps} nm along x, y, z in a second, as is typical."
        assumed.append(Notice("stage_assumed", "info", said))
    if len(_known_forces(setup)) < 2:
        said = (
            "Magnet positions are those of a typical magnet: [[magnet]] does not state two forces."
        )
        assumed.append(Notice("magnet_assumed", "info", said))
    if not setup.camera.exposure_s.known:
        said = "The exposure is unknown; that of a whole frame was taken."
        assumed.append(Notice("exposure_assumed", "caution", said))
    needed_s, rest_s = setup.plateaus.minimum_s, frames / conditions.frame_rate_hz
    if rest_s < needed_s:
        assumed.append(
            Notice(
                "short_plateaus",
                "caution",
                f"{frames} frames are {rest_s:.3g} s, less than the {needed_s:g} s from which on a "
                "rest of the magnets counts as a plateau ([plateaus] minimum_s).",
            )
        )
    chosen = _noise(setup, assumed) if noise_nm is None else noise_nm
    if any(not (value >= 0 and math.isfinite(value)) for value in chosen):
        raise SetupError(f"a tracking noise of {chosen} nm cannot be simulated")
    if not 0 <= lost_share < 1:
        raise SetupError(f"a share of {lost_share:g} of the frames cannot be lost")
    rate = conditions.frame_rate_hz
    experiment = Experiment(
        chain=Chain(
            _known(setup.tether.contour_length_nm, "[tether] contour_length_nm"),
            _known(setup.tether.persistence_length_nm, "[tether] persistence_length_nm"),
            conditions.temperature_K,
            formula,
        ),
        bead=Bead(conditions.radius_nm[0], turns=conditions.rotation),
        fluid=Fluid(conditions.temperature_K, conditions.viscosity_mPa_s[0], wall=conditions.wall),
        along=conditions.along,
        camera=Camera(1 / rate, conditions.exposure_s),
        stage=stage,
        tracker=Tracker(chosen, chosen, lost_share),
        rests=tuple(
            Rest(float(force), frames, magnet)
            for force, magnet in zip(forces_pN, magnets_mm(setup, forces_pN), strict=True)
        ),
        tethered=beads,
        references=len(setup.beads.reference),
        anharmonic=setup.model.anharmonic,
    )
    return experiment, tuple(assumed)


def magnets_mm(setup: Setup, forces_pN: Sequence[float]) -> list[float]:
    """Where the magnets stand for each force, one position per plateau, to 1 µm.

    From the forces known beforehand (`[[magnet]]`), ln F linear between positions and on to both
    sides; with fewer than two of them a typical magnet is taken. Neighbouring plateaus never share
    a position, or they would be one plateau.
    """
    known = _known_forces(setup)
    if len(known) >= 2:
        logs = np.log([force for force, _ in known])
        stand = [position for _, position in known]
        slope = np.polyfit(logs, stand, 1)[0]
        asked = np.log(forces_pN)
        beyond = asked - np.clip(asked, logs[0], logs[-1])
        positions = np.interp(asked, logs, stand) + slope * beyond
    else:
        positions = NEAREST_MM + DECAY_MM * np.log(STRONGEST_PN / np.asarray(forces_pN))
    apart = round(max(0.001, 2 * setup.plateaus.tolerance_mm), 3)
    rounded: list[float] = []
    for position in positions:
        value = round(float(position), 3)
        if rounded and abs(value - rounded[-1]) < apart:
            value = round(rounded[-1] + apart, 3)
        rounded.append(value)
    return rounded


def _known_forces(setup: Setup) -> list[tuple[float, float]]:
    """Forces known beforehand and the magnets' positions, by force; of equal ones the last."""
    known = {
        m.force_pN.value: m.position_mm.value
        for m in setup.magnet
        if m.force_pN.value is not None and m.position_mm.value is not None
    }
    return sorted(known.items())


def _noise(setup: Setup, assumed: list[Notice]) -> Triple:
    pinned = pinned_noise_nm(setup)
    if pinned is None:
        if not setup.model.noisy:
            return (0.0, 0.0, 0.0)
        lateral, _, up = TYPICAL_NOISE_NM
        assumed.append(
            Notice(
                "noise_assumed",
                "info",
                "The setup lists tracking noise without its size: "
                f"{lateral:g} nm in x and y and {up:g} nm in z were taken.",
            )
        )
        return TYPICAL_NOISE_NM
    return pinned


def pinned_noise_nm(setup: Setup) -> Triple | None:
    """Tracking noise along x, y, z that the setup pins; None where it pins none.

    Raises
    ------
    SetupError : it is no number, and no three numbers.
    """
    table = (setup.model.model_extra or {}).get(NOISE, {})
    wrong = sorted(set(table) - {"noise_nm"})
    if wrong:
        raise SetupError(
            f"[model.{NOISE}] {wrong[0]} is no size that can be pinned",
            mend="It has noise_nm.",
        )
    if not table:
        return None
    pinned = table["noise_nm"]
    values = pinned if isinstance(pinned, list) else [pinned] * 3
    if len(values) != 3 or not all(isinstance(v, (int, float)) and v >= 0 for v in values):
        raise SetupError(
            f"[model.{NOISE}] noise_nm = {pinned!r}: a number, or one each for x, y and z, "
            "is needed"
        )
    return (float(values[0]), float(values[1]), float(values[2]))


def _known(measured: Measured, key: str) -> float:
    if measured.value is None:
        raise _unknown(key)
    return measured.value


def _unknown(key: str) -> SetupError:
    return SetupError(f'{key} is "unknown", and a simulation needs it', mend="Write a value.")

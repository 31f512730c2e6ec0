"""The conditions of an experiment as the fits need them: one number each, with its uncertainty.

Where the setup says "unknown" a value is estimated or assumed here, and a notice says so. What
cannot be assumed (a bead's radius) stays unknown, and what depends on it is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mtpipe.ground.errors import FitError, SetupError
from mtpipe.ground.notice import Notice
from mtpipe.physics.buffer import thermal_energy_pN_nm, water_viscosity_mPa_s
from mtpipe.physics.modes import SINGLE_MODE, Modes
from mtpipe.physics.tethered_bead import friction_pN_s_per_nm, lever_nm, turning_modes
from mtpipe.setup.setup import Setup

ROOM_TEMPERATURE_K = (296.0, 3.0)
# Relative error granted to friction from radius, viscosity and height even where the setup states
# all of them as exact: Faxén's series, the height and the camera's own scale are good to this.
FRICTION_ALLOWANCE = 0.03


@dataclass(frozen=True)
class Conditions:
    """Numbers shared by all traces of a recording.

    `viscosity_mPa_s` and `radius_nm` are (value, standard error); the radius is None where it is
    not known. `wall` and `rotation` say whether the setup includes those effects.
    """

    frame_rate_hz: float
    exposure_s: float
    exposure_stderr_s: float
    temperature_K: float
    temperature_relative_stderr: float
    viscosity_mPa_s: tuple[float, float]
    radius_nm: tuple[float, float] | None
    along: int
    wall: bool
    rotation: bool

    @property
    def thermal_energy_pN_nm(self) -> float:
        """kT."""
        return float(thermal_energy_pN_nm(self.temperature_K))

    @property
    def friction_relative_stderr(self) -> float:
        """Relative standard error of the friction expected from radius and viscosity."""
        if self.radius_nm is None:
            return math.inf
        parts = [value[1] / value[0] for value in (self.viscosity_mPa_s, self.radius_nm)]
        return math.hypot(*parts, FRICTION_ALLOWANCE)

    @property
    def friction_stderr_apart_from_viscosity(self) -> float:
        """Relative standard error of the expected friction in a buffer whose viscosity is known."""
        if self.radius_nm is None:
            return math.inf
        return math.hypot(self.radius_nm[1] / self.radius_nm[0], FRICTION_ALLOWANCE)

    @property
    def friction_stderr_apart_from_radius(self) -> float:
        """Relative standard error of the expected friction of a bead whose radius is known."""
        return math.hypot(self.viscosity_mPa_s[1] / self.viscosity_mPa_s[0], FRICTION_ALLOWANCE)

    def friction_pN_s_per_nm(self, axis: int, extension_nm: float) -> float | None:
        """Expected friction along an axis (0, 1, 2) of a bead at this extension.

        None where the radius is not known, or the bead cannot be at that height.
        """
        if self.radius_nm is None:
            return None
        try:
            return float(
                friction_pN_s_per_nm(
                    extension_nm,
                    self.radius_nm[0],
                    self.viscosity_mPa_s[0],
                    wall=self.wall,
                    upright=axis == 2,
                )
            )
        except FitError:
            return None

    def modes(self, axis: int, extension_nm: float) -> Modes:
        """Relaxation modes along an axis: two across the field if the bead's rotation couples."""
        across = axis != 2 and axis != self.along
        if not (across and self.rotation) or self.radius_nm is None or not extension_nm > 0:
            return SINGLE_MODE
        return turning_modes(extension_nm, self.radius_nm[0], wall=self.wall)

    def lever_nm(self, axis: int, extension_nm: float) -> float | None:
        """Length by which a lateral stiffness is multiplied to give the force: L, or L + R across.

        None where it is not known.
        """
        radius = math.nan if self.radius_nm is None else self.radius_nm[0]
        lever = float(lever_nm(extension_nm, radius, along=axis == self.along))
        return lever if extension_nm > 0 and math.isfinite(lever) else None


def usual_errors(setup: Setup) -> list[Notice]:
    """One notice of all values that the setup states without an error; none where there are none.

    The frame rate's usual error is smaller than anything that is fitted, and is not told.
    """
    stated = {
        "bead radius": setup.beads.radius_nm,
        "contour length": setup.tether.contour_length_nm,
        "persistence length": setup.tether.persistence_length_nm,
        "viscosity": setup.buffer.viscosity_mPa_s,
        "temperature": setup.buffer.temperature_K,
        "exposure": setup.camera.exposure_s,
        "pixel size": setup.camera.pixel_size_nm,
    }
    taken = [
        f"{name} {one.stderr:g} K" if name == "temperature" else f"{name} {one.relative_stderr:.0%}"
        for name, one in stated.items()
        if one is not None and one.usual
    ]
    if not taken:
        return []
    return [
        Notice(
            "usual_errors",
            "info",
            f"The setup states no error of some values; usual ones were taken: {', '.join(taken)}. "
            "A line such as radius_nm_stderr = 5.0 states your own, 0.0 an exact value.",
        )
    ]


def conditions_of(setup: Setup) -> tuple[Conditions, tuple[Notice, ...]]:
    """Conditions from a setup, and what had to be assumed.

    An unknown exposure is set to a whole frame here; `calibrate` estimates it from the traces.

    Raises
    ------
    SetupError : the frame rate is unknown and the recording's time stamps did not give it.
    """
    notices: list[Notice] = []
    rate = setup.camera.frame_rate_hz.value
    if rate is None:
        raise SetupError(
            "[camera] frame_rate_hz is unknown and the recording carries no time stamps",
            mend="Write the camera's frame rate.",
        )
    temperature = setup.buffer.temperature_K.value
    temperature_stderr = setup.buffer.temperature_K.stderr
    if temperature is None:
        temperature, temperature_stderr = ROOM_TEMPERATURE_K
        notices.append(
            Notice(
                "temperature_assumed",
                "caution",
                f"The temperature is unknown; {temperature:g} ± {temperature_stderr:g} K was "
                f"assumed, which moves every force by {temperature_stderr / temperature:.1%}.",
            )
        )
    viscosity = setup.buffer.viscosity_mPa_s
    if viscosity.value is None:
        value = float(water_viscosity_mPa_s(temperature))
        stderr = 0.5 * abs(
            float(water_viscosity_mPa_s(temperature + temperature_stderr))
            - float(water_viscosity_mPa_s(temperature - temperature_stderr))
        )
        chosen = (value, max(stderr, 0.05 * value))
        notices.append(
            Notice(
                "viscosity_assumed",
                "caution",
                f"The viscosity is unknown; that of water at {temperature:g} K was assumed, "
                f"{chosen[0]:.3f} ± {chosen[1]:.3f} mPa s.",
            )
        )
    else:
        chosen = (viscosity.value, viscosity.stderr)
    radius = setup.beads.radius_nm
    if not radius.known:
        notices.append(
            Notice(
                "radius_unknown",
                "caution",
                "The bead radius is unknown: it is estimated from each bead's friction and from x "
                "against y, and forces near the Nyquist frequency are less certain.",
            )
        )
    pinned = sorted(setup.model.model_extra or {})
    if pinned:
        notices.append(
            Notice(
                "pinned_not_used",
                "caution",
                f"The parameters pinned for {', '.join(pinned)} enter the cross-check and its "
                "forces (mismatch.json), not forces.csv, whose fits free friction and noise.",
            )
        )
    exposure = setup.camera.exposure_s.value
    return Conditions(
        frame_rate_hz=rate,
        exposure_s=1 / rate if exposure is None else min(exposure, 1 / rate),
        exposure_stderr_s=setup.camera.exposure_s.stderr,
        temperature_K=temperature,
        temperature_relative_stderr=temperature_stderr / temperature,
        viscosity_mPa_s=chosen,
        radius_nm=None if radius.value is None else (radius.value, radius.stderr),
        along=0 if setup.field.direction == "x" else 1,
        wall=setup.model.wall,
        rotation=setup.model.turns,
    ), tuple(notices)

"""What to do about a cause that was named: how to confirm it, and what to change in the setup."""

from __future__ import annotations

from collections.abc import Mapping

VALUE = "measure it again; if it is confirmed, correct {key} in the setup."
PHYSICS = "if you expect it of this experiment, list {effect} under [model] effects in the setup."

# Of effects that are a value of the setup: which.
KEYS: Mapping[str, str] = {
    "exposure": "[camera] exposure_s",
    "viscosity": "[buffer] viscosity_mPa_s or temperature_K",
    "bead_radius": "[beads] radius_nm",
    "contour_length": "[tether] contour_length_nm",
    "lateral_scale": "[camera] pixel_size_nm (the scale of x and y)",
    "axial_scale": "the scale of z (focus scan, refractive index)",
    "field_rotation": "[field] direction, or the orientation of the camera,",
}
# Of faults of the instrument or the preparation: where to look.
FAULTS: Mapping[str, str] = {
    "drift": "use a reference bead nearer to this one, or let the stage settle before recording.",
    "reference_noise": "use another reference bead, or several: this one moves by itself.",
    "vibration": "look for a pump, fan or mains line of this frequency near the microscope.",
    "dropped_frames": "check the camera's frame counter and the time column of the file.",
    "force_drift": "check whether the magnets moved or settled within the plateau; record it again "
    "or cut it.",
    "hopping": "expect it of a molecule that folds or binds; otherwise check what sticks to the "
    "tether or the bead.",
    "multiple_tethers": "turn the magnets: the extension of a bead on two tethers drops with the "
    "turns. Leave the bead out if it does.",
    "surface_sticking": "passivate the surface better, or leave out the plateaus of low force.",
    "pixel_locking": "check the tracker with an immobile bead on a moving stage.",
    "off_center_attachment": "expect it of beads with many binding sites; list "
    "off_center_attachment under [model] effects to have it in every fit.",
    "z_crosstalk": "check the focus and the illumination: the image is tilted or lopsided.",
    "bead_turning": "use a smoother bead, or take heights only from means over a long time.",
    "bead_rocking": "expect it of a bead whose tether is not attached at its lowest point.",
    "force_tilt": "centre the magnets above the field of view.",
    "z_response": "record the focus scan again, over the whole range of heights.",
    "magnet_log_lag": "synchronise the clocks of camera and magnets.",
    "repeated_frames": "check the camera's buffer: frames were stored twice.",
}


def remedy(effect: str) -> str:
    """What to do about an effect of the catalogue, or one that another package brings."""
    if effect in KEYS:
        return VALUE.format(key=KEYS[effect])
    return FAULTS.get(effect, PHYSICS.format(effect=effect))

"""The calibration methods of the field by their names, one trace at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from numpy.typing import ArrayLike

from mtpipe.fit.arguments import TraceArguments, check_arguments
from mtpipe.methods.integrated_spectrum import (
    CORRECTED,
    UNCORRECTED,
    Correction,
    fit_arctangent,
)
from mtpipe.methods.result import MethodFit
from mtpipe.methods.variances import fit_allan, fit_equipartition, fit_hadamard
from mtpipe.spectra.spectrum import frames_present


@dataclass(frozen=True)
class FieldMethod:
    """A calibration method of the field.

    Attributes
    ----------
    name : by which it is asked for. words : what it is, for a legend or a table.
    fit : a trace calibrated; it takes the name, which its estimates carry.
    """

    name: str
    words: str
    fit: Callable[[str, TraceArguments], MethodFit]


FIELD_METHODS = {
    method.name: method
    for method in (
        FieldMethod("equipartition", "equipartition, blur corrected", fit_equipartition),
        FieldMethod(
            "arctangent",
            "arctangent, n = ±1 (2010)",
            partial(fit_arctangent, correction=CORRECTED),
        ),
        FieldMethod(
            "arctangent-blur-only",
            "arctangent, blur corrected",
            partial(fit_arctangent, correction=Correction(True, ())),
        ),
        FieldMethod(
            "arctangent-uncorrected",
            "arctangent, uncorrected",
            partial(fit_arctangent, correction=UNCORRECTED),
        ),
        FieldMethod(
            "arctangent-one-alias",
            "arctangent, n = -1",
            partial(fit_arctangent, correction=Correction(True, (-1,))),
        ),
        FieldMethod("allan", "Allan variance", fit_allan),
        FieldMethod("hadamard", "Hadamard variance", fit_hadamard),
    )
}
METHODS = tuple(FIELD_METHODS)


def fit_by_method(
    method: str,
    x_nm: ArrayLike,
    *,
    frame_rate_hz: float,
    exposure_s: float,
    temperature_K: float,
    tracking_noise_nm: float | Literal["fit"] = 0.0,
    friction: tuple[float, float] | None = None,
) -> MethodFit:
    """Calibrate one trace with a method of the field.

    Parameters
    ----------
    method : one of `METHODS`.

        - "equipartition": variance of the positions, blur corrected (Wong & Halvorsen 2006).
        - "arctangent": integrated spectrum with blur and first aliases corrected (te Velthuis et
          al. 2010); "arctangent-one-alias" takes the order −1 only, "arctangent-blur-only" none,
          "arctangent-uncorrected" neither aliases nor blur.
        - "allan": Allan variance (Lansdorp & Saleh 2012).
        - "hadamard": Hadamard variance, blind to linear drift (Pritzl et al. 2024).
    x_nm : (n_frames,) positions, one per frame of the camera; NaN where a frame is lost. The
        arctangent methods bridge up to 1 % of lost frames and refuse more; the others average each
        lag over the pairs of frames that are there.
    frame_rate_hz, exposure_s : of the camera; exposure at most one frame.
    temperature_K : of the buffer.
    tracking_noise_nm : standard deviation of white tracking noise if known; "fit": estimated. The
        arctangent methods cannot fit it and take zero instead, with a note.
    friction : prior knowledge in pN s/nm, value and standard error, or None. With it and known
        noise, equipartition takes the variance alone. The arctangent methods do not use it.

    Returns
    -------
    MethodFit. Estimates that the method cannot tell have status "not_identified" and no value.

    Raises
    ------
    FitError : fewer than 64 frames, no motion, or too many lost frames for the method.
    ValueError : an unknown method, or a number that cannot be.
    """
    if method not in FIELD_METHODS:
        raise ValueError(f"unknown method {method!r}; the methods are {', '.join(METHODS)}")
    arguments = check_arguments(
        x_nm,
        frame_rate_hz=frame_rate_hz,
        exposure_s=exposure_s,
        temperature_K=temperature_K,
        tracking_noise_nm=tracking_noise_nm,
        friction=friction,
    )
    frames_present(arguments.x_nm)  # refuses a trace that no method can fit
    return FIELD_METHODS[method].fit(method, arguments)

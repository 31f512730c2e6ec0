"""mtpipe: force calibration for magnetic tweezers.

The steps of the pipeline as functions on plain types (FORMATS section 7):

    recording = mtpipe.load("recording.csv")
    recording = mtpipe.subtract_drift(recording)
    calibration = mtpipe.calibrate(recording)
    curves = mtpipe.force_extension(recording)
    simulated = mtpipe.simulate(recording.setup, forces_pN=[1, 5, 10])

Names are imported when they are first used, so that `import mtpipe` is fast.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from mtpipe.ground.version import VERSION

__version__ = VERSION

if TYPE_CHECKING:
    from mtpipe.calibration.calibration import Calibration, calibrate
    from mtpipe.crosschecking.crosscheck import CrossCheck, crosscheck
    from mtpipe.curves.chain_models import (
        extension_offset,
        freely_jointed_chain,
        molecule,
        worm_like_chain,
    )
    from mtpipe.curves.extension_curve import ForceExtension
    from mtpipe.curves.shared_fit import SharedFit, choose_model, fit_together
    from mtpipe.curves.tether_curves import force_extension
    from mtpipe.diagnosis.mismatch import Mismatch, diagnose
    from mtpipe.drift import subtract_drift
    from mtpipe.fit.posterior import Posterior, sample_posterior
    from mtpipe.fit.trace import TraceFit, fit_trace
    from mtpipe.ground.errors import FitError, MtpipeError, RecordingError, SetupError
    from mtpipe.ground.estimate import Estimate
    from mtpipe.ingest import load
    from mtpipe.methods import METHODS, fit_by_method
    from mtpipe.pipeline.results import Run
    from mtpipe.pipeline.run import run
    from mtpipe.recording.recording import Plateau, Recording
    from mtpipe.setup.setup import Setup, read_setup
    from mtpipe.simulation.simulate import simulate
    from mtpipe.tracking.track import TrackedStack, track

_HOME = {
    "METHODS": "methods",
    "Calibration": "calibration.calibration",
    "CrossCheck": "crosschecking.crosscheck",
    "Estimate": "ground.estimate",
    "FitError": "ground.errors",
    "ForceExtension": "curves.extension_curve",
    "Mismatch": "diagnosis.mismatch",
    "MtpipeError": "ground.errors",
    "Plateau": "recording.recording",
    "Posterior": "fit.posterior",
    "Recording": "recording.recording",
    "RecordingError": "ground.errors",
    "Run": "pipeline.run",
    "Setup": "setup.setup",
    "SetupError": "ground.errors",
    "SharedFit": "curves.shared_fit",
    "TraceFit": "fit.trace",
    "TrackedStack": "tracking.track",
    "calibrate": "calibration.calibration",
    "choose_model": "curves.shared_fit",
    "crosscheck": "crosschecking.crosscheck",
    "diagnose": "diagnosis.mismatch",
    "extension_offset": "curves.chain_models",
    "fit_by_method": "methods",
    "fit_together": "curves.shared_fit",
    "fit_trace": "fit.trace",
    "force_extension": "curves.tether_curves",
    "freely_jointed_chain": "curves.chain_models",
    "load": "ingest",
    "molecule": "curves.chain_models",
    "read_setup": "setup.setup",
    "run": "pipeline.run",
    "sample_posterior": "fit.posterior",
    "simulate": "simulation.simulate",
    "subtract_drift": "drift",
    "track": "tracking.track",
    "worm_like_chain": "curves.chain_models",
}
__all__ = [
    "METHODS",
    "Calibration",
    "CrossCheck",
    "Estimate",
    "FitError",
    "ForceExtension",
    "Mismatch",
    "MtpipeError",
    "Plateau",
    "Posterior",
    "Recording",
    "RecordingError",
    "Run",
    "Setup",
    "SetupError",
    "SharedFit",
    "TraceFit",
    "TrackedStack",
    "calibrate",
    "choose_model",
    "crosscheck",
    "diagnose",
    "extension_offset",
    "fit_by_method",
    "fit_together",
    "fit_trace",
    "force_extension",
    "freely_jointed_chain",
    "load",
    "molecule",
    "read_setup",
    "run",
    "sample_posterior",
    "simulate",
    "subtract_drift",
    "track",
    "worm_like_chain",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'mtpipe' has no attribute {name!r}")
    return getattr(importlib.import_module(f"mtpipe.{_HOME[name]}"), name)

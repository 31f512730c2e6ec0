"""Forces that the setup knows beforehand: no part of the fit, which is compared with them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import linalg

from mtpipe.experiment.known_force import KnownForce
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import ConfiguredFit

# Most nats that known forces may speak against a fit: beyond, something else is wrong than what
# they are asked about.
MOST_NATS = 10.0
# Relative error added to known forces: the fit's coordinates have no more digits.
LEAST_RELATIVE_STDERR = 1e-4


def ln_off(force_pN: FloatArray, known: Sequence[KnownForce | None]) -> FloatArray:
    """(plateaus,) ln of a force over the known one; nan where none is known."""
    return np.array(
        [
            math.nan if one is None else math.log(force / one.force_pN)
            for force, one in zip(force_pN.tolist(), known, strict=True)
        ]
    )


def relative_stderr(known: Sequence[KnownForce | None]) -> FloatArray:
    """(plateaus,) relative standard errors of known forces; nan where none is known."""
    return np.array(
        [math.nan if one is None else one.stderr_pN / one.force_pN for one in known], dtype=float
    )


def known_force_nats(fit: ConfiguredFit) -> float:
    """ln of how likely the known forces are beside the fitted ones, up to a constant; at least −10.

    Errors of known forces are taken as common to all plateaus, as those of a calibration are.
    """
    known = fit.model.known_forces
    off = ln_off(fit.force_pN, known) if known else np.empty(0)
    there = np.isfinite(off)
    if not there.any():
        return 0.0
    plateaus = len(off)
    covariance = fit.covariance[:plateaus, :plateaus][np.ix_(there, there)]
    common = relative_stderr(known)[there]
    covariance = covariance + np.outer(common, common)
    covariance += LEAST_RELATIVE_STDERR**2 * np.eye(len(common))
    nats = -0.5 * float(off[there] @ linalg.solve(covariance, off[there]))
    return max(-MOST_NATS, nats)


def prior_scatter(fit: ConfiguredFit, random: np.random.Generator) -> FloatArray:
    """(plateaus,) scatter of ln force by errors of stated values, which a simulation lacks.

    A recording's stated values err: with priors of information P and all information I that moves
    the fit by I⁻¹ √P g, with g normal of variance 1. A simulation of the fit is instead always
    moved towards what is stated, by the pulls of the priors in the place of −g.
    """
    plateaus = fit.model.plateaus
    moved = np.zeros(plateaus)
    pulls = fit.model.pulls(fit.theta)
    for k, parameter in enumerate(fit.model.parameters):
        if parameter.prior is not None:
            slope = fit.covariance[:plateaus, plateaus + k] / parameter.prior[1]
            moved += slope * (random.normal() - pulls[k])
    return moved

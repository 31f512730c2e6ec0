"""Gradient and Fisher information of a configured experiment's likelihood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import PlateauData
from mtpipe.joint_fit.expectation import (
    Expectation,
)
from mtpipe.joint_fit.model import ConfiguredModel, random_part
from mtpipe.joint_fit.slopes import Slopes, ends_with_slopes, height_slopes, left_of_z, walk_slopes


def gradient_of(
    model: ConfiguredModel,
    data: Sequence[PlateauData],
    theta: FloatArray,
    expected: list[Expectation],
    derivatives: list[Slopes],
) -> FloatArray:
    """Gradient of ln likelihood × prior at θ, for any data of the same shape."""
    gradient = np.zeros(len(theta))
    heights = model.heights(data, expected, theta)
    for i, (one, here, slope) in enumerate(zip(data, expected, derivatives, strict=True)):
        ends = heights.ends[i]
        recorded = random_part(one, here, ends)
        excess = np.einsum("fab,fbc->fac", slope.inverse, recorded) - np.eye(3)
        weighted = excess * one.spectrum.ordinates[:, None, None]
        gradient[slope.rows] += np.einsum("kfab,fba->k", slope.whitened, weighted)
        if slope.walked.any():
            say = float(heights.end_pulls[i]), float(heights.end_sharpness[i])
            known = ends or ends_with_slopes(one, here, slope).with_heights(*say, here.walked_nm2)
            gradient[slope.rows] += 0.5 * slope.walked @ (known.pull**2 - np.diag(known.seen))
        if slope.course is not None:
            gradient[slope.rows] += slope.course.in_common(left_of_z(one, here, slope, ends))
    whitening = heights.whitening
    whitened = whitening.T @ heights.pulls
    gradient += height_slopes(derivatives, len(theta)).T @ whitened
    walks = walk_slopes(model, theta)
    if walks.any():
        gained = whitened @ model.wandering_beside_s @ whitened
        gained -= np.sum((whitening.T @ whitening) * model.wandering_beside_s)
        gradient += 0.5 * gained * walks
    pulls = model.pulls(theta)
    for k, parameter in enumerate(model.parameters):
        if parameter.prior is not None:
            gradient[model.plateaus + k] -= pulls[k] / parameter.prior[1]
    return gradient


def information_of(
    model: ConfiguredModel,
    theta: FloatArray,
    expected: list[Expectation],
    derivatives: list[Slopes],
) -> FloatArray:
    """Expected information about θ, priors included."""
    n = model.plateaus + len(model.parameters)
    information = np.zeros((n, n))
    for data, here, slope in zip(model.data, expected, derivatives, strict=True):
        flat = slope.whitened.reshape(len(slope.rows), -1)
        turned = np.swapaxes(slope.whitened, 2, 3)
        weighted = (turned * data.spectrum.ordinates[:, None, None]).reshape(len(slope.rows), -1)
        information[np.ix_(slope.rows, slope.rows)] += flat @ weighted.T
        if slope.walked.any():
            seen = ends_with_slopes(data, here, slope).seen
            of_ends = 0.5 * slope.walked @ seen**2 @ slope.walked.T
            information[np.ix_(slope.rows, slope.rows)] += of_ends
        if slope.course is not None:
            known = 2 * data.spectrum.ordinates * slope.inverse[:, 2, 2]
            of_course = slope.course.in_common_with_itself(data.spectrum.per_ordinate(known))
            information[np.ix_(slope.rows, slope.rows)] += of_course
    whitening = model.heights(model.data, expected, theta).whitening
    heights = whitening @ height_slopes(derivatives, n)
    information += heights.T @ heights
    walks = walk_slopes(model, theta)
    if walks.any():
        wandering = whitening @ model.wandering_beside_s @ whitening.T
        information += 0.5 * float(np.sum(wandering**2)) * np.outer(walks, walks)
    for k, parameter in enumerate(model.parameters):
        if parameter.prior is not None:
            information[model.plateaus + k, model.plateaus + k] += parameter.prior[1] ** -2.0
    return information

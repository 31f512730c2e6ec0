"""Whether recorded z has another scale above some height.

Look-up tables with a kink do that, and optics that distort; no effect of the catalogue describes
it. As every plateau has its own force, a change with the height can be mistaken for an effect that
changes with the force.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy import stats

from mtpipe.diagnosis.heldout import share_gone
from mtpipe.diagnosis.size_words import compared
from mtpipe.effects.effect import plain
from mtpipe.experiment.changes import step_of, with_step
from mtpipe.experiment.description import Experiment
from mtpipe.experiment.step import Place, Seen
from mtpipe.ground.errors import FitError
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.fit import ConfiguredFit, fit_configured
from mtpipe.joint_fit.hypotheses import FIRST_ROUNDS, TRIED_NATS, FittedEffect, model_with
from mtpipe.joint_fit.model import ConfiguredModel
from mtpipe.physics.camera import Camera

# Scales that differ by more are no matter of optics.
MOST_BENT = 0.33
NUMBERS = 2
# A bend is reported where it would explain half of the misfit.
TOLD_SHARE = 0.5


@dataclass(frozen=True)
class BentScale:
    """Above `from_nm` z is recorded larger by a share, `relative`, than below.

    Of Gaussian z, with u its mean's distance from the bend in standard deviations σ: the mean of
    max(z − bend, 0) is σ (φ(u) + u Φ(u)), and it goes with z by Φ(u) (Booton 1954, statistical
    linearization).
    """

    place: ClassVar[Place] = "optics"
    relative: float = 0.0
    from_nm: float = 0.0

    def expected(self, seen: Seen, force_pN: float, thermal_energy_pN_nm: float) -> Seen:
        """z larger by the share of the time above, and its mean by what that adds."""
        sigma = math.sqrt(float(seen.covariance_nm2[:, 2, 2].sum()))
        u = (seen.height_nm - self.from_nm) / sigma
        above = 0.5 * math.erfc(-u / math.sqrt(2))
        density = math.exp(-(u**2) / 2) / math.sqrt(2 * math.pi)
        larger = seen.through(np.diag([1.0, 1.0, 1 + self.relative * above]))
        height = seen.height_nm + self.relative * sigma * (density + u * above)
        return replace(larger, height_nm=height)

    def played(
        self,
        position_nm: FloatArray,
        force_pN: FloatArray,
        camera: Camera,
        thermal_energy_pN_nm: float,
        random: np.random.Generator,
    ) -> FloatArray:
        """z larger above the bend."""
        bent = position_nm.copy()
        bent[:, 2] += self.relative * np.maximum(bent[:, 2] - self.from_nm, 0.0)
        return bent


def bent_scale_of(experiment: Experiment) -> BentScale:
    """The experiment's bend; one that bends nothing where it has none."""
    return step_of(experiment, BentScale) or BentScale()


@dataclass(frozen=True, eq=False)
class Bend:
    """A fit with another scale of z above some height, its last two coordinates."""

    fit: ConfiguredFit

    @property
    def relative(self) -> tuple[float, float]:
        """What the scale above is more than below, and the standard error."""
        stderr = math.sqrt(max(float(self.fit.covariance[-NUMBERS, -NUMBERS]), 0.0))
        return float(self.fit.theta[-NUMBERS]), stderr

    @property
    def from_nm(self) -> float:
        """The height, as recorded."""
        experiment = self.fit.model.described(self.fit.theta)
        return bent_scale_of(experiment).from_nm + experiment.optics.z_zero_nm

    @property
    def above(self) -> tuple[int, ...]:
        """Indices of the plateaus whose mean height is above the bend."""
        return tuple(
            i
            for i, expected in enumerate(self.fit.expected)
            if expected.extension_nm > self.from_nm
        )

    @property
    def words(self) -> str:
        """The scale and the height."""
        more, stderr = self.relative
        size = compared(math.log1p(more), stderr / (1 + more), "larger", "smaller")
        return f"a scale of z that is {size} above {self.from_nm:.0f} nm"


@dataclass(frozen=True, eq=False)
class Beside:
    """A bend beside what a fit has.

    Attributes
    ----------
    gain : rise of ln likelihood. penalty : what its numbers cost. share : of the misfit that is
        gone.
    """

    bend: Bend
    gain: float
    penalty: float
    share: float

    @property
    def explains_most(self) -> bool:
        """Whether it earns its numbers, and most of the misfit is gone with it."""
        return self.gain > self.penalty and self.share >= TOLD_SHARE

    @property
    def p_value(self) -> float:
        """Chance of such a gain where there is no bend (Wilks 1938)."""
        return float(stats.chi2.sf(2 * self.gain, NUMBERS))


@dataclass(frozen=True, eq=False)
class Instead:
    """A bend in the place of effects; `lead` : by how many nats it is likelier, after BIC."""

    bend: Bend
    replaced: tuple[FittedEffect, ...]
    lead: float


def bend_beside(fit: ConfiguredFit, near: Bend | None = None) -> Beside | None:
    """The best bend beside what a fit has; None where none can be fitted.

    Parameters
    ----------
    near : another bend, whose forces it may have too: those that were fitted without one may have
        taken up what is wrong with the heights.
    """
    starts = [(fit.theta, 0.0), (fit.theta, 1.0)]
    if near is not None:
        forces = near.fit.theta[: fit.model.plateaus]
        starts.append((np.concatenate([forces, fit.theta[fit.model.plateaus :]]), 1.0))
    begun = (_fitted(fit.model, theta, part) for theta, part in starts)
    found = [one for one in begun if one is not None]
    if not found:
        return None
    bent = max(found, key=lambda one: one.log_likelihood)
    gain = bent.log_likelihood - fit.log_likelihood
    return Beside(Bend(bent), gain, _penalty(fit), share_gone(fit, bent))


def bend_instead(
    without: ConfiguredFit, named: Sequence[FittedEffect], fit: ConfiguredFit
) -> Instead | None:
    """The bend that does best in the place of effects, one or all; None where none can be fitted.

    Parameters
    ----------
    without : fit without any of the effects. named : these. fit : with all of them.
    """
    found: Instead | None = None
    for replaced in _parts(named):
        others = [one for one in named if one not in replaced]
        try:
            bent = _fitted(*model_with(without, others, fit), part=1.0)
        except (FitError, ValueError):
            continue
        if bent is None:
            continue
        saved = sum(one.penalty for one in replaced) - _penalty(fit)
        lead = bent.log_likelihood - fit.log_likelihood + saved
        if found is None or lead > found.lead:
            found = Instead(Bend(bent), replaced, lead)
    return found


def _parts(named: Sequence[FittedEffect]) -> Iterator[tuple[FittedEffect, ...]]:
    """Each effect, and all of them."""
    yield from ((one,) for one in named)
    if len(named) > 1:
        yield tuple(named)


def _penalty(fit: ConfiguredFit) -> float:
    return 0.5 * NUMBERS * math.log(fit.model.ordinates)


def _fitted(model: ConfiguredModel, theta: FloatArray, part: float) -> ConfiguredFit | None:
    """A model with a bend as well, from where its coordinates are; None where it cannot be fitted.

    It begins half-way between any two neighbouring heights, with a part of what the heights ask
    for.
    """
    try:
        expected = [one.extension_nm for one in model.all_expected(theta)]
    except (FitError, ValueError):
        return None
    recorded = np.array([float(data.mean_nm[2]) for data in model.data])
    missed = recorded - np.array(expected)
    heights = np.unique(recorded)
    begun: list[ConfiguredFit] = []
    for low, high in itertools.pairwise(heights.tolist()):
        from_nm = 0.5 * (low + high)
        over = np.maximum(recorded - from_nm, 0.0)
        asked = float(over @ missed / (over @ over))
        excess = part * float(np.clip(asked, -MOST_BENT / 2, MOST_BENT / 2))
        parameters = (
            plain("excess of z's scale", "", excess, (-MOST_BENT, MOST_BENT), 1e-3, _bent),
            plain("z's scale changes at", "nm", from_nm, (heights[0], heights[-1]), 0.1, _bent_at),
        )
        bent = replace(model, parameters=(*model.parameters, *parameters))
        start = np.concatenate([theta, [excess, from_nm]])
        with contextlib.suppress(FitError, ValueError):
            begun.append(fit_configured(bent, start, rounds=FIRST_ROUNDS, arrived=TRIED_NATS))
    if not begun:
        return None
    best = max(begun, key=lambda one: one.log_likelihood)
    try:
        return fit_configured(best.model, best.theta, arrived=TRIED_NATS)
    except (FitError, ValueError):
        return None


def _bent(experiment: Experiment, value: float) -> Experiment:
    return with_step(experiment, replace(bent_scale_of(experiment), relative=value))


def _bent_at(experiment: Experiment, value: float) -> Experiment:
    return with_step(experiment, replace(bent_scale_of(experiment), from_nm=value))

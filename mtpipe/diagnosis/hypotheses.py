"""Fits of hypotheses: the configured experiment with one more effect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mtpipe.configured.fit import ConfiguredFit, fit_configured
from mtpipe.effects.effect import Effect, Evidence, Hypothesis
from mtpipe.errors import FitError


@dataclass(frozen=True, eq=False)
class Tried:
    """An effect with its best hypothesis fitted.

    Attributes
    ----------
    gain : rise of ln likelihood over the fit without the effect.
    penalty : what its parameters cost, half their number times ln of the number of ordinates (BIC).
    first : index of the effect's first parameter among the model's.
    """

    effect: Effect
    hypothesis: Hypothesis
    fit: ConfiguredFit
    gain: float
    penalty: float
    first: int

    @property
    def net(self) -> float:
        """Gain less penalty, in nats; half of −ΔBIC."""
        return self.gain - self.penalty


def with_hypothesis(fit: ConfiguredFit, hypothesis: Hypothesis) -> ConfiguredFit:
    """Fit a hypothesis, beginning where the fit without it stands."""
    model = replace(
        fit.model,
        experiment=hypothesis.experiment,
        parameters=(*fit.model.parameters, *hypothesis.parameters),
    )
    start = np.concatenate([fit.theta, [p.start for p in hypothesis.parameters]])
    return fit_configured(model, start)


def try_effects(
    fit: ConfiguredFit, effects: Sequence[Effect], evidence: Evidence
) -> Iterator[Tried]:
    """Fit every effect that applies, each with the best of its hypotheses."""
    ordinates = sum(float(data.spectrum.ordinates.sum()) * 3 for data in fit.model.data)
    taken = {parameter.name for parameter in fit.model.parameters}
    for effect in effects:
        best: Tried | None = None
        for hypothesis in effect.hypotheses(fit.model.experiment, evidence):
            if taken & {parameter.name for parameter in hypothesis.parameters}:
                continue
            try:
                fitted = with_hypothesis(fit, hypothesis)
            except (FitError, ValueError, np.linalg.LinAlgError):
                continue
            gain = fitted.log_likelihood - fit.log_likelihood
            if best is None or gain > best.gain:
                penalty = 0.5 * len(hypothesis.parameters) * float(np.log(ordinates))
                first = len(fit.model.parameters)
                best = Tried(effect, hypothesis, fitted, gain, penalty, first)
        if best is not None:
            yield best

"""What was found about one bead: the effects named, and the forces with them."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from mtpipe.crosschecking.check import CLEARLY_CONSISTENT, BeadCheck
from mtpipe.crosschecking.prepared_bead import support
from mtpipe.diagnosis.corrections.correction import Correction
from mtpipe.diagnosis.evidence import evidence_of
from mtpipe.diagnosis.mixture import Mixture
from mtpipe.diagnosis.prior import with_one_more
from mtpipe.diagnosis.refit import other_formulas
from mtpipe.diagnosis.unexplained import Rejected, Unexplained, unexplained
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.joint_fit.fit import ConfiguredFit
from mtpipe.joint_fit.hypotheses import FittedEffect

# Chance of a false alarm that is accepted per bead.
ALARM_P = 0.004
# A recording that had raised an alarm agrees with its simulation from this p on.
AGREES_P = 0.01
# Causes whose ln likelihood, net gain or held-out gain differ by less than 5 nats cannot be told
# apart. A wrong cause is better by 5 nats once in 150 recordings at most, as the mean of a
# likelihood ratio is 1. Hopping is seen to hop, and heights are seen to be off, from 5 nats on.
ALIKE_NATS = 5.0
# Nats of ln likelihood that count as one: ordinates of a spectrum are not quite independent
# (`python workflows/crosscheck/temperature.py`).
TEMPERATURE = 1.0
# Weight of something without a name that looks just like a named effect, over the effect's: one in
# 45 recordings with an effect outside the catalogue, or fewer, is given a name (docs/proof.md).
IMITATED = 0.02
# An alternative that is worse by 50 nats weighs nothing, one that is better by 50 weighs all.
CERTAIN_NATS = 50.0


@dataclass(frozen=True, eq=False, repr=False)
class Alternative:
    """Another effect fitted in a named one's place; `nats` : its net gain less that one's there."""

    found: FittedEffect
    nats: float

    def __repr__(self) -> str:
        return f"Alternative {self.found.effect.name}: {number(self.nats, 2)} nats"


@dataclass(frozen=True, eq=False, repr=False)
class Named:
    """An effect that is named.

    Attributes
    ----------
    found : its fit, the effects named before it included, or the correction of the traces.
    alternatives : effects that the recording cannot tell from it.
    before, after : the check without and with it.
    heldout_gain : ln likelihood gained on time that was not fitted, in nats; nan where the effect
        is none of the spectrum's, or the halves cannot be compared.
    others : a sentence on what the recording's other beads say of it; empty where it is the bead's
        own affair.
    odds_against : weight of all that is neither this effect nor an alternative, over this one's;
        where the rivals could not be fitted, of what looks just like it.
    """

    found: FittedEffect | Correction
    alternatives: tuple[Alternative, ...]
    before: BeadCheck
    after: BeadCheck
    heldout_gain: float
    others: str = ""
    odds_against: float = IMITATED

    def __repr__(self) -> str:
        names = " or ".join((self.name, *self.equivalent))
        p_values = (number(check.p_value, 2) for check in (self.before, self.after))
        return f"Named {names}: probability {self.probability:.2f}, p {' → '.join(p_values)}"

    @property
    def equivalent(self) -> tuple[str, ...]:
        """Names of the alternatives."""
        return tuple(other.found.effect.name for other in self.alternatives)

    @property
    def probability(self) -> float:
        """How sure the name is, beside all that was weighed."""
        return 1 / (1 + self._weight_of_alternatives + self.odds_against)

    @property
    def probability_of_any(self) -> float:
        """How sure it is that it is this one or an alternative."""
        return self.probability * (1 + self._weight_of_alternatives)

    @property
    def _weight_of_alternatives(self) -> float:
        """Of all together, over this one's."""
        nats = (min(other.nats, CERTAIN_NATS) for other in self.alternatives)
        return sum(math.exp(one / TEMPERATURE) for one in nats)

    @property
    def form(self) -> str:
        """Of a term; empty for an effect."""
        return self.found.effect.form if isinstance(self.found, FittedEffect) else self.found.form

    @property
    def name(self) -> str:
        """As FORMATS section 5 has it; of a term, its form and axis."""
        return self.found.effect.name if isinstance(self.found, FittedEffect) else self.found.name


@dataclass(frozen=True, eq=False, repr=False)
class Explanation:
    """What was found about one bead.

    Attributes
    ----------
    before : check against the configured experiment. after : with the effects named.
    verdict : "consistent", "explained", "described" (terms are among what is named) or
        "unexplained".
    nearest : the effect that came nearest and why it was rejected, where the verdict is
        "unexplained"; None if none could be tried or no more are named at once.
    """

    before: BeadCheck
    after: BeadCheck
    named: tuple[Named, ...]
    verdict: str
    nearest: Rejected | None

    def __repr__(self) -> str:
        causes = " and ".join(one.name for one in self.named_once)
        by = f" by {causes}" if causes else ""
        p_values = (number(check.p_value, 2) for check in (self.before, self.after))
        return (
            f"Explanation of {self.before.case.bead}: {self.verdict}{by}; p {' → '.join(p_values)}"
        )

    @property
    def named_once(self) -> tuple[Named, ...]:
        """What is named, each name once: what is seen in traces and in spectra is one cause."""
        return tuple({one.name: one for one in self.named}.values())

    @property
    def effects(self) -> tuple[Named, ...]:
        """What is named that has a name in the catalogue."""
        return tuple(one for one in self.named if not one.form)

    @property
    def terms(self) -> tuple[Named, ...]:
        """What has a form only."""
        return tuple(one for one in self.named if one.form)

    @property
    def fit(self) -> ConfiguredFit:
        """The fit with the effects named."""
        return self.after.case.fit

    @property
    def force_pN(self) -> FloatArray:
        """(plateaus,) mean over the chain's formulas, each with the weight of its ln likelihood, as
        no setup says which it means.
        """
        return np.asarray(self.fit.force_pN + self._of_formulas.mean_shift())

    @property
    def force_stderr_pN(self) -> FloatArray:
        """(plateaus,) half the width of the intervals about `force_pN` that hold 68 %.

        Alternatives and the chain's other formula stand in them with the weight that their ln
        likelihood after BIC has beside the one that was taken; formulas by likelihood alone.
        """
        mine, parts = self.fit, self._of_formulas
        for one in self.named:
            parts = parts.or_else(
                [
                    (
                        min(other.nats, CERTAIN_NATS),
                        other.found.fit.force_pN - mine.force_pN,
                        other.found.fit.force_stderr_pN,
                    )
                    for other in one.alternatives
                ]
            )
        return parts.about(self._of_formulas.mean_shift()).half_width()

    @functools.cached_property
    def _of_formulas(self) -> Mixture:
        """The fit's forces by each formula of the chain."""
        mine = self.fit
        return Mixture.of_one(mine.force_stderr_pN).or_else(
            [
                (min(nats, CERTAIN_NATS), fit.force_pN - mine.force_pN, fit.force_stderr_pN)
                for fit, nats in self._other_formulas
            ]
        )

    @functools.cached_property
    def _other_formulas(self) -> list[tuple[ConfiguredFit, float]]:
        """Fits with the chain's other formulas, and by how many nats they are the likelier.

        A cause too weak to be named may make the wrong one the likelier, so each formula counts
        with what one more cause would gain beside it. Beside terms none is likelier: they stand for
        something that is not known, nor is what it does to the heights by which the formulas are
        told apart.
        """
        others = other_formulas(self.fit)
        if self.terms:
            return [(fit, 0.0) for fit in others]
        fits = [self.fit, *others]
        nats = np.array([support(fit) for fit in fits])
        # of a large misfit one cause of several gains much by whatever it can
        if self.verdict != "unexplained":
            evidence = evidence_of(self.after)
            nats += [with_one_more(fit, evidence) for fit in fits]
        return list(zip(others, (nats[1:] - nats[0]).tolist(), strict=True))

    @functools.cached_property
    def unexplained(self) -> Unexplained | None:
        """Place, size and shape of what is left; None where nothing is."""
        if self.verdict != "unexplained":
            return None
        return unexplained(self.after, self.nearest, beside=bool(self.named))


def ln_of(p_value: float) -> float:
    """ln of a p-value, at most that of `CLEARLY_CONSISTENT`: above it no p-value is better than
    another.
    """
    return math.log(max(min(p_value, CLEARLY_CONSISTENT), 1e-300))


def agrees(after: BeadCheck, before: BeadCheck) -> bool:
    """Whether recording and simulation agree with the effects that are named.

    Parameters
    ----------
    after : with these. before : the bead's first check.
    """
    return after.p_value >= (AGREES_P if before.p_value < ALARM_P else ALARM_P)

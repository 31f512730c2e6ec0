"""An estimate: a number that knows its uncertainty, its unit, and whether it may be trusted."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mtpipe.ground.written_numbers import EMPTY, number, with_arms

# Quantiles that bound the central 68 %: those of one standard error to either side.
CENTRAL_68 = (0.1587, 0.8413)
Status = Literal[
    "ok", "fixed", "at_bound", "not_identified", "not_converged", "unlike_model", "zero_force",
    "not_one_state", "refused",
]  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """A value with standard error and central 68 % interval.

    Of a posterior: median, half the width of the central 68 %, and that interval.

    `status` is "ok" (a number to use); "fixed" (not fitted, taken as known); "at_bound" (the fit
    ended at a physical limit, such as zero noise: the interval is one-sided); "not_identified" (the
    data do not determine it: `value` is nan, the interval is what remains possible, and `tied_to`
    names the quantities that only are known together); "not_converged"; "unlike_model" (the
    spectrum is not the one that was fitted, so the number means little); "zero_force" (nought is
    within what it may be, or the motion shows no return). Of a trace as a whole also
    "not_one_state" (the plateau mixes several states) and "refused" (no tethered bead's).
    """

    value: float
    stderr: float
    interval: tuple[float, float]
    unit: str
    method: str
    status: Status = "ok"
    tied_to: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        low, high = self.interval
        if not (math.isnan(low) or math.isnan(high)) and low > high:
            raise ValueError(f"interval ({low}, {high}) is upside down")

    def __repr__(self) -> str:
        """The estimate as a person writes it: `8.31 ± 0.12 pN`, with its status unless "ok"."""
        (low, high), unit = self.interval, f" {self.unit}" if self.unit else ""
        status = "" if self.status == "ok" else f" ({self.status.replace('_', ' ')})"
        if math.isfinite(self.value):
            shown = with_arms(self.value, self.stderr, low, high, brief=False)
        elif math.isfinite(low):
            shown = (
                f"{number(low)} to {number(high)}" if math.isfinite(high) else f"> {number(low)}"
            )
        else:
            shown = EMPTY
        return f"{shown}{unit}{status}"

    def _repr_html_(self) -> str:
        low, high = self.interval
        interval = f"68 % interval {number(low, 4)} to {number(high, 4)} {self.unit}; {self.method}"
        return f'<span title="{html.escape(interval)}">{html.escape(repr(self))}</span>'

    @classmethod
    def missing(
        cls,
        unit: str,
        method: str,
        status: Status = "not_identified",
        *,
        interval: tuple[float, float] = (math.nan, math.nan),
        tied_to: tuple[str, ...] = (),
    ) -> Estimate:
        """An estimate of something that could not be determined."""
        return cls(math.nan, math.nan, interval, unit, method, status, tied_to)

    @classmethod
    def of_sample(
        cls, sample: NDArray[np.float64], unit: str, method: str, *, converged: bool
    ) -> Estimate:
        """Median of a posterior's sample (n,), its central 68 %, half of that as standard error.

        `converged` : whether the chain is long enough to be believed; "not_converged" if not.
        """
        low, middle, high = (float(q) for q in np.quantile(sample, sorted((*CENTRAL_68, 0.5))))
        status: Status = "ok" if converged else "not_converged"
        return cls(middle, (high - low) / 2, (low, high), unit, method, status)

    def scaled(self, factor: float, unit: str) -> Estimate:
        """The estimate times an exactly known positive factor."""
        low, high = self.interval
        return Estimate(
            self.value * factor,
            self.stderr * factor,
            (low * factor, high * factor),
            unit,
            self.method,
            self.status,
            self.tied_to,
        )

    def widened(self, relative: float) -> Estimate:
        """The estimate of a positive quantity with one more relative standard error."""
        if not relative > 0 or not 0 < self.value < math.inf:
            return self
        low, high = (
            self.value * math.exp(sign * math.hypot(math.log(bound / self.value), relative))
            if bound > 0
            else bound
            for sign, bound in zip((-1, 1), self.interval, strict=True)
        )
        stderr = math.hypot(self.stderr, relative * self.value)
        return replace(self, stderr=stderr, interval=(low, high))

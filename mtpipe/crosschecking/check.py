"""The cross-check of one bead: the battery on the recording and on its simulated counterparts."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mtpipe.crosschecking.battery import agreement, shape, spectral
from mtpipe.crosschecking.battery.catalogue import GROUPS, KINDS
from mtpipe.crosschecking.battery.observed import Fixed, Observed
from mtpipe.crosschecking.battery.statistic import Statistic
from mtpipe.crosschecking.curves import Curve, CurveSet
from mtpipe.crosschecking.nulls import (
    SMALLEST_P,
    Nulls,
    Together,
    rounds_correlation,
    second_round_p_value,
    together,
)
from mtpipe.crosschecking.prepared_bead import PreparedBead, described
from mtpipe.crosschecking.twin import Twin, TwinMaker
from mtpipe.ground.errors import FitError
from mtpipe.ground.processes import Sent, in_order
from mtpipe.ground.types import FloatArray
from mtpipe.ground.written_numbers import number
from mtpipe.joint_fit.data import PlateauData, plateau_data
from mtpipe.joint_fit.expectation import Expectation, changed_spectra
from mtpipe.joint_fit.fit import nearby_fit
from mtpipe.joint_fit.known_forces import ln_off, relative_stderr

# The number of simulations grows through these until the answer is clear.
ROUNDS = (12, 24, 48, 120)
ENOUGH = 48
# p-values that make it clear. Those of fewer simulations scatter more: they have to be larger to
# say that recording and simulation agree, by number of simulations, and far smaller to say that
# they do not.
CLEARLY_CONSISTENT, CLEARLY_NOT, FAR_OFF = 0.2, 1e-4, 1e-8
CONSISTENT_BY_FEW = {12: 0.5, 24: 0.3}
# Simulations whose curves are drawn.
DRAWN = 24
MOMENTS = ("skewness", "kurtosis")
# Twice its cutoff the low-pass of the drift takes 6 % of a motion's amplitude.
CLEAR_OF_CUTOFF = 2.0


@dataclass(frozen=True, eq=False, repr=False)
class BeadCheck:
    """A bead beside its simulated counterparts.

    Attributes
    ----------
    statistics : each with its place. observed : the recording's values.
    simulated : (simulations, statistics). p_values : of each by itself.
    overall : all together. curves : to draw; empty where not asked for.
    """

    case: PreparedBead
    statistics: tuple[Statistic, ...]
    observed: FloatArray
    simulated: FloatArray
    p_values: FloatArray
    overall: Together
    curves: tuple[Curve, ...] = ()

    def __repr__(self) -> str:
        return (
            f"BeadCheck of {self.case.bead}: p = {number(self.p_value, 2)} by "
            f"{len(self.statistics)} statistics and {len(self.simulated)} simulations"
        )

    @property
    def p_value(self) -> float:
        """p-value of the whole battery, corrected for the number of statistics."""
        return self.overall.p_value


def check_bead(
    case: PreparedBead,
    random: np.random.Generator,
    *,
    rounds: tuple[int, ...] = ROUNDS,
    begun: BeadCheck | None = None,
    with_curves: bool = False,
) -> BeadCheck:
    """Compare a bead with simulations of the experiment fitted to it.

    Parameters
    ----------
    random : of the simulations.
    rounds : numbers of simulations after which it may be clear what comes out.
    begun : a check of the same case, whose simulations count.
    with_curves : keep the curves of `DRAWN` simulations.
    """
    recorded = recorded_of(case)
    battery = _Battery(case, recorded)
    statistics, observed = battery.values(recorded)
    maker = TwinMaker(case)
    simulated: list[FloatArray] = [] if begun is None else list(begun.simulated)
    curves = CurveSet(recorded) if with_curves else None
    # for curves alone, so that what is found does not depend on whether they are drawn
    (beside,) = random.spawn(1)
    open_as_yet: Together | None = None
    shared = Sent((battery, curves))
    for goal in rounds:
        numbers = range(len(simulated), goal)
        draws = _Draws(maker, random)
        arguments = ((shared, draws.next(), k < DRAWN) for k in numbers)
        try:
            for values, drawn in in_order(_looked_at, arguments):
                simulated.append(values)
                if curves is not None and drawn is not None:
                    curves.add(drawn)
        except (FitError, ValueError):
            draws.back_to(len(simulated) - numbers.start)
            raise
        p_values, overall = _judged(statistics, observed, np.array(simulated))
        if open_as_yet is not None:
            correlation = rounds_correlation(open_as_yet.own, overall.own[: len(open_as_yet.own)])
            p_value = second_round_p_value(overall.p_value, CLEARLY_CONSISTENT, correlation)
            overall = replace(overall, p_value=p_value)
        if overall.p_value > CONSISTENT_BY_FEW.get(goal, CLEARLY_CONSISTENT):
            break
        if overall.p_value < (FAR_OFF if goal < ENOUGH else CLEARLY_NOT):
            break
        if goal >= ENOUGH:
            open_as_yet = overall
    if curves is not None:
        for _ in range(DRAWN - len(simulated)):
            curves.add(curves.values(battery.simulated(maker.draw(beside))))
    return BeadCheck(
        case,
        statistics,
        observed,
        np.array(simulated),
        p_values,
        overall,
        () if curves is None else curves.curves(),
    )


class _Draws:
    """Simulations drawn in order from one generator.

    Some are drawn before earlier ones are evaluated. If an evaluation fails, the generator is set
    back to its state right after that simulation was drawn, as if none had been drawn ahead.
    """

    def __init__(self, maker: TwinMaker, random: np.random.Generator) -> None:
        self._maker, self._random = maker, random
        self._left: list[dict[str, Any]] = []

    def next(self) -> Twin:
        twin = self._maker.draw(self._random)
        self._left.append(dict(self._random.bit_generator.state))
        return twin

    def back_to(self, number: int) -> None:
        if number < len(self._left):
            self._random.bit_generator.state = self._left[number]


def _looked_at(
    shared: Sent[tuple[_Battery, CurveSet | None]], twin: Twin, drawn: bool
) -> tuple[FloatArray, list[FloatArray] | None]:
    """Values of all statistics of a simulation, and of its curves where they are wanted."""
    battery, curves = shared.value()
    seen = battery.simulated(twin)
    values = battery.values(seen)[1]
    return values, curves.values(seen) if drawn and curves is not None else None


def comparable_p_values(one: BeadCheck, other: BeadCheck) -> tuple[float, float]:
    """p-values of two checks, from equally many simulations if either has fewer than `ENOUGH`.

    Tails are those of Student's law: with fewer simulations the same deviation is less significant.
    """
    simulations = min(len(one.simulated), len(other.simulated))
    if simulations >= ENOUGH:
        return one.p_value, other.p_value
    first, second = (
        _judged(check.statistics, check.observed, check.simulated[:simulations])[1].p_value
        for check in (one, other)
    )
    return first, second


def p_value_but_moments(check: BeadCheck, along: str = "") -> float:
    """p-value of a check by all statistics but skewness and kurtosis.

    One swing of a slow trace makes either large, and some fifty simulations may have none.

    Parameters
    ----------
    along : only statistics that are about this axis, alone or with another.
    """
    rest = [
        i
        for i, statistic in enumerate(check.statistics)
        if statistic.kind not in MOMENTS and along in statistic.axis
    ]
    left = tuple(check.statistics[i] for i in rest)
    return _judged(left, check.observed[rest], check.simulated[:, rest])[1].p_value


def foreseen_p_value(check: BeadCheck, case: PreparedBead) -> float:
    """Approximate p-value of changed traces, without simulations of their own: those of the traces
    before the change stand in.

    Only statistics that both have count, and only those that are taken relative to the fit, so that
    a change of the fitted forces does not move them.

    Parameters
    ----------
    check : of the traces before the change. case : with the changed traces, fitted.
    """
    recorded = recorded_of(case)
    statistics, observed = _Battery(case, recorded).values(recorded)
    before, there = _numbered(check.statistics), _numbered(statistics)
    both = [key for key in there if key in before and KINDS[str(key[0])].relative]
    new, old = [there[key] for key in both], [before[key] for key in both]
    judged = tuple(statistics[i] for i in new)
    return _judged(judged, observed[new], check.simulated[:, old])[1].p_value


def _numbered(statistics: tuple[Statistic, ...]) -> dict[tuple[object, ...], int]:
    """Index of each statistic, by its place and its number among those of the same place."""
    found: dict[tuple[object, ...], int] = {}
    count: dict[tuple[object, ...], int] = {}
    for i, statistic in enumerate(statistics):
        kind = statistic.kind, statistic.axis, statistic.plateaus, statistic.pooled
        count[kind] = count.get(kind, 0) + 1
        found[*kind, count[kind]] = i
    return found


def _judged(
    statistics: tuple[Statistic, ...], observed: FloatArray, simulated: FloatArray
) -> tuple[FloatArray, Together]:
    """p-value of each statistic, and that of all together."""
    upper = np.array(
        [KINDS[statistic.kind].only_large(statistic.pooled) for statistic in statistics]
    )
    pooled = np.array([statistic.pooled for statistic in statistics])
    kinds = [(statistic.kind, statistic.pooled) for statistic in statistics]
    number_of = np.array([kinds.index(kind) for kind in kinds])
    nulls = Nulls(simulated, upper, number_of)
    # where the fitted experiment is so far off that a statistic has no value, p is the least
    p_values = np.nan_to_num(nulls.p_values(observed), nan=SMALLEST_P)
    own = np.nan_to_num(nulls.own_p_values(), nan=1.0)
    return p_values, together(p_values, own, [pooled, ~pooled])


class _Battery:
    """The battery with what does not change from simulation to simulation."""

    def __init__(self, case: PreparedBead, recorded: list[Observed]) -> None:
        self.case = case
        cutoffs = case.fit.model.subtraction.cutoff_hz
        self.fixed = Fixed(
            spectral.band_edges_hz(recorded),
            shape.smooth_periods_nm(recorded),
            # subtracted frame by frame, nothing is left of the reference
            [CLEAR_OF_CUTOFF * (math.inf if c is None else c) for c in cutoffs],
            _projections(case),
            _force_weight(case),
        )

    def simulated(self, twin: Twin) -> list[Observed]:
        """A simulation, reduced and fitted as the recording was."""
        case = self.case
        data = tuple(
            plateau_data(x, case.frame_s, phi, case.lines_hz)
            for x, phi in zip(twin.positions_nm, case.phi, strict=True)
        )
        again = nearby_fit(case.fit, data)
        off = np.log(again.force_pN / case.fit.force_pN) - twin.ln_force_misstated
        return _observed(case, twin.positions_nm, twin.references_nm, data, again.expected, off)

    def values(self, seen: list[Observed]) -> tuple[tuple[Statistic, ...], FloatArray]:
        """All statistics, and their values."""
        values = [value for group in GROUPS for value in group.values(seen, self.fixed)]
        return tuple(statistic for statistic, _ in values), np.array([value for _, value in values])


def recorded_of(case: PreparedBead) -> list[Observed]:
    """The recording, plateau by plateau, as the battery takes it."""
    fit, known = case.fit, case.fit.model.known_forces
    off = ln_off(fit.force_pN, known) if known else np.full(fit.model.plateaus, np.nan)
    return _observed(case, case.positions_nm, case.references_nm, fit.model.data, fit.expected, off)


def _observed(
    case: PreparedBead,
    positions: tuple[FloatArray, ...],
    references: tuple[FloatArray, ...] | None,
    data: tuple[PlateauData, ...],
    expected: list[Expectation],
    ln_force_off: FloatArray,
) -> list[Observed]:
    return [
        Observed(
            position,
            None if references is None else references[i],
            case.camera_offset_nm[i],
            data[i],
            expected[i],
            case.frame_s,
            float(ln_force_off[i]) if math.isfinite(ln_force_off[i]) else None,
        )
        for i, position in enumerate(positions)
    ]


def _force_weight(case: PreparedBead) -> FloatArray:
    """(plateaus,) one over the variance of ln of each force and of the known one's error."""
    fit, known = case.fit, case.fit.model.known_forces
    variance = (fit.force_stderr_pN / fit.force_pN) ** 2
    if known:
        variance = variance + np.nan_to_num(relative_stderr(known)) ** 2
    return np.asarray(1 / variance)


def _projections(case: PreparedBead) -> list[list[FloatArray]]:
    """Per plateau and axis, what turns a residual into changes of ln stiffness and ln friction."""
    found = []
    experiment = described(case)
    for i, data in enumerate(case.fit.model.data):
        here, force_pN = case.fit.expected[i].power, float(case.fit.force_pN[i])
        changes = changed_spectra(data, here, experiment.in_plateau(i), force_pN)
        found.append(
            [agreement.projections(changes[axis], data.spectrum.ordinates) for axis in range(3)]
        )
    return found

"""How far a fit is from the data, and what an effect gains where it was not fitted."""

from __future__ import annotations

from dataclasses import dataclass, replace

from mtpipe.crosschecking.check import BeadCheck
from mtpipe.crosschecking.prepared_bead import PreparedBead
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.data import PlateauData, plateau_data
from mtpipe.joint_fit.distance import missing_nats
from mtpipe.joint_fit.fit import ConfiguredFit, fit_configured
from mtpipe.joint_fit.model import ConfiguredModel

# A cause that is not named is reported as the nearest if it explains 90 % of the misfit: of what no
# name describes, the best name leaves a fifth or more.
MOST_OF_IT = 0.9


def explained_share(before: BeadCheck, after: BeadCheck) -> float:
    """Share of the misfit that is gone."""
    return share_gone(before.case.fit, after.case.fit)


def share_gone(before: ConfiguredFit, after: ConfiguredFit) -> float:
    """Share of one fit's misfit that is gone in another."""
    first, last = missing_nats(before), missing_nats(after)
    return 0.0 if first <= 0 else 1 - max(last, 0.0) / first


def heldout_gain(case: PreparedBead, without: ConfiguredFit, with_it: ConfiguredFit) -> float:
    """ln likelihood gained by an effect on the half of every plateau that was not fitted, and
    exchanged; nan where the halves are too short, or differ because the force changes.
    """
    if any(fit.model.experiment.magnets.courses for fit in (without, with_it)):
        return float("nan")
    halves = halves_of(case)
    if halves is None:
        return float("nan")
    gain = 0.0
    for fitted, left in ((0, 1), (1, 0)):
        for fit, sign in ((with_it, 1), (without, -1)):
            try:
                half = fit_configured(halves[fitted].of(fit.model), fit.theta)
                other = halves[left].of(fit.model)
                gain += sign * other.log_likelihood(other.all_expected(half.theta), half.theta)
            except (FitError, ValueError):
                return float("nan")
    return gain


@dataclass(frozen=True, eq=False)
class Half:
    """One half of every plateau: its data, and when it begins (`ConfiguredModel.begins_s`)."""

    data: tuple[PlateauData, ...]
    begins_s: tuple[float, ...]

    def of(self, model: ConfiguredModel) -> ConfiguredModel:
        """The model of these halves instead of whole plateaus."""
        return replace(model, data=self.data, begins_s=self.begins_s)


def halves_of(case: PreparedBead) -> tuple[Half, Half] | None:
    """First and second half of every plateau; None where these are too short."""
    first: list[PlateauData] = []
    second: list[PlateauData] = []
    for position, phi in zip(case.positions_nm, case.phi, strict=True):
        middle = len(position) // 2
        try:
            for half, rows in ((first, position[:middle]), (second, position[middle:])):
                half.append(plateau_data(rows, case.frame_s, phi, case.lines_hz))
        except FitError:
            return None
    begins = case.fit.model.begins_s
    middles = (begin + one.duration_s for begin, one in zip(begins, first, strict=True))
    return Half(tuple(first), begins), Half(tuple(second), tuple(middles))

"""An effect's fit made better before it is checked: from other starts, with another chain."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.crosschecking.prepared_bead import FORMULAS, preference
from mtpipe.experiment.changes import by_formula
from mtpipe.ground.errors import FitError
from mtpipe.joint_fit.fit import ConfiguredFit, first_guess, fit_configured


def begun_again(fit: ConfiguredFit) -> ConfiguredFit:
    """The fit gone on with, or from forces found afresh: the old ones suited the old experiment."""
    values = fit.theta[fit.model.plateaus :]
    parameters = tuple(
        replace(parameter, start=float(value))
        for parameter, value in zip(fit.model.parameters, values, strict=True)
    )
    model = replace(fit.model, parameters=parameters)
    fit = fit_configured(fit.model, fit.theta)
    try:
        fresh = fit_configured(model, first_guess(model))
    except (FitError, ValueError):
        return fit
    if fresh.log_likelihood <= fit.log_likelihood:
        return fit
    return replace(fresh, model=fit.model)


def best_formula(fit: ConfiguredFit) -> ConfiguredFit:
    """The same effects with the chain's formula that the data ask for."""
    return max([fit, *other_formulas(fit)], key=preference)


def other_formulas(fit: ConfiguredFit) -> list[ConfiguredFit]:
    """The same effects with the other formulas that the setup may mean."""
    experiment = fit.model.experiment
    fits = []
    for formula in FORMULAS:
        if formula != experiment.chain.formula_without_stretching:
            other = by_formula(experiment, formula)
            try:
                there = fit_configured(replace(fit.model, experiment=other), fit.theta)
                fits.append(begun_again(there))
            except (FitError, ValueError):
                continue
    return fits

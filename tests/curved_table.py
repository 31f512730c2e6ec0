"""Recordings whose look-up table of heights is curved (PHYSICS E28)."""

from dataclasses import replace

import numpy as np


def sloping(u, slope):
    """A table whose slope changes by this over one standard deviation."""
    return u + slope / 2 * (u**2 - 1)


def stepped(u, slope):
    """A table that is steeper in the middle of the heights by this (1: twice as steep), and has a
    mean slope of 1.
    """
    steps = slope * 0.4 * np.tanh(u / 0.4)
    return (u + steps) / (1 + np.nanmean(u * steps) / np.nanmean(u**2))


def with_table(raw, plateau, table, slope):
    """z of one plateau by a table of its heights in standard deviations."""
    xyz = raw.positions_nm["b1"].copy()
    rows = slice(raw.plateaus[plateau].start, raw.plateaus[plateau].stop)
    z = xyz[rows, 2]
    mean, sigma = np.nanmean(z), np.nanstd(z)
    xyz[rows, 2] = mean + sigma * table((z - mean) / sigma, slope)
    return replace(raw, positions_nm=raw.positions_nm | {"b1": xyz})

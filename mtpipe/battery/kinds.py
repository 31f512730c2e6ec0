"""The battery's statistics: what each is called, and which of its values count as unusual."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """One statistic.

    Attributes
    ----------
    line : of the map it belongs to; those of bands are named after their frequencies.
    words : what is compared.
    only_large : only large values are unusual, as of the largest step there is.
    relative : it is taken relative to what is fitted.
    """

    line: str
    words: str
    only_large: bool = False
    relative: bool = True


KINDS: Mapping[str, Kind] = {
    "psd_band": Kind("", "power"),
    "line": Kind("narrow lines", "the strongest narrow line", only_large=True),
    "second_line": Kind("narrow lines", "the second strongest narrow line", only_large=True),
    "allan_variance": Kind("Allan variance", "Allan variance (ln nm²)", relative=False),
    "correlation": Kind("correlation", "correlation of the two axes"),
    "fractional_pixel": Kind("pixel period", "strongest pattern with the period of a pixel (ln)"),
    "lost_frames": Kind("lost frames", "distance from the mean just before lost frames (ln)"),
    "reference_coherence": Kind(
        "reference motion", "correlation with the motion of the reference beads"
    ),
    "mean_trend": Kind("mean over time", "drift of the mean"),
    "mean_step": Kind("mean over time", "largest step of the mean", only_large=True),
    "mean_excursion": Kind("mean over time", "largest excursion of the mean", only_large=True),
    "variance_trend": Kind("variance over time", "trend of the variance"),
    "variance_step": Kind("variance over time", "largest step of the variance", only_large=True),
    "variance_spread": Kind("variance over time", "variation of the variance", only_large=True),
    "quietest_second": Kind("variance over time", "variance of the quietest second"),
    "irreversibility": Kind("time reversal", "difference between the trace and its time reversal"),
    "skewness": Kind("distribution", "skewness of the positions"),
    "kurtosis": Kind("distribution", "kurtosis of the positions"),
    "stiffness": Kind("stiffness", "stiffness of the trace alone over that of the joint fit (ln)"),
    "friction": Kind("friction", "friction of the trace alone over that of the joint fit (ln)"),
    "stiffness_along_series": Kind("stiffness", "trend of the stiffness along the series"),
    "friction_along_series": Kind("friction", "trend of the friction along the series"),
    "known_force": Kind("known forces", "fitted force over the one that [[magnet]] states (ln)"),
    "extension": Kind("extension", "mean extension less that of the chain (standard errors)"),
}

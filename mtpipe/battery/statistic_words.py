"""The battery's statistics in words."""

from __future__ import annotations

from collections.abc import Mapping

# Per statistic: the line of the map it belongs to, and what is compared. Lines of bands are named
# after their frequencies.
STATISTICS: Mapping[str, tuple[str, str]] = {
    "psd_band": ("", "power"),
    "line": ("narrow lines", "the strongest narrow line"),
    "second_line": ("narrow lines", "the second strongest narrow line"),
    "allan_variance": ("Allan variance", "Allan variance (ln nm²)"),
    "correlation": ("correlation", "correlation of the two axes"),
    "fractional_pixel": ("pixels", "strongest periodic pattern of the positions (ln)"),
    "lost_frames": ("lost frames", "distance from the mean just before lost frames (ln)"),
    "reference_coherence": ("reference bead", "correlation with the motion of the reference beads"),
    "mean_trend": ("mean over time", "drift of the mean"),
    "mean_step": ("mean over time", "largest step of the mean"),
    "mean_excursion": ("mean over time", "largest excursion of the mean"),
    "variance_trend": ("variance over time", "trend of the variance"),
    "variance_step": ("variance over time", "largest step of the variance"),
    "variance_spread": ("variance over time", "variation of the variance"),
    "quietest_second": ("variance over time", "variance of the quietest second"),
    "irreversibility": (
        "direction of time",
        "difference of the trace from its reverse",
    ),
    "skewness": ("shape", "skewness of the positions"),
    "kurtosis": ("shape", "kurtosis of the positions"),
    "stiffness": ("stiffness", "stiffness of the trace alone over that of the joint fit (ln)"),
    "friction": ("friction", "friction of the trace alone over that of the joint fit (ln)"),
    "stiffness_along_series": ("stiffness", "trend of the stiffness along the series"),
    "friction_along_series": ("friction", "trend of the friction along the series"),
    "known_force": ("known forces", "fitted force over the one that [[magnet]] states (ln)"),
    "extension": ("extension", "mean extension less that of the chain (standard errors)"),
}

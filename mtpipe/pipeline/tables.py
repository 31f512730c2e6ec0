"""Results as tables: what `docs/run-folder.md` describes, column by column.

Pure functions from results to pandas tables; nothing here computes physics or touches files.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from mtpipe.calibration.bead_results import AxisResult, BeadResult, PlateauResult
from mtpipe.calibration.calibration import Calibration
from mtpipe.calibration.comparison import MethodResult
from mtpipe.calibration.noise_floor import noise_floor_nm
from mtpipe.calibration.recommended_force import BeadForces
from mtpipe.curves.curve_tables import tether_columns
from mtpipe.curves.extension_curve import ForceExtension
from mtpipe.ground.estimate_columns import four, two
from mtpipe.ground.notice import Notice
from mtpipe.pipeline.verdict import BeadVerdict
from mtpipe.recording.recording import AXES, Tracked

POSTERIOR_POINTS = 400


def forces_table(
    calibration: Calibration,
    forces: Mapping[str, BeadForces],
    flags: Mapping[str, Sequence[Notice]],
    others: Sequence[MethodResult] = (),
    unbelieved: Collection[int] = (),
) -> pd.DataFrame:
    """`forces`: a row per bead × plateau × axis, and one more for each other method asked for.

    Parameters
    ----------
    unbelieved : numbers of plateaus whose magnet position is not to be believed.
    """
    rows = []
    for bead in calibration.beads:
        for plateau in bead.plateaus:
            codes = [n for n in flags[bead.bead] if n.plateau == plateau.plateau.number]
            quoted = _quoted_columns(forces[bead.bead], plateau.plateau.number)
            for one in plateau.axes:
                mine = [n.code for n in codes if n.axis in (None, one.axis)]
                rows.append(_force_row(calibration, bead, plateau, one, mine) | quoted)
    for other in others:
        quoted = _quoted_columns(forces[other.bead], other.plateau.plateau.number)
        rows.append(_method_row(calibration, other) | quoted)
    table = pd.DataFrame(rows)
    if len(table):
        place = list(table.columns).index("magnet_mm") + 1
        table.insert(place, "magnet_believed", ~table["plateau"].isin(list(unbelieved)))
    return table.assign(excluded="")


def _quoted_columns(forces: BeadForces, plateau: int) -> dict[str, Any]:
    """The force to quote, the same in all rows of a bead and plateau, and others by name."""
    recommended = forces.recommended[plateau]
    return {
        **four("force", "pN", recommended.force),
        "force_source": recommended.source,
        "force_status": recommended.force.status,
        **two("force_configured", "pN", forces.configured.get(plateau)),
        **two("force_named", "pN", forces.named.get(plateau)),
    }


def _trace_columns(
    calibration: Calibration, bead: str, plateau: PlateauResult, axis: str
) -> dict[str, Any]:
    """Which trace a row is of."""
    frames = len(plateau.trace.position_nm)
    magnet = plateau.plateau.magnet_mm
    return {
        "bead": bead,
        "plateau": plateau.plateau.number,
        "axis": axis,
        "magnet_mm": math.nan if magnet is None else magnet,
        "start_s": plateau.trace.start_s,
        "duration_s": frames / calibration.conditions.frame_rate_hz,
        "frames": frames,
        "lost_frames": plateau.trace.lost_on(AXES.index(axis)),
        "extension_nm": plateau.extension_nm,
        "extension_stderr_nm": plateau.extension_stderr_nm,
    }


def _method_row(calibration: Calibration, other: MethodResult) -> dict[str, Any]:
    fit = other.fit
    return {
        **_trace_columns(calibration, other.bead, other.plateau, other.axis),
        **four("force", "pN", None),
        "force_source": "",
        "force_status": "",
        **four("force_axis", "pN", other.force),
        **four("stiffness", "pN_per_nm", fit.stiffness if fit else None),
        **four("friction", "pN_s_per_nm", fit.friction if fit else None),
        **four("corner_frequency", "hz", fit.corner_frequency if fit else None),
        **four("effective_radius", "nm", None),
        **four("noise", "nm", fit.noise if fit else None),
        "status": other.status,
        "tied_to": "",
        "method": other.method,
        "posterior_converged": False,
        "flags": "",
        "refusal": other.refusal,
    }


def _force_row(
    calibration: Calibration,
    bead: BeadResult,
    plateau: PlateauResult,
    one: AxisResult,
    codes: Iterable[str],
) -> dict[str, Any]:
    posterior, fit, known = one.posterior, one.fit, one.estimates
    return {
        **_trace_columns(calibration, bead.bead, plateau, one.axis),
        **four("force", "pN", None),
        "force_source": "",
        "force_status": "",
        **four("force_axis", "pN", None if one.refusal else one.force_alone),
        **four("stiffness", "pN_per_nm", known.stiffness if known else None),
        **four("friction", "pN_s_per_nm", known.friction if known else None),
        **four("corner_frequency", "hz", known.corner_frequency if known else None),
        **four("effective_radius", "nm", None if one.refusal else one.effective_radius),
        **four("noise", "nm", known.noise if known else None),
        "status": plateau.status(one),
        "tied_to": ";".join(known.stiffness.tied_to) if known else "",
        "method": one.method,
        "fit_deviance": fit.deviance if fit else math.nan,
        "fit_dof": fit.dof if fit else math.nan,
        "fit_p_value": fit.p_value if fit else math.nan,
        "posterior_rhat": posterior.r_hat if posterior else math.nan,
        "posterior_ess": posterior.effective_samples if posterior else math.nan,
        "posterior_converged": bool(posterior and posterior.converged),
        "nyquist_ratio": fit.nyquist_ratio if fit else math.nan,
        "flags": ";".join(dict.fromkeys(codes)),
        "refusal": one.refusal,
    }


def beads_table(
    calibration: Calibration,
    forces: Mapping[str, BeadForces],
    verdicts: Sequence[BeadVerdict],
    curves: Mapping[str, ForceExtension],
    tracked: Tracked | None,
) -> pd.DataFrame:
    """`beads`: a row per verdict; beads left out on reading have no calibration.

    Parameters
    ----------
    tracked : of the recording, None where mtpipe did not track it.
    """
    rows = []
    results = {bead.bead: bead for bead in calibration.beads}
    for verdict in verdicts:
        bead = results.get(verdict.bead)
        plateaus = () if bead is None else bead.plateaus
        usable = [] if bead is None else forces[verdict.bead].usable_pN
        recommended = curves[verdict.bead].recommended if verdict.bead in curves else None
        ratio = None if bead is None else bead.friction_ratio
        rows.append(
            {
                "bead": verdict.bead,
                "verdict": verdict.verdict,
                "reasons": " | ".join(verdict.reasons),
                "plateaus": len(plateaus),
                "mismatch": verdict.mismatch,
                "force_bound_percent": verdict.force_bound_percent,
                "material": verdict.material,
                "plateaus_used": len(usable),
                "force_min_pN": min(usable, default=math.nan),
                "force_max_pN": max(usable, default=math.nan),
                "tether_model": recommended.model if recommended else "",
                **tether_columns(recommended),
                **four("radius", "nm", bead.radius if bead else None),
                "series": bead.series if bead else "",
                "friction_ratio": ratio.value if ratio else math.nan,
                "friction_ratio_stderr": ratio.stderr if ratio else math.nan,
                **_noise_columns(verdict.bead, bead, tracked),
                "excluded": "",
            }
        )
    return pd.DataFrame(rows)


def _noise_columns(name: str, bead: BeadResult | None, tracked: Tracked | None) -> dict[str, float]:
    """Per axis, the noise that the spectra show, and the part that the images explain."""
    precision = tracked.precision_nm.get(name) if tracked else None
    columns: dict[str, float] = {}
    for axis, one in zip(AXES, precision or (math.nan,) * 3, strict=True):
        floor = noise_floor_nm(bead, axis) if bead else None
        columns |= {**four(f"noise_floor_{axis}", "nm", floor), f"image_precision_{axis}_nm": one}
    return columns


def spectra_table(calibration: Calibration) -> pd.DataFrame:
    """`details/spectra`: binned periodograms and what the fit expects for them."""
    parts = [
        pd.DataFrame(
            {
                "bead": bead.bead,
                "plateau": plateau.plateau.number,
                "axis": one.axis,
                "frequency_hz": one.fit.spectrum.frequency_hz,
                "ordinates": one.fit.spectrum.ordinates,
                "power_nm2_per_hz": one.fit.spectrum.power / one.fit.spectrum.gain,
                "model_nm2_per_hz": one.fit.expected_power / one.fit.spectrum.gain,
            }
        )
        for bead in calibration.beads
        for plateau in bead.plateaus
        for one in plateau.axes
        if one.fit is not None
    ]
    columns = [
        "bead", "plateau", "axis", "frequency_hz", "ordinates", "power_nm2_per_hz",
        "model_nm2_per_hz",
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)


def posteriors_table(calibration: Calibration) -> pd.DataFrame:
    """`details/posteriors`: an evenly thinned sample of each posterior."""
    parts = []
    for bead in calibration.beads:
        for plateau in bead.plateaus:
            for one in plateau.axes:
                if one.posterior is None:
                    continue
                n = len(one.posterior.theta)
                keep = np.linspace(0, n - 1, min(n, POSTERIOR_POINTS)).astype(int)
                parts.append(
                    pd.DataFrame(
                        {
                            "bead": bead.bead,
                            "plateau": plateau.plateau.number,
                            "axis": one.axis,
                            "force_pN": math.nan
                            if one.force_sample_pN is None
                            else one.force_sample_pN[keep],
                            "stiffness_pN_per_nm": one.posterior.stiffness_pN_per_nm[keep],
                            "friction_pN_s_per_nm": one.posterior.friction_pN_s_per_nm[keep],
                            "noise_nm": one.posterior.noise_nm[keep],
                        }
                    )
                )
    columns = [
        "bead", "plateau", "axis", "force_pN", "stiffness_pN_per_nm", "friction_pN_s_per_nm",
        "noise_nm",
    ]  # fmt: skip
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns)

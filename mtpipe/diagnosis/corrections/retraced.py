"""A case with other traces, as if they had been recorded: reduced and fitted again."""

from __future__ import annotations

from dataclasses import replace

from mtpipe.crosschecking.prepared_bead import PreparedBead, preferred_fit
from mtpipe.ground.types import FloatArray
from mtpipe.joint_fit.data import plateau_data, whitening


def with_positions(case: PreparedBead, positions_nm: tuple[FloatArray, ...]) -> PreparedBead:
    """The case with these traces, of the same plateaus and the same frames.

    Parameters
    ----------
    positions_nm : per plateau (n, 3), NaN where lost.

    Raises
    ------
    FitError : too few frames are left, or nothing fits.
    """
    phi = tuple(whitening(x, case.frame_s) for x in positions_nm)
    data = tuple(
        plateau_data(x, case.frame_s, p, case.lines_hz)
        for x, p in zip(positions_nm, phi, strict=True)
    )
    fit = preferred_fit(replace(case.fit.model, data=data))
    return replace(case, positions_nm=positions_nm, phi=phi, fit=fit)

"""The files of beads that were turned: a table of verdicts, and the curves as a page."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from mtpipe.curves.rotation.beads import TurnedBead
from mtpipe.report.plotly_json import PlainArrays
from mtpipe.report.rotation_figure import rotation_figure


def rotation_table(beads: Sequence[TurnedBead]) -> pd.DataFrame:
    """`rotation.csv`: a row per bead and stretch in which the magnets rotate."""
    return pd.DataFrame(
        {
            "bead": one.turned.bead,
            "magnet_mm": one.turned.magnet_mm,
            "start_s": one.turned.start_s,
            "end_s": one.turned.end_s,
            "turns_low": one.turned.turns.min(),
            "turns_high": one.turned.turns.max(),
            "force_pN": one.force_pN,
            "force_stderr_pN": one.force_stderr_pN,
            "verdict": one.verdict.verdict,
            "reason": one.verdict.reason,
            "p_nicked": one.verdict.probability["nicked"],
            "p_supercoilable": one.verdict.probability["supercoilable"],
            "p_several_tethers": one.verdict.probability["several tethers"],
            "buckling_turns": one.verdict.buckling_turns,
            "buckling_stderr_turns": one.verdict.buckling_stderr,
            "relaxed_turns": one.verdict.relaxed_turns,
            "scatter_nm": one.verdict.scatter_nm,
        }
        for one in beads
    )


def rotation_page(beads: Sequence[TurnedBead]) -> str:
    """`rotation.html`: extension against turns, with the best fit."""
    import plotly.graph_objects as go

    page: str = go.Figure(rotation_figure(PlainArrays(), beads)).to_html()
    return page

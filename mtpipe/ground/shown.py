"""How a result shows itself to a person: in a line, in a notebook, as a figure.

A result says in `__repr__` what it is in one line, and in `table` what it holds in rows. Figures
are the report's, which knows of all results and so stands below them all: it is asked by name when
somebody wants one, and is not imported otherwise.
"""

from __future__ import annotations

import html
import importlib
from typing import TYPE_CHECKING, Any

from mtpipe.ground.estimate import Estimate
from mtpipe.ground.written_numbers import EMPTY, is_number, number

if TYPE_CHECKING:
    import pandas as pd

# Most rows that a table in a notebook shows; all of them are in `.table`.
MOST_ROWS = 20
# What is estimated of a trace.
QUANTITIES = ("stiffness", "friction", "noise", "corner_frequency")
DRAWING_ROOM = "mtpipe.notebook.figures"


class Shown:
    """Base of results that show themselves."""

    @property
    def table(self) -> pd.DataFrame:
        """What it holds, in rows."""
        raise NotImplementedError

    def plot(self, **choice: Any) -> Any:
        """A plotly figure, drawn as in the report.

        Parameters
        ----------
        choice : of results with several beads, `bead`: the name of one; default: the first.
        """
        return importlib.import_module(DRAWING_ROOM).figure_of(self, **choice)

    def _repr_html_(self) -> str:
        return html_of(self)


def html_of(result: Any) -> str:
    """The line and the table of a result, for a notebook."""
    shown = result.table.to_html(
        index=False,
        max_rows=MOST_ROWS,
        na_rep=EMPTY,
        border=0,
        float_format=lambda value: number(value, 4) if is_number(value) else str(value),
    )
    return f"<p>{html.escape(repr(result))}</p>{shown}"


def estimates_table(result: Shown) -> pd.DataFrame:
    """A row for each estimate of a trace: quantity, value, stderr, low, high (68 %), unit, status.

    Parameters
    ----------
    result : with the attributes `QUANTITIES`.
    """
    import pandas as pd

    estimates: dict[str, Estimate] = {name: getattr(result, name) for name in QUANTITIES}

    return pd.DataFrame(
        [
            {
                "quantity": name,
                "value": one.value,
                "stderr": one.stderr,
                "low": one.interval[0],
                "high": one.interval[1],
                "unit": one.unit,
                "status": one.status,
            }
            for name, one in estimates.items()
        ]
    )

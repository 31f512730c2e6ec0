"""The report people read: `write_report` draws it from a run folder (docs/run-folder.md) alone.

`folder` reads the run folder; `words` turns numbers and codes into text; `rows` and `notices`
prepare the tables, `figures_run`, `figures_bead` and `figures_trace` the charts (in the notation of
`plotly_json`); `pages` fills the templates and writes `report/`.
"""

from mtpipe.report.pages import write_report

__all__ = ["write_report"]

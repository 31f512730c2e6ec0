"""The report people read: `write_report` draws it from a run folder (docs/run-folder.md) alone.

`folder` reads the run folder; `words` turns numbers and codes into text, `fit_words` which fit the
forces come from; `plateau_forces` has one force for each plateau where x and y share it, and
compares what each tells by itself. `rows`, `rows_methods`, `rows_drift` and `notices` prepare
the tables, `captions` what stands below charts; `figures_run`, `figures_bead`, `figures_agreement`,
`figures_trace`, `figures_crosscheck` and `figures_unexplained` the charts (in the notation of
`plotly_json`); `pages` fills the templates and writes `report/`.
"""

from mtpipe.report.pages import write_report

__all__ = ["write_report"]

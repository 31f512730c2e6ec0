"""The report people read: `write_report` draws it from a run folder (docs/run-folder.md) alone.

`folder` reads the run folder. `findings` says what was found of each bead and of the recording, and
`remedies` what to do about a cause; the terminal says the same. `words` turns numbers and codes
into text, `fit_words` which fit describes the spectra, `plateau_forces` has the force to quote of
each plateau. `rows`, `rows_plateaus`, `rows_crosscheck`, `rows_methods`, `rows_drift` and `notices`
prepare tables (of `cells`), `captions` what stands below charts; `figures_finding` has the one
picture of a bead's finding, the other `figures_…` the charts (in the notation of `plotly_json`,
which also has the colours of a dark screen). `pages` fills the templates and writes `report/`.
"""

from mtpipe.report.pages import write_report

__all__ = ["write_report"]

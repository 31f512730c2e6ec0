"""The report people read: `write_report` draws it from a run folder (docs/run-folder.md) alone.

`folder` reads the run folder; `words` turns numbers and codes into text; `rows` prepares the
tables and `figures` the charts; `pages` fills the templates and writes `report/`.
"""

from mtpipe.report.pages import write_report

__all__ = ["write_report"]

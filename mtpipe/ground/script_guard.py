"""Scripts that start processes without the guard of Python, refused before they do.

A new process reads the script that started it again. Where that calls mtpipe outside of
`if __name__ == "__main__":`, each process would begin the whole run anew, and die of it.
"""

from __future__ import annotations

import ast
import sys
from pathlib import Path
from types import FrameType

from mtpipe.ground.errors import MtpipeError


def check_guard(workers: int) -> None:
    """Raise MtpipeError if the call comes from a script's own lines, outside of any guard."""
    frame = _of_script(sys._getframe())
    if frame is None:
        return
    script = Path(frame.f_code.co_filename)
    try:
        tree = ast.parse(script.read_bytes())
    except (OSError, SyntaxError, ValueError):  # no script that a process could read again
        return
    if not _is_guarded(tree, frame.f_lineno):
        raise MtpipeError(
            f"calls mtpipe with {workers} workers outside of `if __name__ == "
            '"__main__":`, so that every worker would run the script again',
            where=f"{script}, line {frame.f_lineno}",
            mend="Put the call below that line, or take workers=1.",
        )


def _of_script(frame: FrameType | None) -> FrameType | None:
    """The frame of the lines of `__main__` itself, through which the call came; None without."""
    while frame is not None:
        if frame.f_code.co_name == "<module>" and frame.f_globals.get("__name__") == "__main__":
            return frame
        frame = frame.f_back
    return None


def _is_guarded(tree: ast.Module, line: int) -> bool:
    """Whether a line of a script stands below a condition on `__name__`."""
    for statement in tree.body:
        if statement.lineno <= line <= (statement.end_lineno or line):
            names = {one.id for one in ast.walk(statement) if isinstance(one, ast.Name)}
            return isinstance(statement, ast.If) and "__name__" in names
    return True

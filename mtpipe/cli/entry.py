"""Where a command starts and how it ends: unforeseen errors as a sentence, exit codes."""

from __future__ import annotations

import os
import sys
import traceback

# their commands join the others
from mtpipe.cli import explain as _explain  # noqa: F401
from mtpipe.cli import magnet_curve as _magnet_curve  # noqa: F401
from mtpipe.cli import reports as _reports  # noqa: F401
from mtpipe.cli import watch as _watch  # noqa: F401
from mtpipe.cli.commands import app
from mtpipe.cli.terminal import stopped_in_one_line
from mtpipe.ground.errors import MtpipeError, unforeseen
from mtpipe.ground.streams import open_streams, say


def main() -> None:
    """Run the command line; every fault ends in a sentence and an exit code."""
    open_streams()
    with stopped_in_one_line():
        try:
            app()
        except MtpipeError as error:
            say(f"mtpipe: {error}", err=True)
            sys.exit(error.exit_code)
        except Exception as error:
            if os.environ.get("MTPIPE_DEBUG"):
                traceback.print_exc()
            say(f"mtpipe: {unforeseen(error)}", err=True)
            sys.exit(1)

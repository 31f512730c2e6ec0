"""Entry point of the command `mtpipe` and of `python -m mtpipe`."""

from mtpipe.cli.entry import main

if __name__ == "__main__":
    main()

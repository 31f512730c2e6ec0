"""Print the results of all parts into the page, and copy the figures beside it.

The page holds each part between `<!-- paper: name -->` and `<!-- end -->`; what stands around them
is written by hand and stays. Each part ends with the date and the command that printed it.
"""

from __future__ import annotations

import argparse
import datetime
import re
import shutil
from pathlib import Path

import mtpipe


def print_page(page: Path, results: Path, names: list[str], command: str) -> None:
    """Replace each part's block in the page.

    Raises
    ------
    ValueError : the page has no place, or several, for a part.
    """
    images = page.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    text = page.read_text(encoding="utf-8")
    today = datetime.datetime.now(tz=datetime.UTC).date()
    for name in names:
        image = f"paper-{name}.png"
        shutil.copyfile(results / image, images / image)
        block = (
            f"{(results / f'{name}.md').read_text(encoding='utf-8')}\n![{name}](images/{image})\n\n"
            f"Printed {today} by mtpipe {mtpipe.__version__}: `{command}`.\n"
        )
        place = re.compile(rf"(<!-- paper: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        found = len(place.findall(text))
        if found != 1:
            raise ValueError(f"{page} needs one place <!-- paper: {name} -->, has {found}")
        text = place.sub(lambda match, block=block: match[1] + block + match[2], text)
    page.write_text(text, encoding="utf-8")


def main() -> None:
    """From the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--command", required=True, help="what to print as the command")
    parser.add_argument("--parts", nargs="+", required=True)
    arguments = parser.parse_args()
    print_page(arguments.page, arguments.results, arguments.parts, arguments.command)


if __name__ == "__main__":
    main()

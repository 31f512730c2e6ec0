"""The oldest versions that pyproject.toml allows of what mtpipe needs, as constraints for pip.

    python workflows/house/oldest.py > oldest.txt
    pip install -c oldest.txt -e ".[cluster,magnets]" pytest pytest-xdist hypothesis
    pytest -m "not slow" -W default

in an environment of its own, as `.ci/run` has it.

The tools of development (pytest, ruff, mypy, ...) are not among them: an old one tells nothing.
What old versions warn of is no matter, hence `-W default`.
"""

import tomllib
from pathlib import Path

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]
NEEDED = [
    *PROJECT["dependencies"],
    *PROJECT["optional-dependencies"]["cluster"],
    *PROJECT["optional-dependencies"]["magnets"],
]


def main() -> None:
    """Print a line for each dependency."""
    for dependency in NEEDED:
        print(dependency.replace(">=", "=="))


if __name__ == "__main__":
    main()

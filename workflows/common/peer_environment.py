"""Other laboratories' programs, each in an environment of its own that is made on first use."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path


def environment(folder: Path, requirements: Path) -> Path:
    """Python interpreter of a virtual environment with these requirements, made if need be."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pinned, made = requirements.read_text(encoding="utf-8"), folder / "made-with.txt"
    if made.exists() and made.read_text(encoding="utf-8") == pinned:
        return python
    print(f"making an environment of {requirements} in {folder}", file=sys.stderr)
    venv.create(folder, with_pip=True)
    install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([str(python), *install, "-r", str(requirements)], check=True)
    made.write_text(pinned, encoding="utf-8")
    return python

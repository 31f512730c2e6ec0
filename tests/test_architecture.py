"""The house: rooms in order, no import that runs up, no circle, files of a readable length."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import mtpipe
from mtpipe.ground.shown import DRAWING_ROOM
from mtpipe.setup.tables import DESCRIBED, EFFECTS, EFFECTS_GROUP

PACKAGE = Path(mtpipe.__file__).parent
DOCUMENT = PACKAGE.parent / "docs" / "architecture.md"
# Of a file, so that it is read in one sitting (the house's rule).
MOST_LINES = 400
# What files say that they are. Other programs read it, so it stays when code is moved.
SCHEMAS = {
    "mtpipe.lookup_table/1",
    "mtpipe.magnet_curve/1",
    "mtpipe.mismatch/1",
    "mtpipe.tracking/1",
    "mtpipe.truth/1",
}
# Names of effects that are words for something else too: a flag and a file of a run, keys of a
# setup and of a plan, a parameter of a tether's fit.
OTHER_MEANINGS = {"drift", "exposure", "viscosity", "contour_length"}


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


MODULES = {name_of(path): path for path in PACKAGE.rglob("*.py")}


def imports(path: Path) -> Iterator[str]:
    """Modules of mtpipe that a file imports, wherever in the file, for types too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


IMPORTS = {
    name: {one for one in imports(path) if one in MODULES} - {name}
    for name, path in MODULES.items()
}


def texts(path: Path) -> Iterator[str]:
    """The strings of a file of Python, but for its documentation; all of another file."""
    whole = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield whole
        return
    nodes = list(ast.walk(ast.parse(whole)))
    remarks = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:
        text = node.value if isinstance(node, ast.Constant) else None
        if isinstance(text, str) and id(node) not in remarks:
            yield text


def rooms() -> list[str]:
    """The rooms in the order of the table in docs/architecture.md."""
    return re.findall(r"^\| `(\w+)` \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE)


def test_every_module_has_a_room():
    loose = {path.stem for path in PACKAGE.glob("*.py")} - {"__init__", "__main__"}
    assert not loose
    assert sorted(rooms()) == sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))


def test_no_import_runs_up():
    order = {room: place for place, room in enumerate(rooms())}
    up = [
        f"{name} imports {other}"
        for name, others in IMPORTS.items()
        for other in others
        if name.count(".") and other.count(".")
        if order.get(other.split(".")[1], 99) > order.get(name.split(".")[1], 99)
    ]
    assert not up


def test_no_module_is_called_by_its_name_as_text():
    """Such an import would run up unseen. Two are meant: figures are drawn by a room at the end of
    the table, and the group of entry points is called as the room.
    """
    by_text = {
        (path.relative_to(PACKAGE).as_posix(), text)
        for path in MODULES.values()
        for text in texts(path)
        if text in MODULES and text.count(".")
        if text.split(".")[1] != path.relative_to(PACKAGE).parts[0]  # its own room's files
    }
    assert by_text == {("ground/shown.py", DRAWING_ROOM), ("setup/tables.py", EFFECTS_GROUP)}


def test_files_keep_the_names_of_their_formats():
    written = {text for path in MODULES.values() for text in texts(path)}
    assert {text for text in written if re.fullmatch(r"mtpipe\.[\w.]+/\d+", text)} == SCHEMAS


def test_no_circle():
    list(TopologicalSorter(IMPORTS).static_order())  # raises CycleError with the circle


def test_files_can_be_read_in_one_sitting():
    lengths = {
        name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in MODULES.items()
    }
    assert {name: lines for name, lines in lengths.items() if lines > MOST_LINES} == {}


def test_an_effects_name_stands_in_its_own_file():
    """The house's rule: no other file has it as text; the catalogue imports the file."""
    names = set(EFFECTS) - OTHER_MEANINGS
    found = {
        (path.relative_to(PACKAGE).as_posix(), name)
        for path in (*MODULES.values(), *PACKAGE.rglob("*.j2"), *PACKAGE.rglob("*.js"))
        for text in texts(path)
        for name in names & {text, *re.findall(r"\w+_\w+", text)}
        if name != path.stem
    }
    assert found == {("setup/tables.py", name) for name in DESCRIBED}


@pytest.mark.slow
def test_an_effects_own_is_known_to_few_other_files():
    """The house's rule: a median of at most two (`workflows/house/fields.py`)."""
    script = PACKAGE.parent / "workflows" / "house" / "fields.py"
    said = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, check=True
    ).stdout
    assert float(said.rsplit("median", 1)[1]) <= 2

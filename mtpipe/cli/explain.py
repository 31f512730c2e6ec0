"""`mtpipe explain`: the reference of the setup's keys, on the terminal or as a page."""

from __future__ import annotations

from typing import Annotated

import typer

from mtpipe.cli.commands import app
from mtpipe.ground.streams import say
from mtpipe.setup.measured import UNKNOWN
from mtpipe.setup.reference import Key, find_key, keys, of_table, usual_error

HEAD = """# Every key of `setup.toml`

Made by `mtpipe explain --markdown > docs/setup-reference.md` from the models that read a setup.
`mtpipe explain KEY` shows one key on the terminal.

A key whose name ends in a unit is in that unit. A number that a laboratory does not know is written
`"unknown"`, and `<key>_stderr` beside a measured value is its standard error."""


@app.command()
def explain(
    key: Annotated[
        str | None,
        typer.Argument(metavar="KEY", help="A key or table of setup.toml: camera.exposure_s."),
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the reference of all keys as a page.")
    ] = False,
) -> None:
    """Explain a key of the setup.

    Without a key the tables of the setup are listed.
    """
    if markdown:
        say(page())
    elif key is None:
        say("Tables of setup.toml; mtpipe explain TABLE lists a table's keys.")
        _list(of_table(""))
    else:
        _explain(find_key(key))


def _explain(key: Key) -> None:
    say(f"{key.path}{f' ({key.unit})' if key.unit else ''}: {key.meaning}")
    if key.is_table:
        say(f"{key.kind}, keys:")
        inside = [one for one in keys() if one.table.startswith(key.path)]
        _list(tuple(one for one in inside if one.table == inside[0].table))
        return
    say(f"  type     {key.kind}")
    say(f"  default  {key.default}")
    if UNKNOWN in key.kind and usual_error(key.path):
        name = key.path.rpartition(".")[2]
        say(f"  error    {name}_stderr; default: {usual_error(key.path)}")
    say(f"  example  {key.example}")


def _list(found: tuple[Key, ...]) -> None:
    width = max(len(key.path) for key in found)
    for key in found:
        say(f"  {key.path:{width}}  {key.meaning}")


def page() -> str:
    """docs/setup-reference.md."""
    lines = [HEAD]
    of: dict[str, list[Key]] = {}
    for key in keys():
        of.setdefault(key.table, [])
        if not key.is_table or not key.table:
            of[key.table].append(key)
    meaning = {key.path: key for key in keys()}
    for table, found in of.items():
        if not table:
            lines += ["## Tables", "", "| table | meaning |", "| --- | --- |"]
            lines += [f"| `{key.path}` | {key.meaning} |" for key in found]
            continue
        if not found:
            continue
        about = meaning.get(table) or meaning[table.rpartition(".")[0]]
        name = f"[{table}]" if about.kind != "list of tables" else f"[[{table}]]"
        lines += [f"## `{name}`", "", about.meaning, ""]
        lines += ["| key | type | unit | default | meaning | example |", "| --- " * 6 + "|"]
        lines += [_row(key) for key in found]
    text = "\n".join(lines)
    return text.replace("\n## ", "\n\n## ")


def _row(key: Key) -> str:
    default = key.default if key.default in ("required", "none") else f"`{key.default}`"
    error = usual_error(key.path) if UNKNOWN in key.kind else ""
    meaning = f"{key.meaning} Usual error: {error}." if error else key.meaning
    cells = (
        f"`{key.path.rpartition('.')[2]}`", key.kind.replace('"', "`"), key.unit, default,
        meaning.replace("<effect>", "`<effect>`"), f"`{key.example}`",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"

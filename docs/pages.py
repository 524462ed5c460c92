"""Pages that follow from the code, so that they cannot rot: text in Markdown, each by a function of its own.

``scenario_file`` and ``timeline_file`` come from the layouts by which files are read, ``command_line`` from
the parser, ``statuses`` from the outcomes of planning. Nothing here needs Sphinx.
"""

import argparse
import shutil
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import exhibits

from jaxplan.cli import DESCRIPTION, EXIT_CODES, FIRST_STEPS, _make_parser
from jaxplan.model.status import Status
from jaxplan.schema.directions import TargetList
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Field, Rows, Table
from jaxplan.schema.text import alternatives, default, entries, template
from jaxplan.schema.timelines import TIMELINE, timeline_template

ROOT = Path(__file__).parent.parent
OF_TIMELINES = replace(
    TIMELINE,
    fields=tuple(
        entry
        for entry in TIMELINE.fields
        if entry.key in ("schema_version", "name") or entry.key not in {own.key for own in SCENARIO.fields}
    ),
)
"""The table of a timeline's file without what a scenario has, too."""
NOTEBOOKS = ROOT / "notebooks"
NONE = "\N{EN DASH}"
CODE_WIDTH = 100  # characters of a line that is made here


def write(folder: Path) -> None:
    """Make all pages, what the gallery's include, and copies of the notebooks beside them."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "notebooks").mkdir(parents=True)
    for name, make in PAGES.items():
        (folder / f"{name}.md").write_text(make(), encoding="utf-8")
    exhibits.write(folder)
    for notebook in sorted(NOTEBOOKS.glob("*.ipynb")):
        shutil.copy(notebook, folder / "notebooks")


def scenario_file() -> str:
    """Every key of a scenario file with its unit, range, default and meaning."""
    head = (
        "# Scenario file\n\n"
        "A scenario is a TOML file in UTF-8. Units are in the keys; an unknown key, a missing one and a "
        "value out of range are faults, and all of a file are reported at once. Arrays list terminals in "
        "the file's order. Directions and quaternions are normalised silently when they are within 1e-3 of "
        "unit length, and refused beyond. *Required* in the column of defaults means that there is none; a "
        "dash, that the key may be absent. `jp.save_scenario` writes such files, and the settings of "
        "`[search]`, `[trajectory]` and `[robust]` go by their names in `jp.run_study(settings=...)`, "
        "`jp.tune` and `jaxplan study --set`.\n"
    )
    tables = "\n".join(_table_page(path, table) for path, table in _tables(SCENARIO, ""))
    example = (
        "## Example\n\nWhat `jaxplan new scene.toml` writes, to be planned as it is, and changed:\n\n"
        f"```toml\n{template()}```\n"
    )
    return f"{head}\n{tables}\n{example}"


def timeline_file() -> str:
    """Every key of a timeline's file that a scenario does not have."""
    head = (
        "# Timeline file\n\n"
        "A timeline is a TOML file in UTF-8, like a [scenario](scenario_file.md), from which it has "
        "`epoch_utc`, `[spacecraft]`, `[start]`, `[sky]`, zones, `[robust]`, `[search]` and `[trajectory]`, "
        "but no `[goal]`. Here is what it has besides; {doc}`timelines </timelines>` goes through it.\n"
    )
    tables = "\n".join(_table_page(path, table) for path, table in _tables(OF_TIMELINES, ""))
    example = (
        "## Example\n\nWhat `jaxplan new day.toml --timeline` writes, to be planned as it is, and changed:\n"
        f"\n```toml\n{timeline_template()}```\n"
    )
    return f"{head}\n{tables}\n{example}"


def _tables(table: Table, path: str) -> Iterator[tuple[str, Table]]:
    """The tables of a file in the order of writing, with their headers."""
    inner = {field.key: field.kind for field in table.fields if isinstance(field.kind, Table | Rows | Either)}
    within = {field.key: field.kind for field in table.fields if isinstance(field.kind, TargetList)}
    yield path, replace(table, fields=tuple(field for field in table.fields if field.key not in inner))
    for key, kind in (inner | within).items():
        name = f"{path.partition('] ')[0].strip('[]')}.{key}".lstrip(".")
        if isinstance(kind, Rows):
            yield from _tables(kind.table, f"[[{name}]]")
        elif isinstance(kind, Either | TargetList):
            for words, one in kind.tables.items():
                yield from _tables(one, f"[{name}] {words}")
        else:
            assert isinstance(kind, Table)
            yield from _tables(kind, f"[{name}]")


def _table_page(path: str, table: Table) -> str:
    """A table's keys."""
    header, _, rest = path.partition("] ")
    title = f"`{header}{']' if rest else ''}` {rest}".strip() if path else "Top of the file"
    lines = ["| key | value | unit | range | default | meaning |", "|---|---|---|---|---|---|"]
    for entry in entries(table):
        usual = _required(table, entry) if entry.required else _code(default(table, entry))
        cells = [
            f"`{entry.key}`",
            entry.value,
            entry.unit or NONE,
            _code(entry.kind.range),
            usual,
            entry.meaning,
        ]
        lines.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join([f"## {title}", "", *lines, ""])


def _code(text: str | None) -> str:
    return f"`{text}`" if text else NONE


def _required(table: Table, entry: Field) -> str:
    return ", or ".join(["required", *map(_code, alternatives(table, entry))])


def command_line() -> str:
    """Every command with its arguments."""
    parser = _make_parser()
    (commands,) = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    parts = [
        "# Command line",
        f"{DESCRIPTION} Results go to stdout, messages and progress to stderr. {EXIT_CODES}",
        f"First steps:\n\n```text\n{textwrap.dedent(FIRST_STEPS)}\n```",
    ]
    for name, command in commands.choices.items():
        formatter = argparse.HelpFormatter(command.prog, width=CODE_WIDTH)
        formatter.add_usage(command.usage, command._actions, command._mutually_exclusive_groups, "")
        usage = formatter.format_help().strip()
        lines = ["| argument | meaning |", "|---|---|"]
        for action in command._actions:
            spelled = ", ".join(f"`{word}`" for word in action.option_strings) or f"`{action.metavar}`"
            value = f" `{action.metavar}`" if action.option_strings and action.metavar else ""
            lines.append(f"| {spelled}{value} | {action.help} |")
        parts += [f"## jaxplan {name}", str(command.description), f"```sh\n{usage}\n```", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def statuses() -> str:
    """The outcomes of planning, for the page on results."""
    lines = ["| status | meaning | ends at | what to change |", "|---|---|---|---|"]
    for status in Status:
        lines.append(f"| `{status.name}` | {status.value} | {status.step} | {status.advice or NONE} |")
    return "\n".join(lines) + "\n"


# Of these, `statuses` is a part of another page.
PAGES = {
    "scenario_file": scenario_file,
    "timeline_file": timeline_file,
    "command_line": command_line,
    "statuses": statuses,
}

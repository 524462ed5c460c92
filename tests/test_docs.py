"""The manual: its pages from the code are whole and true, and its examples run."""

import ast
import importlib
import inspect
import re
import runpy
import shutil
import subprocess
import sys
import tomllib
from dataclasses import fields, is_dataclass, replace
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest
from reference import assert_each

import jaxplan as jp
from jaxplan.cases import case_path
from jaxplan.cli import _make_parser, main
from jaxplan.model.status import Status
from jaxplan.schema.directions import TargetList
from jaxplan.schema.faults import WRONG, Place, Reading
from jaxplan.schema.layout import SCENARIO
from jaxplan.schema.tables import Either, Rows, Table
from jaxplan.schema.value_kinds import FromZero
from jaxplan.search import PLANNERS, remove_planner

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = (ROOT / "README.md", *sorted(DOCS.glob("*.md")), *sorted(DOCS.glob("gallery/*.md")))
EVERY_KEY = Path(__file__).parent / "scenarios" / "every_key.toml"
UNITS = {
    "deg": "deg",
    "rad": "rad",
    "s": "s",
    "km": "km",
    "m": "m",
    "nm": "N m",
    "nms": "N m s",
    "m2": "kg m²",
    "s2": "deg/s²",
    "s3": "deg/s³",
}


@pytest.fixture(scope="module")
def pages():
    sys.path.insert(0, str(DOCS))
    try:
        yield importlib.import_module("pages")
    finally:
        sys.path.remove(str(DOCS))


@pytest.fixture(scope="module")
def rows(pages):
    """(table, key) to its cells, of the reference of the scenario file."""
    return cells_of(pages.scenario_file())


@pytest.fixture(scope="module", params=["scenario_file", "timeline_file"])
def reference(pages, request):
    """(table, key) to its cells, of the reference of a file, and the layout by which it is read."""
    return cells_of(getattr(pages, request.param)()), (
        SCENARIO if request.param == "scenario_file" else pages.OF_TIMELINES
    )


def cells_of(page):
    """(table, key) to its cells, of a page of the reference."""
    found, title = {}, ""
    for line in page.splitlines():
        if line.startswith("## "):
            title = line.removeprefix("## ").replace("`", "")
        elif line.startswith("| `"):
            key, *cells = (cell.strip() for cell in line.strip("|").split(" | "))
            found[title, key.strip("` ")] = cells
    return found


def tables(table, title="Top of the file"):
    """Every table that files are read by, with its heading."""
    yield title, table
    path = "" if title == "Top of the file" else title.partition("] ")[0].strip("[]") + "."
    for field in table.fields:
        if isinstance(field.kind, Rows):
            yield from tables(field.kind.table, f"[[{path}{field.key}]]")
        elif isinstance(field.kind, Either | TargetList):
            for words, one in field.kind.tables.items():
                yield from tables(one, f"[{path}{field.key}] {words}")
        elif isinstance(field.kind, Table):
            yield from tables(field.kind, f"[{path}{field.key}]")


def expected_unit(key: str) -> str:
    """The unit that a key ends in, spelled out."""
    ending = re.search(r"_(deg_s3|deg_s2|deg_s|rad_s|kg_m2|km_s|deg|rad|nms|nm|km|m|s)$", key)
    if ending is None:
        return "\N{EN DASH}"
    parts = ending[1].split("_")
    if len(parts) == 2 and parts[1] == "s":
        return f"{parts[0]}/s"
    return UNITS[parts[-1]]


def test_every_key_that_is_read_is_in_the_reference_with_unit_range_and_default(reference):
    rows, layout = reference
    there = set()
    for title, table in tables(layout):
        for field in table.fields:
            if isinstance(field.kind, Table | Rows | Either):
                continue
            there.add((title, field.key))
            value, unit, interval, default, meaning = rows[title, field.key]
            assert value
            assert meaning
            assert meaning != "likewise"
            assert unit == expected_unit(field.key)
            own = table.defaults().get(field.attribute)
            if field.required:
                assert default.startswith("required")
            elif own in (None, (), {}):
                assert default == "\N{EN DASH}"
            else:
                read = tomllib.loads(f"v = {default.strip('`')}")["v"]
                place = Place(Reading())
                assert field.kind.read(read, place) == own
                assert place.reading.faults == []
            assert ("[" in interval or "(" in interval) == (field.kind.range is not None)
    assert set(rows) == there
    assert len(there) > (60 if layout is SCENARIO else 30)


def test_the_ranges_of_the_reference_are_those_that_are_enforced(reference):
    rows, layout = reference
    place = Place(Reading())
    tried = 0
    for title, table in tables(layout):
        for field in table.fields:
            interval = getattr(field.kind, "interval", None)
            if interval is None or field.kind.range is None:
                continue
            text = rows[title, field.key][2].strip("`")
            low, high = (float(end) for end in text[1:-1].split(","))
            whole = type(field.kind).__name__ == "Integer"
            from_zero = isinstance(field.kind, FromZero)  # what stands beside it may refuse a zero
            for end, closed in ((low, text[0] == "[" or from_zero), (high, text[-1] == "]")):
                if abs(end) == float("inf"):
                    continue
                read = field.kind.read(int(end) if whole else end, place)
                assert (read is not WRONG) == closed, (title, field.key)
            beyond = low - max(abs(low) * 1e-6, 1e-9)
            assert field.kind.read(int(low) - 1 if whole else beyond, place) is WRONG
            tried += 1
    assert tried > (25 if layout is SCENARIO else 4)


def test_no_table_of_the_package_is_left_out(rows, pages):
    rows = rows | cells_of(pages.timeline_file())
    modules = (module for name, module in sys.modules.items() if name.startswith("jaxplan.schema"))
    found = [thing for module in modules for thing in vars(module).values() if isinstance(thing, Table)]
    assert len(found) > 10
    inner = {
        field.key
        for table in found
        for field in table.fields
        if not isinstance(field.kind, Table | Rows | Either)
    }
    assert inner <= {key for _, key in rows}


def test_every_key_of_the_example_is_in_the_reference(rows):
    keys = {key for _, key in rows}

    def walk(table):
        for key, value in table.items():
            inner = value if isinstance(value, list) else [value]
            if isinstance(inner[0], dict) and key != "terminal_step_scale":
                for row in inner:
                    yield from walk(row)
            else:
                yield key

    assert set(walk(tomllib.loads(EVERY_KEY.read_text()))) <= keys


def test_the_command_line_page_has_every_command_and_option(pages, capsys):
    text = pages.command_line()
    with pytest.raises(SystemExit):
        main(["--help"])
    commands = re.findall(r"^    (\w+)  ", capsys.readouterr().out, re.MULTILINE)
    assert len(commands) >= 7
    for command in commands:
        with pytest.raises(SystemExit):
            main([command, "--help"])
        told = capsys.readouterr().out
        section = text.split(f"## jaxplan {command}\n")[1].partition("\n## ")[0]
        spelled = re.findall(r"^  (-\S.*?)(?:  |$)", told.partition("\noptions:")[2], re.MULTILINE)
        options = [option for line in spelled for option in re.findall(r"(?<!\S)--?[a-z-]+", line)]
        assert {"-h", "--help"} < set(options)
        assert all(f"`{option}`" in section for option in options)


def test_the_statuses_are_all_told(pages):
    text = pages.statuses()
    for status in Status:
        assert f"| `{status.name}` | {status.value} | {status.step} |" in text
        assert status.advice in text
        assert bool(status.advice) == (status is not Status.OK)


def test_every_page_is_in_the_table_of_contents():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    listed = {name for tree in blocks(DOCS / "index.md", "{toctree}") for name in tree.split()}
    assert {page.stem for page in DOCS.glob("*.md")} - {"index"} <= listed
    assert '"## Read on"' in index
    assert "\n## Read on\n" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_is_read_in_five_minutes_and_its_links_lead_somewhere():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= 200
    places = [place.partition("#")[0] for place in re.findall(r"\]\(([^)\s]+)\)", readme)]
    assert [place for place in places if not (ROOT / place).exists()] == []
    pages = {place.removeprefix("docs/") for place in places if re.fullmatch(r"docs/\w+\.md", place)}
    assert {page.name for page in DOCS.glob("*.md")} - {"index.md", "api.md"} <= pages


def test_the_names_beside_the_symbols_exist(rows):
    import jaxplan as jp
    from jaxplan import so3, trajectory
    from jaxplan.geometry import vectors
    from jaxplan.model import devices, spacecraft, zones
    from jaxplan.model.goals import Targets
    from jaxplan.model.path import Goal as PathGoal
    from jaxplan.model.path import Path as Way
    from jaxplan.model.scenario import SearchSettings, TrajectorySettings
    from jaxplan.trajectory import Samples

    homes = {
        "goal": PathGoal, "Path": Way, "vectors": vectors, "so3": so3, "spacecraft": spacecraft,
        "trajectory": trajectory, "Samples": Samples, "SearchSettings": SearchSettings, "Targets": Targets,
        "Trajectory": jp.Trajectory, "TrajectorySettings": TrajectorySettings, "KeepIn": zones.KeepIn,
        "KeepOut": zones.KeepOut, "Terminal": devices.Terminal, "Spacecraft": spacecraft.Spacecraft,
    }  # fmt: skip
    known = {key for _, key in rows}
    table = (DOCS / "method.md").read_text(encoding="utf-8").split("## Symbols")[1].partition("\n## ")[0]
    names = keys = 0
    for line in table.splitlines()[4:]:
        if not line.startswith("|"):
            continue
        code, file = line.split("|")[3:5]
        home = ""
        for name in re.findall(r"`([A-Za-z0-9_.]+)(?:\[k\])?`", code):
            first, _, last = name.rpartition(".")
            home = first or home
            if home:
                own = homes[home]
                has = {f.name for f in fields(own)} if is_dataclass(own) else set()
                assert last in has or hasattr(own, last), name
                names += 1
        for key in re.findall(r"`([a-z0-9_.]+)`", file):
            assert key.rpartition(".")[2] in known | {"keep_out", "keep_in"}, key
            keys += 1
    assert names > 25
    assert keys > 20


@pytest.mark.slow
def test_the_planner_of_the_example_finds_a_certified_plan(capsys):
    try:
        ran = runpy.run_path(str(DOCS / "examples" / "by_way_of.py"))
        plan = ran["plan"]
        assert plan.ok
        assert plan.scenario.search.method == "by-way-of"
        assert plan.search.expansions > 0  # the straight motion is not clear
        assert "certified" in capsys.readouterr().out
        with pytest.raises(ValueError, match="there is a planner of that name"):
            ran["add_planner"]("mha", ran["search"])
    finally:
        if "by-way-of" in PLANNERS:
            remove_planner("by-way-of")
    assert "by-way-of" not in PLANNERS


@pytest.mark.slow
def test_the_planner_of_the_example_for_many_finds_certified_plans():
    try:
        ran = runpy.run_path(str(DOCS / "examples" / "by_way_of_run.py"))
        assert [plan.status.name for plan in ran["plans"]] == ["OK", "OK"]
        assert all(plan.search.expansions > 0 for plan in ran["plans"])
    finally:
        if "by-way-of-run" in PLANNERS:
            remove_planner("by-way-of-run")


def blocks(file: Path, language: str) -> list[str]:
    """The blocks of code of a language in a page."""
    return re.findall(rf"```{language}\n(.*?)```", file.read_text(encoding="utf-8"), re.DOTALL)


def resolved(package: object, name: str) -> object:
    """What a name with dots stands for, the package being its first word; None where there is nothing."""
    for part in name.split(".")[1:]:
        package = getattr(package, part, None)
    return package


def commands(block: str) -> list[list[str]]:
    """The arguments of each line of a block of commands that calls jaxplan."""
    lines = (line.partition("#")[0].split() for line in block.splitlines())
    return [words[1:] for words in lines if words[:1] == ["jaxplan"]]


def test_every_command_on_the_pages_is_one_that_the_command_line_takes():
    parser, taken = _make_parser(), 0
    for page in PAGES:
        for block in blocks(page, "sh"):
            for words in commands(block):
                parser.parse_args(words)  # exits where it is not
                taken += 1
    assert taken > 35


def test_every_extra_on_the_pages_exists_and_the_readme_installs_what_the_tutorial_needs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = set(project["optional-dependencies"])
    told = [re.findall(r"'(?:jaxplan|\.)\[([\w,]+)\]'", page.read_text(encoding="utf-8")) for page in PAGES]
    asked = {extra for found in told for names in found for extra in names.split(",")}
    assert {"orbit", "oem", "view", "spice"} <= asked <= extras
    needed, _ = flat("tutorial.md").split("the extras ")[1].split(", as the README installs them")
    assert set(re.findall(r"`(\w+)`", needed)) == set(told[0][0].split(","))


def test_every_name_and_keyword_of_the_package_on_the_pages_exists():
    import jaxplan as jp

    named = called = 0
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for name in re.findall(r"`(jp(?:\.\w+)+)", re.sub(r"```.*?```", "", text, flags=re.DOTALL)):
            assert resolved(jp, name) is not None, (page.name, name)
            named += 1
        for node in (node for block in blocks(page, "python") for node in ast.walk(ast.parse(block))):
            if isinstance(node, ast.Attribute) and re.fullmatch(r"jp(\.\w+)+", ast.unparse(node)):
                assert resolved(jp, ast.unparse(node)) is not None, (page.name, ast.unparse(node))
                named += 1
            if isinstance(node, ast.Call) and re.fullmatch(r"jp(\.\w+)+", ast.unparse(node.func)):
                takes = inspect.signature(resolved(jp, ast.unparse(node.func))).parameters
                asked = {keyword.arg for keyword in node.keywords} - {None}
                free = any(one.kind is inspect.Parameter.VAR_KEYWORD for one in takes.values())
                assert free or asked <= set(takes), (page.name, ast.unparse(node))
                called += 1
    assert named > 150
    assert called > 60


@pytest.mark.slow
def test_the_first_commands_of_the_readme_run_one_after_the_other(tmp_path, monkeypatch, capsys):
    pytest.importorskip("k3d")
    monkeypatch.chdir(tmp_path)
    install, _, first = blocks(ROOT / "README.md", "sh")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = re.findall(r"^make (\w+)", install, re.MULTILINE)
    assert targets == ["plan", "test"]
    assert all(f"\n{target}: " in makefile for target in [*targets, "setup"])
    asked = commands(first)
    assert [words[0] for words in asked] == ["new", "validate", "plan", "check", "report", "view", "export"]
    for words in asked:
        assert main(words) == 0, words
    assert (tmp_path / "slew.aem").read_text(encoding="utf-8").startswith("CCSDS_AEM_VERS")
    capsys.readouterr()


@pytest.mark.slow
def test_the_examples_of_the_readme_run_and_print_what_it_says(tmp_path, monkeypatch, capsys):
    pytest.importorskip("k3d")
    import jaxplan as jp

    readme = ROOT / "README.md"
    (file,) = blocks(readme, "toml")
    (tmp_path / "observer.toml").write_text(file, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    first, from_file = blocks(readme, "python")
    names: dict[str, object] = {}
    exec(first, names)
    assert jp.load_plan("plan.json").ok
    capsys.readouterr()
    exec(from_file, names)
    printed, (said,) = capsys.readouterr().out, blocks(readme, "text")
    alike(printed, said)
    in_python, *_ = blocks(DOCS / "plans.md", "python")
    exec(in_python, names)
    assert names["scenario"] == jp.load_scenario("observer.toml")


@pytest.mark.slow
def test_what_the_page_on_plans_does_with_a_plan_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, work = blocks(DOCS / "plans.md", "python")
    few = work.replace("range(20)", "range(2)").replace("animate(plan)", "animate(plan, frames=4)")
    assert "range(2)" in few
    assert "frames=4" in few
    names: dict[str, object] = {}
    exec(f"import numpy as np\nimport jaxplan as jp\n{few}", names)
    assert names["plan"].ok
    assert {"slew.gif", "plan.json", "slew.html"} <= {file.name for file in tmp_path.iterdir()}
    assert "certified" in capsys.readouterr().out


@pytest.mark.slow
def test_the_scenarios_of_the_page_on_zones_are_planned(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    groups, fields_of_view = blocks(DOCS / "zones.md", "python")
    exec(groups, names)
    assert "certified" in capsys.readouterr().out
    exec(fields_of_view, names)
    assert names["plan"].ok


@pytest.mark.slow
def test_the_page_on_spacecraft_has_one_scenario_in_its_files_and_in_python(tmp_path):
    import jaxplan as jp

    page = DOCS / "spacecraft.md"
    file = tmp_path / "scene.toml"
    file.write_text("\n".join(blocks(page, "toml")), encoding="utf-8")
    names: dict[str, object] = {}
    exec("\n".join(blocks(page, "python")), names)
    assert names["plan"].ok
    assert names["plan"].scenario == jp.load_scenario(file)
    assert names["scenario"].spacecraft.joint_count == 3


def test_the_page_on_timelines_has_one_timeline_that_can_be_read(tmp_path):
    pytest.importorskip("erfa")
    import jaxplan as jp

    file = tmp_path / "day.toml"
    file.write_text("\n".join(blocks(DOCS / "timelines.md", "toml")), encoding="utf-8")
    day = jp.load_timeline(file)
    assert [one.kind for one in day.activities] == ["track", "track", "point", "attitude"]
    text = file.read_text(encoding="utf-8")
    for old, new in (
        ("for_s = 12", "for_s = -12"),
        ("track = { antenna", "track = { antena"),
        ('after = "rome"', 'after = "roma"'),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    file.write_text(text, encoding="utf-8")
    with pytest.raises(jp.ScenarioError) as caught:
        jp.load_timeline(file)
    told = (DOCS / "timelines.md").read_text(encoding="utf-8")
    assert all(fault in told for fault in caught.value.faults)
    assert len(caught.value.faults) == 3


@pytest.mark.slow
def test_the_timeline_of_its_page_is_planned(tmp_path, monkeypatch, capsys):
    pytest.importorskip("erfa")
    (tmp_path / "day.toml").write_text("\n".join(blocks(DOCS / "timelines.md", "toml")), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec("\n".join(blocks(DOCS / "timelines.md", "python")), names)
    assert names["day"].ok
    assert names["again"].certified


def flat(name: str) -> str:
    """The text of a page of the manual in one line."""
    return " ".join((DOCS / name).read_text(encoding="utf-8").split())


def alike(printed: str, said: str, rel: float = 0.02) -> None:
    """Assert that two texts differ in numbers alone, and these by 2 % or, where they round, by 1e-5."""
    number = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
    assert re.sub(rf" *{number}", "#", printed.strip()) == re.sub(rf" *{number}", "#", said.strip())
    for own, told in zip(*(map(float, re.findall(number, text)) for text in (printed, said)), strict=True):
        assert own == pytest.approx(told, rel=rel, abs=1e-5)


@pytest.mark.slow
def test_the_tutorial_can_be_followed_to_its_end(tmp_path, monkeypatch, capsys):
    pytest.importorskip("erfa")
    pytest.importorskip("k3d")
    page = DOCS / "tutorial.md"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "kite.toml").write_text("\n".join(blocks(page, "toml")), encoding="utf-8")
    (tmp_path / "demo.c").write_text(*blocks(page, "c"), encoding="utf-8")
    names: dict[str, object] = {}
    printed, by_code, compared = "", "", 0
    found = re.findall(r"```(sh|python|text)\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for language, block in found:
        if language == "text":
            alike(printed, block)
            compared += 1
        elif language == "python":
            exec(block, names)
            printed = capsys.readouterr().out
        elif block.startswith("jaxplan"):
            for words in commands(block):
                assert main(words) == 0, words
            printed = capsys.readouterr().out
        elif shutil.which("cc") is not None:
            built = subprocess.run(["sh", "-e", "-c", block], capture_output=True, text=True)
            assert (built.returncode, built.stderr) == (0, "")
            by_code = built.stdout
    assert compared == 5
    made = ("spacecraft.png", "margins.png", "overview.png", "plan.view.html")
    assert all((tmp_path / "out" / name).exists() for name in made)
    half = names["half"]
    if by_code:
        own = [*half.attitude[:, 2], half.joints[0]]
        np.testing.assert_allclose([float(word) for word in by_code.split()], own, atol=1e-11)


@pytest.mark.slow
def test_the_table_of_its_page_is_proved_and_has_a_few_rows_that_do(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    checked, few = blocks(DOCS / "tables.md", "sh")
    for words in commands(checked):
        capsys.readouterr()
        assert main(words) == 0, words
    alike(capsys.readouterr().out, *blocks(DOCS / "tables.md", "text"))
    (words,) = commands(few)
    assert main(words) == 0
    rows, numbers = map(int, re.search(r"(\d+) rows, (\d+) numbers", capsys.readouterr().err).groups())
    said = re.search(r"take (\d+) to (\d+) rows instead of 801, (\d+) to (\d+) numbers", flat("tables.md"))
    least, most, fewest, greatest = map(int, said.groups())
    assert least <= rows <= most
    assert fewest <= numbers <= greatest


@pytest.mark.slow
def test_the_studies_of_their_page_are_made_and_compared(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    code, own = blocks(DOCS / "studies.md", "python")
    few = code.replace("range(200)", "range(2)").replace("workers=2, ", "")
    if find_spec("pandas") is None or find_spec("pyarrow") is None:
        few = few.replace('studies["mha"].to_parquet', "#")
    names: dict[str, object] = {}
    exec(few, names)
    assert [len(study.table) for study in names["studies"].values()] == [2, 2]
    assert "McNemar" in capsys.readouterr().out
    exec(own.replace("range(200)", "range(2)"), names)
    assert all(row["breaks"] >= 2 for row in names["study"].table if row["certified"])
    _, report, folder = commands(*blocks(DOCS / "studies.md", "sh"))
    assert main(report) == 0
    (tmp_path / folder[-1]).mkdir()
    (tmp_path / folder[-1] / "mine.toml").write_text(case_path("case-4").read_text())
    assert main(folder) == 0
    assert "mine.toml" in capsys.readouterr().out
    assert list((tmp_path / "figures").glob("*.png"))


@pytest.mark.slow
def test_the_shell_of_its_page_is_planned_for_a_switch_and_over_time(tmp_path, monkeypatch, capsys):
    pytest.importorskip("erfa")
    monkeypatch.chdir(tmp_path)
    switch, fleet, _ = blocks(DOCS / "constellations.md", "python")
    few = switch.replace("workers=2)", "satellites=[17, 1000])")
    short = fleet.replace("duration_s=5739.0", "duration_s=300.0")
    short = short.replace("range(0, 1584, 132), workers=2", "[0, 132]")
    assert few != switch
    assert "[0, 132]" in short
    assert "300.0" in short
    names: dict[str, object] = {}
    exec(few, names)
    assert names["plan"].ok
    assert names["result"].certified.all()
    exec(short, names)
    assert names["day"].ok
    assert "satellite" in capsys.readouterr().out


def rows_of(page: str, headings: str) -> list[list[float]]:
    """The numbers of each row of the table whose headings begin so."""
    lines = (DOCS / page).read_text(encoding="utf-8").partition(f"\n{headings}")[2].splitlines()[2:]
    rows = takewhile(lambda line: line.startswith("|"), lines)
    return [[float(word) for word in re.findall(r"\d+(?:\.\d+)?(?:e-\d+)?", row)] for row in rows]


@pytest.mark.paper
@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_what_is_told_of_the_papers_cases_is_found(number):
    import jaxplan as jp

    case = jp.paper_case(number)
    plan, most = jp.plan(case), []
    shares = ("angular_velocity", "angular_acceleration", "joint_rates", "joint_accelerations")
    own = [len(plan.path.attitudes) - 2, plan.path.length]
    own += [*(100 * plan.certificate.peaks[name] for name in shares), np.rad2deg(plan.certificate.min_margin)]
    slews = rows_of("published.md", "| case | goal slew")[number - 1]
    assert slews[2] == pytest.approx(plan.goal.slew_angle, abs=6e-5)
    assert_each(np.abs(np.subtract(slews[-7:], own)), "<=", [0, 6e-3, *[0.51] * 4, 6e-3])

    for method, duration, criterion in (
        ("paper", "stretched", "least_rotation"),
        ("global", "stretched", "least_rotation"),
        ("global", "minimum", "least_rotation"),
        ("global", "minimum", "least_time"),
    ):
        goal = replace(case.goal, criterion=criterion)
        trajectory = replace(case.trajectory, method=method, duration=duration)
        most.append(jp.plan(replace(case, goal=goal, trajectory=trajectory)))
    paper, stretched, minimum, least = (each.trajectory.duration for each in most)
    bound, least_bound = most[2].duration_bound, most[3].duration_bound
    margin = np.rad2deg(most[2].certificate.min_margin)
    own = [paper, stretched, minimum, bound, 100 * (minimum / bound - 1), margin, least, least_bound]
    told = rows_of("published.md", "| case | paper, printed")[number - 1]
    assert told[:2] == [number, plan.trajectory.duration]
    np.testing.assert_allclose(own, told[2:], rtol=2e-3, atol=0.06)


@pytest.mark.slow
def test_the_turns_that_the_page_on_limits_tells_of_last_as_long():
    import jaxplan as jp

    deg, own = np.deg2rad, []
    craft = jp.Spacecraft(
        instruments=[jp.Instrument(name="eye", boresight=[0, 0, 1])],
        rate_limit=deg(3),
        acceleration_limit=deg(2),
    )
    for turn in (180, 90):
        for duration in ("stretched", "minimum"):
            plan = jp.plan(
                jp.Scenario(
                    name="turn",
                    spacecraft=craft,
                    start=jp.GivenState(rotation_vector=[0, 0, 0], joints=[]),
                    goal=jp.GivenState(rotation_vector=[0, 0, deg(turn)], joints=[]),
                    trajectory=jp.TrajectorySettings(duration=duration),
                )
            )
            own.append(plan.trajectory.duration)
        own.append(plan.duration_bound)
    said = flat("limits.md").partition("nothing in the way takes ")[2].partition(" - ")[0]
    told = [float(word) for word in re.findall(r"(\d+\.\d) s", said)]
    np.testing.assert_allclose(own, told, atol=0.06)


@pytest.mark.slow
def test_the_slew_times_of_their_page_are_certified(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (code,) = blocks(DOCS / "slew_times.md", "python")
    here = code.replace("workers=2, ", "")
    assert here != code
    names: dict[str, object] = {}
    exec(here, names)
    there_and_back = ~np.eye(2, dtype=bool)
    assert names["slews"].certified[there_and_back].all()
    assert names["plan"].ok
    assert "vela" in capsys.readouterr().out


@pytest.mark.slow
def test_the_slopes_of_the_page_on_derivatives_are_those_of_its_plan(capsys):
    code, of_keys, of_day = blocks(DOCS / "derivatives.md", "python")
    slopes, tuned, _ = code.partition("result = jp.tune(")
    assert tuned
    names: dict[str, object] = {}
    exec(slopes, names)
    capsys.readouterr()
    exec(of_keys, names)
    assert capsys.readouterr().out.startswith("smallest margin ")
    # A given effort falls with the duration to the power of three.
    slope = names["slopes"].trajectory.duration
    trajectory = names["trajectory"](names["plan"].scenario)
    effort = float(names["effort"](names["plan"].scenario))
    assert slope == pytest.approx(-3 * effort / trajectory.duration, rel=0.5)
    assert slope < 0
    scene = names["scenario"]
    stay = jp.Activity(name="stay", idle=True, duration=20.0)
    names["timeline"] = jp.Timeline(name="day", scene=scene, activities=(stay,))
    capsys.readouterr()
    exec(of_day, names)
    assert capsys.readouterr().out.startswith("total time 20 s")

"""The gallery: each of its files planned, with numbers, pictures and, where it can be had, something to turn.

A page of gallery/ has what is asked and what one sees, and includes the piece that is made here of the file
of the same name. Nothing here needs Sphinx.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import jaxplan as jp

FOLDER = Path(__file__).parent / "gallery"
SMALL, DPI = 40, 110  # dots an inch, of the pictures of the index and of the pages
HEIGHT = 780  # px, of the view


def names() -> list[str]:
    """The examples, in the order of the index."""
    tree = (FOLDER / "index.md").read_text(encoding="utf-8").split("```{toctree}")[1]
    return [line for line in tree.partition("```")[0].split() if not line.startswith(":")]


def plan_of(name: str) -> jp.Plan | jp.TimelinePlan:
    """The certified plan of an example."""
    file = FOLDER / f"{name}.toml"
    if 'kind = "timeline"' in file.read_text(encoding="utf-8"):
        return jp.plan_timeline(jp.load_timeline(file))
    return jp.plan(jp.load_scenario(file))


def write(generated: Path) -> None:
    """Make the pieces of all pages, the one of the index, and the views.

    Args:
        generated: the folder that is written, of which extra/ goes into the manual as it is.
    """
    pieces, views = generated / "gallery", generated / "extra" / "gallery"
    pieces.mkdir(parents=True)
    views.mkdir(parents=True)
    for name in names():
        plan = plan_of(name)
        large, small = pieces / f"{name}.png", pieces / f"{name}-small.png"
        _picture(plan, large, small)
        shows = f"{title(name)}: what devices see, angles, margins and rates"
        parts = [
            numbers(plan),
            f"![{shows}](../generated/gallery/{large.name})\n",
            viewer(plan, views / f"{name}-view.html"),
        ]
        (pieces / f"{name}.md").write_text("\n".join(filter(None, parts)), encoding="utf-8")
    (pieces / "index.md").write_text(index(), encoding="utf-8")


def title(name: str) -> str:
    """The heading of an example's page."""
    return _page(name)[0].removeprefix("# ")


def index() -> str:
    """A row for each example: a small picture, its title, and the first sentence of its page."""
    lines = ["| | |", "|---|---|"]
    for name in names():
        about = " ".join(_page(name)[1].split()).partition(". ")[0].rstrip(".")
        picture = f"[![{title(name)}](../generated/gallery/{name}-small.png)]({name}.md)"
        lines.append(f"| {picture} | **[{title(name)}]({name}.md)**: {about}. |")
    return "\n".join(lines) + "\n"


def _page(name: str) -> list[str]:
    return (FOLDER / f"{name}.md").read_text(encoding="utf-8").split("\n\n")


def numbers(plan: jp.Plan | jp.TimelinePlan) -> str:
    """A table of what was found and proved."""
    lines = ["| | |", "|---|---|"]
    return "\n".join([*lines, *(f"| {word} | {value} |" for word, value in _numbers(plan))]) + "\n"


def _numbers(plan: jp.Plan | jp.TimelinePlan) -> Iterator[tuple[str, str]]:
    proof = plan.certificate
    yield "duration", f"{plan.trajectory.duration:.2f} s"
    if isinstance(plan, jp.TimelinePlan):
        asked = {activity.name for activity in plan.timeline.activities}
        done = sum(one.ok and one.name in asked for one in plan.activities)
        yield "activities done", f"{done} of {len(asked)}"
        worst = max(one.pointing_error or 0.0 for one in plan.activities)
        yield "pointing error", f"{np.rad2deg(worst):.1g} deg at most"
    else:
        yield "turn of the platform", f"{np.rad2deg(plan.goal.slew_angle):.2f} deg from start to goal"
        yield "no motion takes less than", f"{plan.duration_bound:.2f} s to this goal, zones aside"
    if proof.min_margin is not None:
        where = f"{proof.worst_device} to {proof.worst_zone} at {proof.worst_time:.2f} s"
        yield "smallest margin", f"{np.rad2deg(proof.min_margin):.3f} deg, {where}"
    effort = float(jp.measures.effort(plan.trajectory)) * np.rad2deg(1.0) ** 2
    yield (
        "effort",
        f"{effort:.4g} (deg/s²)² s, the integral of the platform's and joints' squared accelerations",
    )
    limit, share = max(proof.peaks.items(), key=lambda item: item[1])
    yield "nearest to its limit", f"{limit.replace('_', ' ')}, {100 * share:.1f} %"
    yield "certified", "yes, at every instant" if proof.certified else "no"


def _picture(plan: jp.Plan | jp.TimelinePlan, large: Path, small: Path) -> None:
    """Draw the whole plan, and the sphere as seen from without for the index."""
    _, figure = next(iter(jp.plot.figures(plan)))  # of a timeline its day, of all others the overview
    figure.savefig(large, dpi=DPI)
    axes = jp.plot.globe(plan, legend=False)
    axes.set_title("", loc="left")
    axes.set_xlabel("")
    for words in axes.texts:
        words.set_visible(False)
    axes.figure.savefig(small, dpi=SMALL, bbox_inches="tight")


def viewer(plan: jp.Plan | jp.TimelinePlan, file: Path) -> str:
    """Write the view of a plan, where `jaxplan.view` and what it needs are there; returns a frame with it."""
    view = getattr(jp, "view", None)
    if view is None or find_spec("k3d") is None:
        return ""
    view(plan).save(file)
    style = f"width: 100%; height: {HEIGHT}px; border: 0"
    frame = f'<iframe src="{file.name}" title="{plan.scenario.name}" loading="lazy" style="{style}"></iframe>'
    return f"```{{raw}} html\n{frame}\n```\n"

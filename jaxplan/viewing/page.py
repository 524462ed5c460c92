"""The page of a viewer: one self-contained HTML file, which loads nothing over a network.

The pictures in space are drawn by three.js, which the package k3d (extra ``view``) ships as JavaScript within
its wheel; it is taken from there unchanged. The page's own scripts are in the folder `static`: `motion.js`
evaluates the polynomials, `world.js` draws the scene in space, `charts.js` the curves, and `controls.js`
handles time, keys and pointer.
"""

import html
import json
import os
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from jaxplan.planner import Plan
from jaxplan.runtime.arguments import expect, expect_any, file_path
from jaxplan.runtime.files import free_place, replacing_file
from jaxplan.timeline.record import TimelinePlan

_SCRIPTS = ("motion.js", "world.js", "charts.js", "controls.js")
_K3D_MISSING = "the viewer needs k3d, which brings three.js: pip install 'jaxplan[view]'"
HEIGHT = 760
"""Pixels: of the viewer in a notebook, unless told."""


class View:
    """A page that shows a plan in space, for a notebook or as a file of its own; made by `view`.

    Args:
        title: of the page.
        data: what it shows, as `jaxplan.viewing.content.content` returns it.
        height: pixels that it takes in a notebook.
    """

    def __init__(self, title: str, data: dict[str, Any], height: int = HEIGHT) -> None:
        self.title, self.data, self.height = title, data, height

    @property
    def html(self) -> str:
        """The whole page as HTML text, put together anew at each access."""
        parts = {
            "TITLE": html.escape(self.title),
            "STYLE": _read_static("page.css"),
            "LIBRARY": _read_three_js(),
            "SCRIPTS": "\n".join(map(_read_static, _SCRIPTS)),
            "DATA": json.dumps(self.data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c"),
        }
        pieces = _read_static("page.html").split("@")
        return "".join(parts.get(piece, piece) for piece in pieces)

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write the page to a file, which any browser opens, also without a network.

        Args:
            path: the file. It appears whole or not at all; its folder is made.
            overwrite: whether an existing file may be replaced. Plans, and files of scenarios and timelines,
                are never replaced.

        Returns:
            The path.

        Raises:
            TypeError: if it is no path.
            ValueError: if the path is empty or a folder.
            FileExistsError: if there is a file at the path that may not be replaced, or a device or pipe.
        """
        file_path("path", path)
        target = free_place(path, overwrite=overwrite)
        with replacing_file(target) as fresh:
            fresh.write_text(self.html, encoding="utf-8")
        return target

    def __repr__(self) -> str:
        return f"<View of {self.title}: .save('slew.html') writes its page>"

    def _repr_html_(self) -> str:
        """Return the page in an HTML frame (iframe), as a notebook shows it."""
        return (
            f'<iframe srcdoc="{html.escape(self.html)}" title="{html.escape(self.title)}" '
            f'style="width: 100%; height: {self.height}px; border: 0"></iframe>'
        )


def view(plan: Plan | TimelinePlan, *, height: int = HEIGHT) -> View:
    """Show a plan in space: the sphere with its zones, the spacecraft, beams and their trails, and a clock.

    Args:
        plan: a plan with a trajectory, of a scenario or a timeline.
        height: pixels that it takes in a notebook, 200 to 10,000.

    Returns:
        The view, which a notebook shows, and whose `View.save` writes a page.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, the height is out of range, or the extra ``view`` is not
            installed.

    Example:
        >>> jp.view(plan).save("slew.html")
    """
    expect_any("plan", plan, (Plan, TimelinePlan), "a plan, as of jp.plan, jp.plan_timeline or jp.load_plan")
    expect("height", height, int)
    if not 200 <= height <= 10_000:
        raise ValueError(f"height = {height}: must lie in [200, 10000] pixels")
    if plan.trajectory is None:
        ending = ": ".join(filter(None, [plan.status.name, plan.message]))
        raise ValueError(
            f"the plan of {plan.scenario.name!r} has no trajectory to show; it ended as {ending}"
        )
    if find_spec("k3d") is None:
        raise ValueError(_K3D_MISSING)
    from jaxplan.viewing.content import content  # it needs matplotlib, for its colours

    return View(plan.scenario.name, content(plan), height)


def _read_static(name: str) -> str:
    """Return the text of a file in the folder `static` of this package."""
    return files("jaxplan.viewing").joinpath("static", name).read_text(encoding="utf-8")


@cache
def _read_three_js() -> str:
    """Return k3d's script that holds three.js, changed only so that it cannot end an HTML script tag."""
    script = files("k3d").joinpath("static", "standalone.js")
    if not script.is_file():
        raise ValueError("k3d has no static/standalone.js, as release 3.2 has: pip install 'jaxplan[view]'")
    return script.read_text(encoding="utf-8").replace("</script", "<\\/script")

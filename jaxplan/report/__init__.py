"""A plan as a page for people: ``jp.report_html(plan, "slew.html")``.

The page is one file that asks for no other: figures are inside it, nothing in it runs, and it forbids
browsers to load anything. It follows the reader's choice of light or dark, and prints in light. `markup`
makes HTML in which no text of a scenario can be anything but text, `tables` has what was asked
and what was found, `document` puts it together.
"""

import errno
import os
from pathlib import Path

from jaxplan.planner import Plan
from jaxplan.report.document import page
from jaxplan.runtime.arguments import expect, file_path
from jaxplan.runtime.files import replacing_file

__all__ = ["report_html"]


def report_html(plan: Plan, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a self-contained HTML page on a plan.

    It shows scenario, goal, path, trajectory, the certificate with every margin and peak, figures, timings,
    and the scenario file to plan it again. The certificate is made anew for it. Of a plan that failed it says
    at which step and what to change.

    Args:
        plan: of any status.
        path: the file. It appears whole or not at all; its folder is made.
        overwrite: whether an old file may be replaced.

    Returns:
        The path.

    Raises:
        TypeError: for what is no plan or path.
        ValueError: if the path is empty, or a folder.
        FileExistsError: if there is a file at the path, and it may not be replaced.
    """
    expect("plan", plan, Plan, "jp.plan makes one of a scenario")
    file_path("path", path)
    target = _free_place(path, overwrite)
    text = page(plan)
    with replacing_file(target) as fresh:
        fresh.write_text(text, encoding="utf-8")
    return target


def _free_place(path: str | os.PathLike[str], overwrite: bool) -> Path:
    """The place to write to, if what is there may go."""
    if not os.fspath(path):
        raise ValueError("path is empty, it must name a file to write")
    target = Path(path)
    if target.is_dir():
        raise ValueError(f"{target}: is a folder, and the page is a file")
    if os.path.lexists(target) and not overwrite:
        hint = "is there already; overwrite=True (--force) replaces it"
        raise FileExistsError(errno.EEXIST, hint, os.fspath(path))
    return target

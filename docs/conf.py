"""The manual, built by Sphinx with ``make docs``.

Sphinx, since it takes docstrings as they are, and fails where one names what is not there; MyST lets pages be
Markdown, and shows the notebooks with the outputs that they hold. Pages that follow from the code are made by
`pages` into generated/ each time.
"""

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import pages  # noqa: E402

from jaxplan.version import __version__  # noqa: E402

pages.write(HERE / "generated")

project = "jaxplan"
author = "the authors of jaxplan"
release = version = __version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml"]
html_math_renderer = "mathml"
exclude_patterns = ["examples", "generated/statuses.md", "generated/gallery"]
templates_path: list[str] = []
default_role = "py:obj"  # what stands between single backticks in docstrings

smartquotes = False  # keys and values are there to be copied

html_theme = "furo"
html_static_path = ["static"]
html_extra_path = ["generated/extra"]  # views of the gallery's plans
html_css_files = ["manual.css"]
html_title = "jaxplan"
html_show_sourcelink = False
html_show_copyright = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # they hold their outputs, and the tests run them

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]  # a name that several classes have, between single backticks


def _keep_returns(app: Any, what: str, name: str, thing: object, options: Any, lines: list[str]) -> None:
    """Write out what is returned, since Napoleon takes all before a colon in it for a type."""
    for heading in ("Returns:", "Yields:"):
        if heading not in lines:
            continue
        begin = lines.index(heading)
        end = next((i for i in range(begin + 1, len(lines)) if lines[i][:1].strip()), len(lines))
        told = [line.strip() for line in lines[begin + 1 : end]]
        lines[begin:end] = [f":returns: {told[0]}", *(f"    {line}" if line else "" for line in told[1:])]


def setup(app: Any) -> None:
    """Tell Sphinx of it, before Napoleon."""
    app.connect("autodoc-process-docstring", _keep_returns, priority=400)

r"""Formulas as MathML, which browsers show by themselves: pages need no script and no network for them.

Docutils translates the LaTeX; what it does not know is an error of the build. ``\tag{...}`` becomes the
number at the right.
"""

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, Any]:
    """Tell Sphinx of it."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    tags = re.findall(r"\\tag\{([^}]*)\}", node.astext())
    formula = tex2mathml(re.sub(r"\\tag\{[^}]*\}", "", node.astext()).strip(), as_block=True)
    number = f'<span class="number">({tags[0]})</span>' if tags else ""
    writer.body.append(f'<div class="formula">{formula}{number}</div>\n')
    raise nodes.SkipNode

"""A whole HTML document around the content of a page, which loads nothing.

Nothing in it runs, unless it holds a viewer in a frame of its own.
"""

from importlib.resources import files

from jaxplan.report.markup import Markup, tag

# What a browser may load: pictures and looks that are in the page itself.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
# Of a page with a viewer: it holds for frames, too; the viewer's library names fonts that are never used.
_RUNNING = f"{_POLICY}; script-src 'unsafe-inline'; font-src data: 'self' file:"


def document(title: str, main: Markup, *, running: bool = False) -> str:
    """The document of a page with a title, in the looks of all pages; `running` where it holds a viewer."""
    style = Markup(files("jaxplan.report").joinpath("page.css").read_text(encoding="utf-8"))
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_RUNNING if running else _POLICY),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name_="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", style),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', main), lang='en')}\n"

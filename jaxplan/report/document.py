"""A complete HTML document around the content of a page.

It loads nothing, and no script runs in it unless it holds a viewer in a frame of its own.
"""

from importlib.resources import files

from jaxplan.report.markup import Markup, tag

# Content security policy: a browser may use only images and styles that are in the page itself.
_STATIC_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
)
# The policy of a page with a viewer, which frames inherit; the viewer's library names fonts it never uses.
_VIEWER_POLICY = f"{_STATIC_POLICY}; script-src 'unsafe-inline'; font-src data: 'self' file:"


def document(title: str, main: Markup, *, running: bool = False) -> str:
    """Make the text of an HTML document in the style of all pages.

    Args:
        title: of the document.
        main: its content.
        running: whether it holds a viewer, whose scripts must be allowed to run.
    """
    style = Markup(files("jaxplan.report").joinpath("page.css").read_text(encoding="utf-8"))
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag(
            "meta",
            http_equiv="Content-Security-Policy",
            content=_VIEWER_POLICY if running else _STATIC_POLICY,
        ),
        tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name_="color-scheme", content="light dark"),
        tag("title", title),
        tag("style", style),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', main), lang='en')}\n"

"""Interactive pages that show a plan in space, to be turned and played, reached as ``jp.view``."""

from jaxplan.viewing.page import View, view

__all__ = ["View", "view"]

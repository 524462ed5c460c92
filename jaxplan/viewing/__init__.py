"""Plans to turn in one's hands, reached as ``jp.view``."""

from jaxplan.viewing.page import View, view

__all__ = ["View", "view"]

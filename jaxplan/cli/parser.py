"""The parser of the command line, whose error messages suggest what may have been meant."""

import argparse
import difflib
import sys
from typing import Any, NoReturn

from jaxplan.cli.common import BAD_INPUT


class Parser(argparse.ArgumentParser):
    """A parser that reports unknown arguments with the usage of the subcommand, and points to its help."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and what is wrong with the arguments, and exit with `BAD_INPUT`."""
        self.print_usage(sys.stderr)
        self.exit(BAD_INPUT, f"{self.prog}: error: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments as argparse does, but treat an unknown one as an error instead of returning it."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}{self._suggestion_for(left[0])}")
        return known, left

    def _suggestion_for(self, word: str) -> str:
        """Advice on an unknown word, to end a message: a similar option, or how to name an output file.

        Returns:
            The advice, which begins with a comma or semicolon; empty if there is none.
        """
        options = self._option_string_actions
        if word.startswith("-"):
            close = difflib.get_close_matches(word.partition("=")[0], list(options), n=1)
            return f", perhaps {close[0]} is meant" if close else ""
        return f"; what is written is named by -o {word}" if "." in word and "-o" in options else ""

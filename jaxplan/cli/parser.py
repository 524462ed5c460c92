"""The parser of the command line, whose errors say what may have been meant."""

import argparse
import difflib
import sys
from typing import Any, NoReturn

from jaxplan.cli.common import BAD_INPUT


class Parser(argparse.ArgumentParser):
    """A parser whose errors are those of the subcommand that was given, and point to its help."""

    def error(self, message: str) -> NoReturn:
        """Print the usage and what is wrong with the arguments, and exit with `BAD_INPUT`."""
        self.print_usage(sys.stderr)
        self.exit(BAD_INPUT, f"{self.prog}: error: {message}; see {self.prog} --help\n")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; one that is not known is an error."""
        known, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"unrecognized arguments: {' '.join(left)}{self._meant(left[0])}")
        return known, left

    def _meant(self, word: str) -> str:
        """Advice on an unknown word, to end a message: an option like it, or how to name a file."""
        options = self._option_string_actions
        if word.startswith("-"):
            close = difflib.get_close_matches(word.partition("=")[0], list(options), n=1)
            return f", perhaps {close[0]} is meant" if close else ""
        return f"; what is written is named by -o {word}" if "." in word and "-o" in options else ""

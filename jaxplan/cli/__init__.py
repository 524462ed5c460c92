"""The command line: ``jaxplan new``, ``validate``, ``plan`` and what follows from a plan, and studies.

Results go to stdout, messages and progress to stderr. Exit codes: 0 done, 1 no plan, 2 bad input, 3 not
certified. Heavy imports wait until a command needs them, so that ``--help`` answers at once.
"""

import argparse
import os
import sys
from collections.abc import Sequence

from jaxplan.cli import plans, scenes, studies
from jaxplan.cli.common import BAD_INPUT, DONE, Parser, complain

DESCRIPTION = "Plan certified attitude manoeuvres of spacecraft with several pointing devices."
EXIT_CODES = "Exit codes: 0 done, 1 no plan, 2 bad input, 3 not certified."
FIRST_STEPS = """\
  jaxplan new scene.toml            write a scene to begin with, and change it
  jaxplan validate scene.toml       see whether all is right with it
  jaxplan plan scene.toml -o out    plan it: out/plan.json and figures"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code.

    Args:
        arguments: the words after ``jaxplan``; those of the process by default.
    """
    options = _parser().parse_args(arguments)
    try:
        code = int(options.run(options))
        sys.stdout.flush()  # here it can still be said that there was no room
        return code
    except KeyboardInterrupt:
        return complain("interrupted", 130)
    except BrokenPipeError:  # whoever read our output has gone
        _drop_output()
        return DONE
    except OSError as error:
        _drop_output()
        place = "" if error.filename is None else f"{os.fspath(error.filename)}: "
        return complain(f"{place}{error.strerror or error}", BAD_INPUT)
    except ValueError as error:  # ScenarioError and PlanFileError are such
        return complain(str(error), BAD_INPUT)


def _drop_output() -> None:
    """Forget output that nobody takes, lest Python complains of it at its end."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="jaxplan",
        description=DESCRIPTION,
        epilog=f"first steps:\n{FIRST_STEPS}\n\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    scenes.add_commands(commands)
    plans.add_commands(commands)
    studies.add_commands(commands)
    parser.set_defaults(run=lambda options: _no_command(parser, options))
    return parser


def _no_command(parser: argparse.ArgumentParser, options: argparse.Namespace) -> int:
    if options.version:
        from jaxplan.version import __version__

        print(f"jaxplan {__version__}")
        return DONE
    parser.print_help(sys.stderr)
    return BAD_INPUT

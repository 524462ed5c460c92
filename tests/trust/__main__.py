"""Print what was counted of everything that is claimed, in one table.

    PYTHONPATH=tests python -m trust                          all of it, by far the longest the mixed scenes
    PYTHONPATH=tests python -m trust --share 0.01             a hundredth of each count
    PYTHONPATH=tests python -m trust --only verdicts mixed    some parts
    PYTHONPATH=tests python -m trust --only mixed --seeds 17  one attempt again

Exit code 0 if there is no failure. Failures go to stderr as they are found.
"""

import argparse
import os
import sys
import tempfile
import time

# Before jax is imported: what one part compiles the others read.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="jaxplan-trust-")
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

from collections.abc import Sequence
from dataclasses import replace

from trust.parts import PARTS
from trust.tally import Tally, table


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, and print the table; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m trust", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), metavar="PART", help=HELP)
    parser.add_argument("--share", type=float, default=1.0, help="of each count (%(default)s)")
    parser.add_argument("--first", type=int, default=0, help="seed (%(default)s)")
    parser.add_argument("--seeds", type=int, nargs="+", help="these alone, of a part that has seeds")
    options = parser.parse_args(arguments)
    tallies: list[Tally] = []
    for name in options.only:
        part = PARTS[name]
        seeds: Sequence[int] = range(options.first, options.first + max(1, round(options.share * part.count)))
        began = time.monotonic()
        found = part.run(seeds if options.seeds is None else options.seeds)
        tallies += [replace(one, replay=f"--only {name} --seeds") for one in found]
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    print(table(tallies))
    return int(any(one.failures for one in tallies))


HELP = "any of " + ", ".join(PARTS)

if __name__ == "__main__":
    sys.exit(main())

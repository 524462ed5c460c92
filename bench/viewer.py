"""The viewer's pages: how large they are, what a frame takes of script, and how far their matrices are off.

Pages of a case of the paper and of the two example timelines are opened in a headless Chromium from files,
without a network and with a renderer in software. The first second, in which it compiles its shaders, does
not count.

    python bench/viewer.py [--seconds 6]
"""

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import positive

sys.path.append(str(Path(__file__).parents[1] / "tests"))
from browser import BROWSER, matrices, opened, played, read_back

import jaxplan as jp

INSTANTS = 10


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=positive, default=6, help="for which a page plays")
    options = parser.parse_args()
    if BROWSER is None:
        parser.error("needs chromium or google-chrome on the path")
    print_machine("k3d", pinned=False)
    plans = {
        "case 2": jp.plan(jp.paper_case(2), progress=False),
        "case-imaging": jp.plan_timeline(jp.example_timeline("case-imaging")),
        "case-day": jp.plan_timeline(jp.example_timeline("case-day")),
    }
    print(
        f"{'plan':15}{'page, MB':>10}{'frames':>8}{'ms':>7}{'95 %':>8}{'largest':>9}{'matrices off':>14}"
        f"{'errors':>8}"
    )
    for name, plan in plans.items():
        page = jp.view(plan).html
        times = np.linspace(0, plan.trajectory.duration, INSTANTS)
        ask = f"() => {json.dumps(times.tolist())}.map((t) => Viewer.at(t))"
        with tempfile.TemporaryDirectory() as folder:
            told = opened(page, Path(folder), ask)
        with tempfile.TemporaryDirectory() as folder:
            spent = played(page, Path(folder), options.seconds)
        shown, expected = read_back(told["found"]), matrices(plan, times)
        off = max(np.abs(one - other).max() for one, other in zip(shown, expected, strict=True))
        print(
            f"{name:15}{len(page.encode()) / 1e6:10.2f}{len(spent):8d}{np.mean(spent):7.1f}"
            f"{np.quantile(spent, 0.95):8.1f}{max(spent):9.1f}{off:14.1e}"
            f"{len(told['wrong']) + len(told['console']):8d}"
        )


if __name__ == "__main__":
    main()

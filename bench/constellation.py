"""A constellation: 1,584 satellites that switch a cross-plane link, every one planned and certified.

The shell is 53:1584/72/39 at 550 km, the Sun that of the June solstice with a keep-out cone of 10 deg;
satellites pair with the plane on their one side before the switch, and on their other side after it. All is
compiled, by planning some of the satellites, before the clocks run; peak memory is that of all processes
together, from their start on.

    python bench/constellation.py [-n 1584] [--workers 1] [--minimum 48] [--planner mha]
"""

import argparse
import os
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from _processes import cpu_seconds, evenly, peak_memory

import jaxplan as jp
from jaxplan.constellation import LinkSwitch

_REHEARSAL = 64  # satellites a process, after which all that is used is compiled


def built() -> LinkSwitch:
    """Make the switch, twice, and print the time that each takes."""
    tilt = np.radians(23.44)
    for words in ("with compiling", "again"):
        began = time.process_time()
        shell = jp.walker("53:1584/72/39", 550.0)
        switch = jp.link_switch(shell, sun_direction=[0.0, np.cos(tilt), np.sin(tilt)])
        starts = time.process_time() - began
        scenarios = switch.scenarios()
        whole = time.process_time() - began
        parts = f"CPU {whole:.2f} s, of which links and starts {starts:.2f} s"
        print(f"{len(scenarios)} scenarios, {words}: {parts}")
    return switch


def run(switch: LinkSwitch, options: argparse.Namespace) -> None:
    """Plan the satellites of a switch, and print the summary, the time and the memory."""
    total, pool = switch.shell.total, None
    processes = [os.getpid()]
    if options.workers > 1:
        pool = ProcessPoolExecutor(options.workers, get_context("spawn"))
        rehearsal = evenly(total, _REHEARSAL * options.workers)
        jp.plan_constellation(
            switch,
            satellites=rehearsal,
            planner=options.planner,
            workers=pool,
            chunk=1,
        )
        processes += list(pool._processes)
    else:
        jp.plan_constellation(switch, satellites=evenly(total, _REHEARSAL), planner=options.planner)
    began, used = time.perf_counter(), cpu_seconds(processes)
    result = jp.plan_constellation(
        switch, satellites=evenly(total, options.satellites), planner=options.planner, workers=pool
    )
    seconds, used = time.perf_counter() - began, cpu_seconds(processes) - used
    memory = peak_memory(processes)
    if pool is not None:
        pool.shutdown()
    print(f"\n{result}\n")
    count = len(result.table)
    print(
        f"certified {np.sum(result.certified)} of {count}; processes: {options.workers}; "
        f"wall {seconds:.1f} s, CPU {used:.1f} s, {1000 * used / count:.1f} ms a satellite; "
        f"peak memory {memory:.0f} MiB"
    )


def minimum(switch: LinkSwitch, options: argparse.Namespace) -> None:
    """Plan a sample of the satellites in the shortest time, and print the summary."""
    result = jp.plan_constellation(
        switch,
        satellites=evenly(switch.shell.total, options.minimum),
        planner=options.planner,
        settings={"trajectory.duration_s": "minimum"},
    )
    print(f"\nin the shortest time: {result}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--satellites", type=positive, default=1584, help="planned (%(default)s)")
    parser.add_argument("--workers", type=positive, default=1, help="processes (%(default)s)")
    parser.add_argument("--minimum", type=not_negative, default=48, help="planned so, too (%(default)s)")
    parser.add_argument("--planner", default="mha")
    options = parser.parse_args()
    affinity = os.sched_getaffinity(0)
    print_machine()
    if options.workers > 1:
        os.sched_setaffinity(0, affinity)
    switch = built()
    run(switch, options)
    if options.minimum:
        minimum(switch, options)


if __name__ == "__main__":
    main()

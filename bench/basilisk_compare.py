"""Plans flown in Basilisk: by a rigid body, beside its own planner, and by its wheels with drawn errors.

`planners`: scenes have one instrument and one keep-out cone that blocks the straight slew. jaxplan plans each
in the shortest time within the torque and exports the waypoints, which Basilisk's ``waypointReference`` and
``mrpFeedback`` fly. Its ``constrainedAttitudeManeuver`` is given the same scenes, at the average rate of
jaxplan's plan, so that both take about as long, with its spline through the nodes or near them, and is flown
likewise.

*Success* counts scenes whose reference arrives within 0.1 deg without breaking the cone; *broken* those where
it breaks it, between its nodes, by 0.01 deg or more; *died* those where the flight gave no answer or its
process ended. Tracking error and torque are the largest of a flight; numbers are the median and the worst of
the scenes.

`wheels`: slews of a platform with four wheels among cones (`_wheel_scenes`), each planned with a tube and
without, and flown once each by Basilisk's own wheels under its controller, with errors that are drawn
(`_wheel_check`). A row says how many flights left the tube, with the exact binomial interval of 95 %, how
many broke a cone of those that stayed in it and of those that left, and in how many a wheel was saturated;
margins are beyond the cones as they are, torque and momentum the largest shares of the wheels' limits.

`orbit`: the first orbit of `case-day` as one file, slews and tracks, flown by the same wheels without errors
(`_wheel_orbit`); it needs the extra `orbit`, too.

    pip install -e '.[basilisk]'
    python bench/basilisk_compare.py [planners wheels orbit] [-n 20] [--workers 1] [--each]
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import positive, share
from _wheel_scenes import TUBE
from scipy.spatial.transform import Rotation
from tqdm import tqdm

import jaxplan as jp
from jaxplan.model.devices import Instrument
from jaxplan.model.goals import GivenState
from jaxplan.model.scenario import Scenario, TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepOut

try:
    import _basilisk
    import _wheel_orbit
    import _wheel_report
except ModuleNotFoundError as missing:
    if missing.name != "Basilisk":
        raise
    print("Basilisk is not installed, so nothing is flown: pip install -e '.[basilisk]'")
    sys.exit(0)

BROKEN, ARRIVED = np.deg2rad(0.01), np.deg2rad(0.1)  # rad
SETTLE = 5.0  # s, flown beyond the end of a reference
BORESIGHT = np.array([0.0, 0.0, 1.0])
CRAFT = Spacecraft(
    terminals=(),
    instruments=(Instrument(name="telescope", boresight=BORESIGHT),),
    rate_limit=np.deg2rad(3.0),
    acceleration_limit=np.deg2rad(1.0),
    inertia=np.array([[120.0, 4.0, -2.0], [4.0, 100.0, 3.0], [-2.0, 3.0, 60.0]]),
    torque_limit=np.full(3, 1.0),
)


def scene(seed: int) -> Scenario:
    """A slew of 60 to 170 deg whose straight way crosses a cone of 15 to 35 deg; its ends are 3 deg clear."""
    random = np.random.default_rng(seed)
    while True:
        start = Rotation.random(rng=random)
        axis = random.standard_normal(3)
        turn = axis / np.linalg.norm(axis) * np.deg2rad(random.uniform(60, 170))
        half_angle = np.deg2rad(random.uniform(15, 35))
        way = [(start * Rotation.from_rotvec(share * turn)).apply(BORESIGHT) for share in (0, 0.5, 1)]
        aside = random.standard_normal(3)
        direction = way[1] + 0.5 * np.sin(half_angle) * aside / np.linalg.norm(aside)
        direction /= np.linalg.norm(direction)
        off = np.arccos(np.clip(np.array(way) @ direction, -1, 1)) - half_angle
        if min(off[0], off[2]) > np.deg2rad(3) and off[1] < np.deg2rad(-2):
            break
    ends = [
        GivenState(
            rotation_vector=attitude.as_rotvec(),
            joints=np.zeros(0),
            angular_velocity=np.zeros(3),
            joint_rates=np.zeros(0),
        )
        for attitude in (start, start * Rotation.from_rotvec(turn))
    ]
    return Scenario(
        name=f"slew {seed}",
        spacecraft=CRAFT,
        start=ends[0],
        goal=ends[1],
        keep_out=(KeepOut(name="sun", direction=direction, half_angle=half_angle, devices=("telescope",)),),
        trajectory=TrajectorySettings(method="global", duration="minimum"),
    )


@dataclass(frozen=True, kw_only=True)
class Result:
    """Results of one flight.

    Attributes:
        time: s until the reference arrives.
        margin: deg, the reference's least angle beyond the cone.
        flown: deg, that of the attitude that is flown.
        arrived: whether the reference ends at the goal.
        error: deg, the largest angle between reference and flight.
        torque: N m, the largest about a body axis.
    """

    time: float
    margin: float
    flown: float
    arrived: bool
    error: float
    torque: float

    @property
    def broken(self) -> bool:
        return self.margin < -np.rad2deg(BROKEN)


def task_of(scenario: Scenario) -> "_basilisk.Task":
    """The slew in plain numbers, for another process."""
    (zone,) = scenario.keep_out
    return _basilisk.Task(
        inertia=np.asarray(CRAFT.inertia),
        start=scenario.start.rotation_vector,
        goal=scenario.goal.rotation_vector,
        boresight=BORESIGHT,
        direction=zone.direction,
        half_angle=float(zone.half_angle),
    )


class Flights:
    """Flights in a process of their own, for Basilisk's planner may take its process with it."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    def fly(
        self, flight: Callable[..., "_basilisk.Flown"], task: "_basilisk.Task", *how: object
    ) -> Result | None:
        """Fly in the other process, by a function of `_basilisk`; None where that process died.

        Args:
            flight: the function.
            task: its first argument.
            how: the others.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(1, get_context("spawn"))
        try:
            return inspect(task, self._pool.submit(flight, task, *how).result())
        except BrokenProcessPool:
            self._pool = None
            return None


def inspect(task: "_basilisk.Task", flown: "_basilisk.Flown") -> Result | None:
    """Results of a flight; None if it has values that are not finite."""
    if not (np.all(np.isfinite(flown.reference)) and np.all(np.isfinite(flown.attitude))):
        return None

    def margin(attitudes: np.ndarray) -> float:
        off = np.arccos(np.clip(attitudes @ task.boresight @ task.direction, -1, 1)) - task.half_angle
        return float(np.rad2deg(np.min(off)))

    goal = Rotation.from_rotvec(task.goal)
    miss = (goal.inv() * Rotation.from_matrix(flown.reference[-1])).magnitude()
    return Result(
        time=flown.slew_time,
        margin=margin(flown.reference),
        flown=margin(flown.attitude),
        arrived=bool(miss <= ARRIVED),
        error=float(np.rad2deg(np.max(flown.error()))),
        torque=float(np.max(np.abs(flown.torque))),
    )


def compare(scenario: Scenario, flights: Flights, folder: Path) -> list[Result | None]:
    """Fly one scene: jaxplan's plan, exported to a folder, and Basilisk's plans with both of its splines."""
    task, plan = task_of(scenario), jp.plan(scenario, progress=False)
    file = jp.export(plan, folder / f"{scenario.name}.csv", format="basilisk", step_s=_basilisk.STEP)
    duration = plan.trajectory.duration
    rates = plan.trajectory.sample(np.linspace(0, duration, 1001)).angular_velocity
    rate = float(np.mean(np.linalg.norm(rates, axis=1)))
    long = 4 * np.pi / rate  # no way of theirs is longer than two turns
    return [
        flights.fly(_basilisk.fly_waypoints, task, file, duration + SETTLE),
        *(flights.fly(_basilisk.fly_own_plan, task, rate, spline, long) for spline in (0, 1)),
    ]


def line(name: str, results: list[Result | None]) -> str:
    """A row of the table: successes, failures, and median and worst of each value."""
    alive = [result for result in results if result is not None]
    success = sum(result.arrived and not result.broken for result in alive)
    broken = sum(result.broken for result in alive)
    cells = [f"{name:<18}{success:>7} of {len(results):<3}{broken:>7}{len(results) - len(alive):>6}"]
    for field, worst, form in (
        ("time", max, "8.1f"),
        ("margin", min, "8.2f"),
        ("flown", min, "8.2f"),
        ("error", max, "8.3f"),
        ("torque", max, "8.2f"),
    ):
        values = [getattr(result, field) for result in alive] or [np.nan]
        cells.append(f"{np.median(values):{form}}{worst(values):{form}}")
    return " ".join(cells)


def planners(count: int, each: bool) -> None:
    """Print the rows of jaxplan's plans and of Basilisk's.

    Args:
        count: of scenes.
        each: whether with a line for each of them.
    """
    table: dict[str, list[Result | None]] = {"jaxplan": [], "Basilisk, through": [], "Basilisk, near": []}
    flights = Flights()
    with tempfile.TemporaryDirectory() as folder:
        for seed in tqdm(range(count), desc="flown", unit=" scenes"):
            found = compare(scene(seed), flights, Path(folder))
            for row, result in zip(table.values(), found, strict=True):
                row.append(result)
    heads = ("time, s", "margin, deg", "flown, deg", "error, deg", "torque, N m")
    print(f"{'':<37}" + "".join(f" {head:>16}" for head in heads))
    print(f"{'':<18}{'success':>14}{'broken':>7}{'died':>6}" + 5 * f" {'median':>8}{'worst':>8}")
    for name, results in table.items():
        print(line(name, results))
        if each:
            for seed, result in enumerate(results):
                print(f"  {seed:>3} {result}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parts = ("planners", "wheels", "orbit")
    parser.add_argument("parts", nargs="*", default=parts, choices=(*parts, []), metavar="PART")
    parser.add_argument("-n", "--scenes", type=positive, default=20, help="of each part")
    parser.add_argument("--workers", type=positive, default=1, help="processes that plan and fly, for wheels")
    parser.add_argument(
        "--momentum-reserve",
        type=share,
        default=10.0,
        metavar="PERCENT",
        help="that the tube keeps of wheels",
    )
    parser.add_argument("--each", action="store_true", help="a line a scene, too")
    options = parser.parse_args()
    print_machine("bsk", pinned=options.workers == 1)
    if "planners" in options.parts:
        planners(options.scenes, options.each)
    if "wheels" in options.parts:
        tube = replace(TUBE, momentum_reserve=options.momentum_reserve)
        _wheel_report.report(options.scenes, options.workers, tube, options.each)
    if "orbit" in options.parts:
        _wheel_orbit.report()

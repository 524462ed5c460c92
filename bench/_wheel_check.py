"""Plans of a platform with wheels, flown with errors that are drawn, and an independent check of each flight.

What is drawn for a flight, from its own seed: an inertia ``S (1 + E) S`` with ``S`` the root of the one that
is planned with, in which the diagonal of ``E`` is uniform within a level of 2 to 5 % and the rest within half
of it; an error of attitude, of rate and of what wheels store at the start; errors of the star tracker, which
walk at random within a bound of 5 to 20 arcsec about each axis, and of the rates, within 1 to 4 arcsec/s.
There are no other disturbances, and nothing bends.

The check is plain numpy and scipy, at the instants of the controller: boresights by the true attitude against
the cones as they are, without the tube; the angle between the true attitude and the plan's; torques that are
asked of the wheels and momenta that they hold against their limits. A wheel is saturated where more torque
is asked than it has, or where it holds all that it can.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from _wheel_flight import Craft, Flown, Start, fly
from _wheel_scenes import scene
from scipy.spatial.transform import Rotation

import jaxplan as jp

STEP = 0.1  # s, of the controller and of the integration
FREQUENCY, DAMPING = 0.1, 1.0  # of the closed loop, rad/s and as a share of critical
SETTLE = 10.0  # s, flown beyond the end of a plan
INERTIA_LEVELS = 0.02, 0.05
ATTITUDE, RATE = np.deg2rad(
    [0.05, 0.002]
)  # rad and rad/s, root of the mean square of the length at the start
STORED = 0.01  # of the limit, the most that a wheel stores beside what is planned with
NOISE_LEVELS = np.deg2rad([5 / 3600, 20 / 3600])  # rad
RATE_NOISE = 0.2  # 1/s, of the star tracker's noise


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A plan, and what the check of its flight found; the numbers are NaN where there is no plan.

    Attributes:
        seed: of scene and errors.
        status: of the plan, by name.
        duration: s, of the plan.
        margin: deg, the least angle of a boresight beyond a cone.
        error: deg, the largest angle between flight and plan.
        torque: the largest share of its limit that was asked of a wheel.
        momentum: the largest share of its limit that a wheel held.
        drift: N m s, by which the total momentum changed in inertial axes, which nothing should change.
    """

    seed: int
    status: str
    duration: float = np.nan
    margin: float = np.nan
    error: float = np.nan
    torque: float = np.nan
    momentum: float = np.nan
    drift: float = np.nan


def errors_drawn(scenario: jp.Scenario, seed: int) -> tuple[Craft, Start]:
    """The spacecraft as it is, and its start with errors."""
    random = np.random.default_rng([2906, seed])
    craft, start = without_errors(scenario)
    level = random.uniform(*INERTIA_LEVELS)
    spread = np.triu(random.uniform(-level, level, (3, 3)))
    spread = np.diag(np.diag(spread)) + (np.triu(spread, 1) + np.triu(spread, 1).T) / 2
    moments, along = np.linalg.eigh(craft.thought)
    root = along * np.sqrt(moments) @ along.T
    off = Rotation.from_rotvec(ATTITUDE / np.sqrt(3) * random.standard_normal(3))
    noise = float(random.uniform(*NOISE_LEVELS))
    return replace(craft, inertia=root @ (np.eye(3) + spread) @ root), replace(
        start,
        attitude=(Rotation.from_rotvec(start.attitude) * off).as_rotvec(),
        rate=RATE / np.sqrt(3) * random.standard_normal(3),
        stored=start.stored + STORED * craft.momentum * random.uniform(-1, 1, len(craft.axes)),
        attitude_noise=noise,
        rate_noise=RATE_NOISE * noise,
        seed=int(random.integers(1, 2**31)),
    )


def without_errors(scenario: jp.Scenario) -> tuple[Craft, Start]:
    """The spacecraft and its start as they are thought to be."""
    body, wheels = scenario.spacecraft, scenario.spacecraft.wheels
    inertia = np.asarray(body.inertia, float)
    craft = Craft(
        inertia=inertia,
        thought=inertia,
        axes=np.array([wheel.axis for wheel in wheels]),
        torque=np.array([wheel.torque for wheel in wheels]),
        momentum=np.array([wheel.momentum for wheel in wheels]),
        frequency=FREQUENCY,
        damping=DAMPING,
        step=STEP,
    )
    start = Start(
        attitude=scenario.start.rotation_vector,
        rate=np.zeros(3),
        stored=np.array([wheel.stored for wheel in wheels]),
        attitude_noise=0.0,
        rate_noise=0.0,
        seed=1,
    )
    return craft, start


def fly_all(seeds: Sequence[int], tube: jp.Robust | None) -> list[Outcome]:
    """Plan the scenes of some seeds, with a tube or without, and fly each plan with errors of its own."""
    scenes = [scene(seed) for seed in seeds]
    planned = [replace(one, robust=tube) for one in scenes]
    outcomes = []
    with tempfile.TemporaryDirectory() as folder:
        for seed, one, plan in zip(seeds, scenes, jp.plan_batch(planned, progress=False), strict=True):
            if not plan.ok:
                outcomes.append(Outcome(seed=seed, status=plan.status.name))
                continue
            craft, start = errors_drawn(one, seed)
            flown = _flown(plan, craft, start, Path(folder))
            outcomes.append(inspect(seed, one, plan, craft, flown))
    return outcomes


def inspect(seed: int, scenario: jp.Scenario, plan: jp.Plan, craft: Craft, flown: Flown) -> Outcome:
    """Check a flight.

    Args:
        seed: of scene and errors.
        scenario: whose cones are meant, without a tube.
        plan: that was flown.
        craft: as it was.
        flown: the flight.
    """
    least = np.inf
    for zone in scenario.keep_out:
        for device in scenario.spacecraft.instruments:
            seen = flown.attitude @ device.boresight
            away = np.arctan2(np.linalg.norm(np.cross(seen, zone.direction), axis=-1), seen @ zone.direction)
            least = np.minimum(least, np.min(away - zone.half_angle))  # keeps a NaN
    samples = plan.trajectory.sample(np.minimum(flown.times, plan.trajectory.duration))
    turned = Rotation.from_matrix(np.swapaxes(samples.attitude, 1, 2) @ flown.attitude).magnitude()
    held = flown.rate @ craft.inertia.T + flown.momentum @ craft.axes
    total = np.einsum("kij,kj->ki", flown.attitude, held)
    return Outcome(
        seed=seed,
        status=plan.status.name,
        duration=plan.trajectory.duration,
        margin=float(np.rad2deg(least)),
        error=float(np.rad2deg(np.max(turned))),
        torque=float(np.max(np.abs(flown.commanded) / craft.torque)),
        momentum=float(np.max(np.abs(flown.momentum) / craft.momentum)),
        drift=float(np.max(np.abs(total - total[0]))),
    )


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """The most by which a flight without errors is off its plan.

    Attributes:
        momentum: N m s, of a wheel.
        torque: N m, likewise.
        attitude: deg.
    """

    momentum: float
    torque: float
    attitude: float


def deviation(seed: int, step: float) -> Deviation:
    """Plan a scene without a tube and fly it without errors, in steps of some seconds.

    What the wheels hold and give along the plan is worked out here from its attitudes and rates, so that
    signs and frames are compared with Basilisk's.
    """
    scenario = scene(seed)
    plan = jp.plan(scenario, progress=False)
    craft, start = without_errors(scenario)
    # Limits are left out: what is beyond them by a hair for the steps would be cut off.
    free = replace(craft, step=step, torque=2 * craft.torque, momentum=2 * craft.momentum)
    with tempfile.TemporaryDirectory() as folder:
        flown = _flown(plan, free, start, Path(folder))
    within = flown.times <= plan.trajectory.duration
    samples = plan.trajectory.sample(flown.times[within])
    rate, share = samples.angular_velocity, np.linalg.pinv(craft.axes.T)
    total = Rotation.from_rotvec(start.attitude).apply(start.stored @ craft.axes)
    seen = np.einsum("kji,j->ki", samples.attitude, total)
    held = start.stored + (seen - rate @ craft.inertia.T - start.stored @ craft.axes) @ share.T
    torque = samples.angular_acceleration @ craft.inertia.T + np.cross(rate, seen)
    turned = Rotation.from_matrix(np.swapaxes(samples.attitude, 1, 2) @ flown.attitude[within]).magnitude()
    return Deviation(
        momentum=float(np.max(np.abs(flown.momentum[within] - held))),
        torque=float(np.max(np.abs(flown.commanded[within] + torque @ share.T))),
        attitude=float(np.rad2deg(np.max(turned))),
    )


def _flown(plan: jp.Plan, craft: Craft, start: Start, folder: Path) -> Flown:
    """Fly a plan by way of its file of waypoints in a folder."""
    file = jp.export(plan, folder / f"{plan.scenario.name}.csv", format="basilisk", step_s=craft.step)
    return fly(craft, start, file, plan.trajectory.duration + SETTLE)

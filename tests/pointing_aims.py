"""Problems of step 1 for devices of every kind that have targets, solvable by construction, and brute force.

Terminals are mounted in any way, drives and instruments have targets, too. What holds answers against them is
scipy's SLSQP from many starts; for the turn about an instrument's boresight that is left free, a fine grid.
All of it is written anew in numpy, from the axes by which devices are mounted.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from oblique import oblique_craft
from pointing import Problem
from reference import angle, direction, random_units, unit
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation

from jaxplan.model.devices import Drive, Instrument, Terminal
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

KINDS = {  # which devices there are and which of them have targets: terminals, drives, instruments
    "terminals": ((3, 0, 1), (3, 0, 0)),
    "one terminal": ((1, 1, 1), (1, 0, 0)),
    "an instrument": ((0, 0, 2), (0, 0, 1)),
    "an instrument and a terminal": ((1, 0, 2), (1, 0, 1)),
    "an instrument and two terminals": ((2, 1, 1), (2, 0, 1)),
    "a drive": ((0, 1, 1), (0, 1, 0)),
    "a drive and a terminal": ((1, 2, 2), (1, 1, 0)),
    "two drives": ((1, 2, 1), (0, 2, 0)),
    "an instrument and a drive": ((1, 1, 1), (0, 1, 1)),
    "two instruments": ((1, 0, 3), (0, 0, 2)),
}
TURN = 2 * np.pi
ROLLS = 4001  # of the grid over a turn


class Aim(NamedTuple):
    """A target in the axes of its device; a range is None where there is none."""

    frame: np.ndarray
    azimuth: np.ndarray | None
    elevation: np.ndarray | None
    tilt: float
    toward: np.ndarray


@lru_cache(maxsize=4)
def aims_of(problem: Problem) -> tuple[Aim, ...]:
    """Where each device with a target may point."""
    return tuple(_aims_of(problem))


def _aims_of(problem: Problem) -> Iterator[Aim]:
    craft, targets = problem.spacecraft, problem.targets
    for name, toward in zip(targets.names(craft), targets.directions, strict=True):
        device = next(
            one for one in (*craft.terminals, *craft.drives, *craft.instruments) if one.name == name
        )
        if isinstance(device, Terminal):
            up, ahead = np.array(device.mounting.yaw_axis), np.array(device.mounting.boresight)
            yield Aim(axes(up, ahead), np.array(device.yaw_range), np.array(device.pitch_range), 0.0, toward)
        elif isinstance(device, Drive):
            up, ahead = np.array(device.axis), np.array(device.boresight)
            tilt = np.pi / 2 - np.arccos(up @ ahead)
            yield Aim(axes(up, ahead), np.array(device.range), None, tilt, toward)
        else:
            ahead = np.array(device.boresight)
            yield Aim(axes(np.cross(ahead, np.roll(ahead, 1)), ahead), None, None, 0.0, toward)


def axes(up: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """(3, 3) columns: the part of a vector across an axis, what is to the left of it, and the axis."""
    left = unit(np.cross(up, ahead))
    return np.stack([np.cross(left, unit(up)), left, unit(up)], axis=-1)


def conditions(problem: Problem, attitude: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What must be at least zero, and what must be zero, at attitudes (..., 3, 3): (..., c) rad each."""
    least: list[np.ndarray] = [np.ones(attitude.shape[:-2])]
    zero: list[np.ndarray] = []
    for aim in aims_of(problem):
        own = (aim.toward @ attitude) @ aim.frame
        azimuth, elevation = np.arctan2(own[..., 1], own[..., 0]), np.arcsin(np.clip(own[..., 2], -1, 1))
        if aim.azimuth is None:
            zero += [azimuth, elevation]
            continue
        low, high = aim.azimuth
        if high - low < TURN:
            middle = (low + high) / 2
            off = np.mod(azimuth - middle + np.pi, TURN) - np.pi
            least += [middle - low - off, middle - low + off]
        if aim.elevation is None:
            zero.append(elevation - aim.tilt)
        else:
            least += [elevation - aim.elevation[0], aim.elevation[1] - elevation]
    craft, cones = problem.spacecraft, problem.cones
    for row, number in np.argwhere(cones.bound):
        boresight = craft.fixed_boresights[number - len(craft.terminals) - len(craft.drives)]
        apart = angle(attitude @ boresight, cones.axis[row])
        least.append(cones.side[row] * (apart - cones.half_angle[row]))
    nothing = np.zeros((*attitude.shape[:-2], 0))
    return np.stack(least, axis=-1), np.stack(zero, axis=-1) if zero else nothing


def slew_of(problem: Problem, attitude: np.ndarray) -> float:
    return float(Rotation.from_matrix(problem.start.T @ attitude).magnitude())


def slsqp(problem: Problem, starts: int, rng: np.random.Generator) -> float:
    """Least slew that SLSQP finds from starts uniform in the ball of radius pi; inf if it finds none."""

    steps = 1e-6 * np.eye(3)

    @lru_cache(maxsize=1)
    def around(place: tuple[float, ...]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """What must be at least zero and what must be zero at a rotation vector, and their slopes."""
        etas = np.concatenate([[place], place + steps, place - steps])
        parts = conditions(problem, problem.start @ Rotation.from_rotvec(etas).as_matrix())
        parts = np.column_stack([parts[0], np.pi**2 - np.sum(etas**2, axis=1)]), parts[1]
        return [part[0] for part in parts], [(part[1:4] - part[4:]).T / 2e-6 for part in parts]

    def at(eta: np.ndarray) -> list[np.ndarray]:
        return around(tuple(eta))[0]

    constraints = [
        {
            "type": kind,
            "fun": lambda eta, which=which: at(eta)[which],
            "jac": lambda eta, which=which: around(tuple(eta))[1][which],
        }
        for which, kind in enumerate(("ineq", "eq"))
        if len(at(np.zeros(3))[which])
    ]
    best = np.inf
    for start in random_units(rng, starts) * np.pi * rng.random((starts, 1)) ** (1 / 3):
        end = minimize(
            lambda eta: eta @ eta,
            start,
            jac=lambda eta: 2 * eta,
            method="SLSQP",
            constraints=constraints,
            options={"ftol": 1e-13, "maxiter": 100},
        ).x
        least, zero = at(end)
        if np.all(np.isfinite(end)) and np.all(least >= -1e-9) and np.all(np.abs(zero) <= 1e-9):
            best = min(best, slew_of(problem, problem.start @ Rotation.from_rotvec(end).as_matrix()))
    return best


def over_roll(problem: Problem, cost: Callable[[np.ndarray], np.ndarray] | None = None) -> float:
    """Least slew over the turns about the only instrument with a target; inf where none will do.

    Another cost of attitudes (..., 3, 3) may take the slew's place, that changes by no more than they turn.
    """
    (place,) = [number for number, aim in enumerate(aims_of(problem)) if aim.azimuth is None]
    name = problem.targets.names(problem.spacecraft)[place]
    instrument = next(one for one in problem.spacecraft.instruments if one.name == name)
    ahead, toward = np.array(instrument.boresight), problem.targets.directions[place]
    seen = problem.start @ ahead
    first, _ = Rotation.align_vectors(toward[None], seen[None])
    base = first.as_matrix() @ problem.start  # any attitude that points it there
    of_attitude = cost or (lambda turned: Rotation.from_matrix(problem.start.T @ turned).magnitude())

    def rolled(roll: float | np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(np.multiply.outer(roll, toward)).as_matrix() @ base

    def short(roll: float) -> float:
        return -float(np.min(conditions(problem, rolled(roll))[0]))

    rolls = np.linspace(-np.pi, np.pi, ROLLS)
    every = rolled(rolls)
    costs = of_attitude(every)
    broken = -np.min(conditions(problem, every)[0], axis=1)
    found = [np.inf]
    for number in np.argsort(costs):
        if costs[number] > min(found) + 2 * TURN / ROLLS:
            break
        if broken[number] > 0:
            continue
        # the least where all is kept lies at a minimum of the cost or where something begins to break
        ends = rolls[max(number - 1, 0)], rolls[min(number + 1, ROLLS - 1)]
        low, high = sorted(_edge(short, rolls[number], end) for end in ends)
        near = minimize_scalar(
            lambda roll: of_attitude(rolled(roll)),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-9},
        )
        found += [float(of_attitude(rolled(roll))) for roll in (low, high, near.x) if short(roll) <= 1e-9]
    return min(found)


def _edge(short, kept: float, other: float) -> float:
    """The last roll from one where all is kept toward another at which it still is."""
    if short(other) <= 0:
        return other
    for _ in range(50):
        middle = (kept + other) / 2
        kept, other = (middle, other) if short(middle) <= 0 else (kept, middle)
    return kept


def random_aims(seed: int) -> tuple[str, Problem]:
    """Problem number `seed`, of one kind after the other; an attitude that solves it is drawn first."""
    names = list(KINDS)
    kind = names[seed % len(names)]
    (terminals, drives, instruments), aimed = KINDS[kind]
    craft = oblique_craft(terminals, drives, instruments, seed=seed)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(34,)))
    start, solution = Rotation.random(2, rng=rng).as_matrix()
    joints = rng.uniform(*craft.joint_ranges.T)
    seen = np.asarray(craft.boresights(solution, joints))
    groups = (craft.terminals, craft.drives, craft.instruments)
    with_targets = [one.name for group, count in zip(groups, aimed, strict=True) for one in group[:count]]
    targets = Targets(
        directions=np.stack([seen[craft.device_names.index(name)] for name in with_targets]),
        devices=tuple(with_targets),
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(craft.joint_count),
    )
    zones = [zone for one in craft.instruments[aimed[2] :] for zone in _zones(rng, one, solution)]
    keep_out = [zone for zone in zones if isinstance(zone, KeepOut)]
    keep_in = [zone for zone in zones if isinstance(zone, KeepIn)]
    cones = tabulate(keep_out, keep_in, craft)
    return kind, Problem(spacecraft=craft, start=start, targets=targets, cones=cones)


def _zones(rng: np.random.Generator, one: Instrument, solution: np.ndarray) -> Iterator[KeepOut | KeepIn]:
    """Zones of an instrument that it keeps at the solution."""
    seen = solution @ one.boresight
    for number in range(rng.integers(0, 3)):
        axis = random_units(rng)
        apart, name = float(angle(seen, axis)), f"{one.name} {number}"
        if rng.random() < 0.7:
            half_angle = 0.95 * min(apart, 1.2)
            yield KeepOut(name=name, direction=axis, half_angle=half_angle, devices=(one.name,))
        else:
            half_angle = min(apart + rng.uniform(0.02, 0.5), 3.1)
            yield KeepIn(name=name, direction=axis, half_angle=half_angle, devices=(one.name,))


def contradicting(seed: int) -> Problem:
    """A problem of two instruments whose targets are farther apart than they are, by a tenth of a radian."""
    craft: Spacecraft = oblique_craft(0, 0, 2, seed=seed)
    rng = np.random.default_rng(seed)
    start = Rotation.random(rng=rng).as_matrix()
    first, second = craft.fixed_boresights
    across = unit(np.cross(first, np.cross(second, first)))
    apart = float(angle(first, second)) + 0.1
    toward = np.stack([first, np.cos(apart) * first + np.sin(apart) * across])
    names = tuple(one.name for one in craft.instruments)
    targets = Targets(directions=toward @ Rotation.random(rng=rng).as_matrix().T, devices=names)
    return Problem(spacecraft=craft, start=start, targets=targets, cones=tabulate((), (), craft))


def pointing_errors(problem: Problem, attitude: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """(k,) rad, how far the devices with targets are off them."""
    craft = problem.spacecraft
    seen = []
    for name in problem.targets.names(craft):
        number = craft.device_names.index(name)
        count, drives = len(craft.terminals), len(craft.drives)
        if number < count:
            terminal = craft.terminals[number]
            own = direction(joints[number], joints[count + number])
            seen.append(
                axes(np.array(terminal.mounting.yaw_axis), np.array(terminal.mounting.boresight)) @ own
            )
        elif number < count + drives:
            drive = craft.drives[number - count]
            turn = Rotation.from_rotvec(joints[count + number] * np.array(drive.axis))
            seen.append(turn.apply(drive.boresight))
        else:
            seen.append(np.array(craft.instruments[number - count - drives].boresight))
    return angle(np.stack(seen) @ attitude.T, problem.targets.directions)


def with_tolerance(problem: Problem, tolerance: float) -> Problem:
    return replace(problem, targets=replace(problem.targets, tolerance=tolerance))

"""Problems of step 1 that are solvable by construction, and plain numpy and scipy to hold answers against.

A problem is written in azimuths, elevations and separations with their derivatives in the rotation vector
``eta``, ``R = R0 exp(eta^)``, as section 3.1 prints it, and solved by scipy's SLSQP from random starts.
"""

from dataclasses import dataclass

import numpy as np
from reference import direction, random_units
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from jaxplan.goal import Decomposition, decompose
from jaxplan.model.constraints import Constraints
from jaxplan.model.devices import Instrument, Terminal
from jaxplan.model.goals import Targets
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

PAPER_DIRECTIONS = np.array(
    [[-0.5349, 0.8296, 0.1604], [0.4212, -0.9032, -0.0832], [0.4601, -0.7960, -0.3933]]
)
PAPER_DIRECTIONS /= np.linalg.norm(PAPER_DIRECTIONS, axis=1, keepdims=True)
PAPER_MOUNTS = np.deg2rad([0.0, 120.0, -120.0])
KINDS = (
    "paper",
    "three",
    "wide",
    "one",
    "two",
    "four",
    "twelve",
    "star trackers",
    "telescopes",
    "no terminal",
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    spacecraft: Spacecraft
    start: np.ndarray
    targets: Targets
    cones: Constraints

    def decompose(self, **settings: float) -> Decomposition:
        return decompose(self.spacecraft, self.start, self.targets, self.cones, **settings)

    @property
    def limits(self) -> np.ndarray:
        """(2n,) rad, of ranges to either side."""
        tighter = [
            np.inf if limit is None else limit for limit in (self.targets.yaw_limit, self.targets.pitch_limit)
        ]
        ranges = self.spacecraft.joint_ranges
        np.testing.assert_array_equal(ranges[:, 0], -ranges[:, 1])
        return np.minimum(ranges[:, 1], np.repeat(tighter, len(self.spacecraft.terminals)))

    @property
    def mounts(self) -> np.ndarray:
        """(n,) rad, of terminals that yaw about z."""
        return np.array([terminal.mount for terminal in self.spacecraft.terminals])


def make_problem(
    start: np.ndarray,
    directions: np.ndarray,
    mounts: np.ndarray = PAPER_MOUNTS,
    yaw_limits: np.ndarray | float = np.pi / 2,
    pitch_limits: np.ndarray | float = np.pi / 12,
    goal_limits: tuple[float | None, float | None] = (None, None),
    boresights: np.ndarray | tuple = (),
    keep_out: tuple[KeepOut, ...] = (),
    keep_in: tuple[KeepIn, ...] = (),
) -> Problem:
    """Terminals are named t0, t1, ..., instruments i0, i1, ...; all angles in rad."""
    count = len(directions)
    limits = zip(
        mounts, np.broadcast_to(yaw_limits, count), np.broadcast_to(pitch_limits, count), strict=False
    )
    spacecraft = Spacecraft(
        terminals=tuple(
            Terminal(
                name=f"t{i}",
                mount=float(mount),
                yaw_limit=float(yaw),
                pitch_limit=float(pitch),
                rate_limit=0.07,
                acceleration_limit=0.05,
            )
            for i, (mount, yaw, pitch) in enumerate(limits)
        ),
        instruments=tuple(
            Instrument(name=f"i{k}", boresight=np.asarray(b)) for k, b in enumerate(boresights)
        ),
        rate_limit=0.05,
        acceleration_limit=0.03,
    )
    targets = Targets(
        directions=np.asarray(directions, float).reshape(-1, 3),
        yaw_limit=goal_limits[0],
        pitch_limit=goal_limits[1],
        angular_velocity=np.zeros(3),
        joint_rates=np.zeros(2 * count),
    )
    cones = tabulate(keep_out, keep_in, spacecraft)
    return Problem(spacecraft=spacecraft, start=np.asarray(start), targets=targets, cones=cones)


def random_problem(seed: int) -> Problem:
    """Problem number `seed`, of one kind after the other; an attitude that solves it is drawn first."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(31,)))
    kind = KINDS[seed % len(KINDS)]
    start = Rotation.random(rng=rng).as_matrix()
    if kind == "paper":
        yaw, pitch = np.deg2rad(((90, 15), (88, 8), (88, 13))[rng.integers(3)])
        return make_problem(start, PAPER_DIRECTIONS, goal_limits=(yaw, pitch))
    count = {"one": 1, "two": 2, "four": 4, "twelve": 12, "telescopes": 2, "no terminal": 0}.get(kind, 3)
    mounts = PAPER_MOUNTS if count == 3 else rng.uniform(-np.pi, np.pi, count)
    widest = np.deg2rad((90, 120, 180)[rng.integers(3)] if kind != "wide" else 180)
    yaw = rng.uniform(0.1, widest, count)
    pitch = rng.uniform(0.03, np.deg2rad((20, 60, 88)[rng.integers(3)]), count)
    if rng.random() < 0.3:
        yaw, pitch = np.full(count, np.pi / 2), np.full(count, np.pi / 12)
    solution = Rotation.random(rng=rng).as_matrix()
    azimuth, elevation = mounts + rng.uniform(-yaw, yaw), rng.uniform(-pitch, pitch)
    directions = direction(azimuth, elevation) @ solution.T
    if kind not in ("star trackers", "telescopes", "no terminal"):
        return make_problem(start, directions, mounts, yaw, pitch)
    boresights = random_units(rng, rng.integers(1, 4))
    keep_out, keep_in = _random_zones(rng, boresights @ solution.T)
    return make_problem(
        start, directions, mounts, yaw, pitch, boresights=boresights, keep_out=keep_out, keep_in=keep_in
    )


def _random_zones(
    rng: np.random.Generator, boresights: np.ndarray
) -> tuple[tuple[KeepOut, ...], tuple[KeepIn, ...]]:
    """Zones that instruments with these inertial boresights clear; sometimes a group of which one holds."""
    keep_out, keep_in = [], []
    for number in range(rng.integers(1, 7)):
        bound = np.flatnonzero(rng.random(len(boresights)) < 0.6)
        names = tuple(f"i{k}" for k in bound)
        axis = random_units(rng, 1)[0]
        angles = np.arccos(np.clip(boresights[bound] @ axis, -1, 1))
        if len(bound) == 0:
            continue
        if rng.random() < 0.7:
            half_angle = min(np.deg2rad(rng.uniform(10, 70)), 0.98 * angles.min())
            keep_out.append(
                KeepOut(name=f"out-{number}", direction=axis, half_angle=half_angle, devices=names)
            )
            continue
        half_angle = min(angles.max() + np.deg2rad(rng.uniform(0.5, 30)), 3.1)
        group = f"group-{number}" if rng.random() < 0.5 else None
        keep_in.append(
            KeepIn(name=f"in-{number}", direction=axis, half_angle=half_angle, devices=names, any_of=group)
        )
        if group is not None:  # other ways out of it, which the solution drawn does not need
            keep_in += [
                KeepIn(name=f"in-{number}-{k}", direction=other, half_angle=0.4, devices=names, any_of=group)
                for k, other in enumerate(random_units(rng, rng.integers(1, 3)))
            ]
    return tuple(keep_out), tuple(keep_in)


class Printed:
    """Problem (7) as a nonlinear program in ``eta``; every constraint is a margin in radians, >= 0."""

    def __init__(self, problem: Problem) -> None:
        craft = problem.spacecraft
        self.mounts, self.count, self.limits = problem.mounts, len(craft.terminals), problem.limits
        self.directions = problem.targets.directions @ problem.start
        self.boresights, self.cones = craft.fixed_boresights, problem.cones
        self.cone_axes = problem.cones.axis @ problem.start
        self.zones = [
            np.flatnonzero((self.cones.group == group) & np.any(self.cones.bound[:, self.count :], axis=1))
            for group in np.unique(self.cones.group)
        ]
        self.zones = [rows for rows in self.zones if len(rows)]
        self.most_bound = np.sum(self.cones.bound[:, self.count :], axis=1).max(initial=0)

    def margins(self, eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Margins (c,) and their derivatives (c, 3): joints, zones, half a turn."""
        rotation, tangent = _exp_and_tangent(eta)
        body = self.directions @ rotation
        horizontal = np.maximum(np.hypot(body[:, 0], body[:, 1]), 1e-12)
        azimuth = np.arctan2(body[:, 1], body[:, 0]) - self.mounts
        azimuth -= 2 * np.pi * np.ceil((azimuth - np.pi) / (2 * np.pi))
        elevation = np.arctan2(body[:, 2], horizontal)
        joints = np.concatenate([azimuth, elevation])
        in_yaw = np.stack([-body[:, 1], body[:, 0], 0 * horizontal], axis=1) / horizontal[:, None] ** 2
        ahead = np.stack([body[:, 0], body[:, 1], 0 * horizontal], axis=1)
        in_pitch = -ahead * (body[:, 2] / horizontal)[:, None]
        in_pitch[:, 2] = horizontal
        slopes = np.cross(np.concatenate([in_yaw, in_pitch]), np.concatenate([body, body])) @ tangent
        values = [self.limits - joints, self.limits + joints, [np.pi**2 - eta @ eta]]
        derivatives = [-slopes, slopes, -2 * eta[None]]
        for rows in self.zones:
            found = max((self._zone(row, rotation) for row in rows), key=lambda zone: zone[0][0])
            found = found + found[-1:] * (self.most_bound - len(found))  # as many margins for any zone
            values.append([margin for margin, _ in found])
            derivatives.append(np.array([slope for _, slope in found]) @ tangent)
        return np.concatenate(values), np.concatenate(derivatives)

    def _zone(self, row: int, rotation: np.ndarray) -> list[tuple[float, np.ndarray]]:
        """Margin of each instrument that a zone binds, and its slope along a turn in body axes, by margin."""
        axis, side = self.cone_axes[row] @ rotation, self.cones.side[row]
        found = []
        for instrument in np.flatnonzero(self.cones.bound[row, self.count :]):
            normal = np.cross(self.boresights[instrument], axis)
            sine = np.linalg.norm(normal)
            angle = np.arctan2(sine, self.boresights[instrument] @ axis)
            found.append((side * (angle - self.cones.half_angle[row]), -side * normal / max(sine, 1e-12)))
        return sorted(found, key=lambda margin: margin[0])

    def slsqp(self, starts: int, rng: np.random.Generator) -> float:
        """Least slew that SLSQP finds from starts uniform in the ball of radius pi; inf if it finds none."""
        best = np.inf
        constraint = {
            "type": "ineq",
            "fun": lambda eta: self.margins(eta)[0],
            "jac": lambda eta: self.margins(eta)[1],
        }
        for _ in range(starts):
            start = random_units(rng, 1)[0] * np.pi * rng.random() ** (1 / 3)
            end = minimize(
                lambda eta: eta @ eta,
                start,
                jac=lambda eta: 2 * eta,
                method="SLSQP",
                constraints=constraint,
                options={"ftol": 1e-15, "maxiter": 200},
            ).x
            if np.all(np.isfinite(end)) and np.all(self.margins(end)[0] >= -1e-10):
                best = min(best, float(np.linalg.norm(end)))
        return best


def _exp_and_tangent(eta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``exp(eta^)`` and ``D(eta)`` of equation (2) by their closed forms."""
    angle = max(float(np.linalg.norm(eta)), 1e-7)
    x, y, z = eta
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    square = cross @ cross
    sine, cosine = np.sin(angle) / angle, (1 - np.cos(angle)) / angle**2
    return (
        np.eye(3) + sine * cross + cosine * square,
        np.eye(3) - cosine * cross + (1 - sine) / angle**2 * square,
    )

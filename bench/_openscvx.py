"""OpenSCvx on minimum-time slews: successive convexification with time as a variable.

States are the attitude since the start as a quaternion, the angular velocity, the joints and their rates;
controls are the accelerations, either held from node to node (they jump, which is what the shortest slew asks
for) or linear between nodes and zero at both ends. What a user can do to make it fast and sure is done: one
compiled problem serves all scenes with as many zones; 64-bit numbers; constant weights, which need as few
iterations as its default tuner and less time for each; nodes evenly spread in time, which make a slew longer
by a few thousandths and save most of the iterations; cones and joint ranges padded, since both are kept at
the nodes only, and where accelerations are linear the limits of rates, too.

Two traps of its version 0.5.2 lie here. Constraints at nodes are linearised in unscaled states but multiplied
with scaled steps (its issue 516), so states that they depend on must have the scale 1. And `Stack` of three
scalars is no vector, but a column, which broadcasts against vectors.
"""

import contextlib
import io
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from _flight import Flight, craft_range
from _openscvx_data import first_duration, first_guess, flight_of, zones_by_terminal
from _options import MISSING
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario
from jaxplan.model.spacecraft import Spacecraft

try:
    import openscvx as ox
    from cvxpy.error import SolverError
except ModuleNotFoundError as missing:
    raise SystemExit(MISSING.format(missing.name, "openscvx")) from None

PADDING = np.deg2rad(0.3)  # rad by which cones are wider and joint ranges narrower, as nodes alone keep them
RATE_PADDING = 0.012  # share of the rate limits that is left, where accelerations are linear between nodes
SLOWER = 1.05  # a repeated solve begins from so many times the duration of the one before
SHARPNESS = 10.0  # factor of the zones' rows beside the others
LONGEST = 100.0  # s, greatest duration
WEIGHTS = {"lam_cost": 1.0, "lam_prox": 0.1, "lam_vc": 10.0, "lam_vb": 10.0}
TOLERANCES = {"ep_tr": 1e-4, "ep_vb": 1e-4, "ep_vc": 1e-6}
ITERATIONS = 60


@dataclass(frozen=True, kw_only=True)
class Way:
    """A way to run OpenSCvx: its name, whether accelerations may jump, and the number of nodes."""

    name: str
    jumps: bool
    nodes: int


@dataclass(frozen=True, kw_only=True)
class Answer:
    """OpenSCvx's answer: whether it says converged, the manoeuvre, the seconds and iterations it took."""

    converged: bool
    flight: Flight | None
    seconds: float
    iterations: int


class Rival:
    """A compiled problem of OpenSCvx for all scenes of a spacecraft with as many zones.

    Args:
        craft: the spacecraft, without instruments.
        zones: (n,) number of zones that bind each terminal.
        way: how to run it.

    Attributes:
        compile_seconds: time that it took to make.
    """

    def __init__(self, craft: Spacecraft, zones: Sequence[int], way: Way) -> None:
        begin = time.perf_counter()
        self.craft, self.way = craft, way
        self._make_variables()
        self.problem = ox.Problem(
            dynamics={
                "attitude": 0.5 * ox.spatial.SSMP(self.rate) @ self.attitude,
                "rate": self.acceleration,
                "joints": self.joint_rates,
                "joint_rates": self.joint_accelerations,
            },
            states=[self.attitude, self.rate, self.joints, self.joint_rates],
            controls=[self.acceleration, self.joint_accelerations],
            time=self.time,
            constraints=self._zone_rows(zones)
            + ([] if way.jumps else self._ends_at_rest() + self._rates_between()),
            N=way.nodes,
            float_dtype="float64",
            algorithm={"k_max": ITERATIONS, "autotuner": "ConstantProximalWeight", **WEIGHTS, **TOLERANCES},
        )
        self.problem.settings.dev.printing = False
        with contextlib.redirect_stdout(io.StringIO()):
            self.problem.initialize()
        self.compile_seconds = time.perf_counter() - begin

    def solve(self, scenario: Scenario, goal: Goal, path: Path | None) -> Answer:
        """Solve a scene, from the straight motion as the first guess or from a path.

        Args:
            scenario: with as many zones at each terminal as the problem has.
            goal: where to end.
            path: the first guess, None for the straight motion.
        """
        begin = time.perf_counter()
        duration = first_duration(scenario, goal)
        result, iterations = self._attempt(scenario, goal, path, duration)
        found = np.nan if result is None or not result.converged else float(result.nodes["time"][-1, 0])
        if not self.way.jumps and found > duration:  # nodes are farther apart than `_rates_between` assumed
            result, more = self._attempt(scenario, goal, path, SLOWER * found)
            iterations += more
        seconds = time.perf_counter() - begin
        if result is None:
            return Answer(converged=False, flight=None, seconds=seconds, iterations=iterations)
        flight = flight_of(scenario, result.nodes, jumps=self.way.jumps)
        return Answer(converged=bool(result.converged), flight=flight, seconds=seconds, iterations=iterations)

    def _attempt(
        self, scenario: Scenario, goal: Goal, path: Path | None, duration: float
    ) -> tuple[ox.OptimizationResults | None, int]:
        """Solve once from a first guess of a duration, s; returns result and iterations.

        The result is None where it broke down.
        """
        self._set_zones(scenario)
        self._set_ends_and_guess(scenario, goal, path, duration)
        self.problem.reset()
        with contextlib.redirect_stdout(io.StringIO()):
            try:
                result = self.problem.solve()
            except (SolverError, ValueError):  # where a subproblem has no solution
                result = None
        if result is not None and not (np.all(np.isfinite(result.x)) and np.all(np.isfinite(result.u))):
            result = None
        return result, self.problem.state.k - 1

    def _make_variables(self) -> None:
        """Make states, controls and time, with their limits and scales."""
        craft, count, hold = self.craft, self.way.nodes, "ZOH" if self.way.jumps else "FOH"
        joints = 2 * len(craft.terminals)
        speed = np.array([t.rate_limit for t in craft.terminals] * 2)
        speed_up = np.array([t.acceleration_limit for t in craft.terminals] * 2)
        self.attitude = ox.State("attitude", shape=(4,))
        self.rate = ox.State("rate", shape=(3,))
        share = 1.0 if self.way.jumps else 1 - RATE_PADDING
        self.rate.max = np.full(3, share * craft.rate_limit)
        self.joints = ox.State("joints", shape=(joints,))
        self.joints.max = craft_range(craft) - PADDING
        self.joint_rates = ox.State("joint_rates", shape=(joints,))
        self.joint_rates.max = share * speed
        self.acceleration = ox.Control("acceleration", shape=(3,), parameterization=hold)
        self.acceleration.max = np.full(3, craft.acceleration_limit)
        self.joint_accelerations = ox.Control("joint_accelerations", shape=(joints,), parameterization=hold)
        self.joint_accelerations.max = speed_up
        self.attitude.max, self.attitude.min = np.full(4, 1.1), np.full(4, -1.1)
        for state in (self.rate, self.joints, self.joint_rates):
            state.min = -state.max
        for state in (self.attitude, self.joints):
            state.scaling_min, state.scaling_max = -np.ones(state.shape), np.ones(state.shape)
        for control in (self.acceleration, self.joint_accelerations):
            control.min, control.guess = -control.max, np.zeros((count, *control.shape))
        for state in (self.attitude, self.rate, self.joints, self.joint_rates):
            state.initial, state.final = np.zeros(state.shape), np.zeros(state.shape)
            state.guess = np.zeros((count, *state.shape))
        self.attitude.guess = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
        self.attitude.initial = self.attitude.final = self.attitude.guess[0]
        self.time = ox.Time(
            initial=0.0,
            final=ox.Minimize(25.0),
            min=0.0,
            max=LONGEST,
            time_dilation_min=1.0,
            time_dilation_max=LONGEST,
            uniform_time_grid=True,
        )

    def _zone_rows(self, zones: Sequence[int]) -> list[ox.Constraint]:
        """Constraints of zones: cosines of angles to their axes below thresholds, both times their sides."""
        turn, rows = ox.spatial.QDCM(self.attitude), []
        for place, (terminal, count) in enumerate(zip(self.craft.terminals, zones, strict=True)):
            if not count:
                continue
            axes = ox.Parameter(f"axes_{place}", shape=(count, 3), value=np.zeros((count, 3)))
            thresholds = ox.Parameter(f"thresholds_{place}", shape=(count,), value=np.ones(count))
            yaw = self.joints[place] + float(terminal.mount)
            pitch = self.joints[len(self.craft.terminals) + place]
            boresight = turn @ ox.Concat(
                ox.Cos(pitch) * ox.Cos(yaw), ox.Cos(pitch) * ox.Sin(yaw), ox.Sin(pitch)
            )
            rows.append(SHARPNESS * (axes @ boresight - thresholds) <= np.zeros(count))
        return rows

    def _ends_at_rest(self) -> list[ox.Constraint]:
        """Constraints: no acceleration at the first and at the last node."""
        return [
            (control.at(node) == np.zeros(control.shape)).convex()
            for control in (self.acceleration, self.joint_accelerations)
            for node in (0, self.way.nodes - 1)
        ]

    def _rates_between(self) -> list[ox.Constraint]:
        """Constraints: rate limits half-way between nodes, where a rate may be a sixth higher than at them.

        It may still be higher by a hundredth elsewhere; the padding of the limits is for that. The rows take
        the spacing of the first guess, since a product with the real one is not convex; a longer spacing than
        the real one asks for a little too much.
        """
        rows, eighth = [], ox.Parameter("eighth", shape=(), value=0.1)
        pairs = (self.rate, self.acceleration), (self.joint_rates, self.joint_accelerations)
        for rate, control in pairs:
            for node in range(self.way.nodes - 1):
                middle = 0.5 * (rate.at(node) + rate.at(node + 1))
                bulge = eighth * (control.at(node) - control.at(node + 1))
                rows += [(middle + bulge <= rate.max).convex(), (rate.min <= middle + bulge).convex()]
        return rows

    def _set_zones(self, scenario: Scenario) -> None:
        """Set the problem's parameters: axes of zones, relative to the start attitude, and thresholds."""
        start = Rotation.from_rotvec(scenario.start.rotation_vector)
        for place, zones in enumerate(zones_by_terminal(scenario)):
            if zones:
                sides, directions, half_angles = (np.array(column) for column in zip(*zones, strict=True))
                thresholds = sides * np.cos(half_angles + sides * PADDING)
                axes = sides[:, None] * start.inv().apply(directions)
                self.problem.parameters.update({f"axes_{place}": axes, f"thresholds_{place}": thresholds})

    def _set_ends_and_guess(self, scenario: Scenario, goal: Goal, path: Path | None, duration: float) -> None:
        """Set both ends and the first guess, along a path or the straight motion in a duration, s."""
        guess = first_guess(scenario, goal, path, duration, self.way.nodes)
        quaternions, rates, joints, joint_rates = guess
        if not self.way.jumps:
            self.problem.parameters["eighth"] = duration / (self.way.nodes - 1) / 8
        begin, end = scenario.start, scenario.goal
        for state, values, first, last in (
            (self.attitude, quaternions, quaternions[0], quaternions[-1]),
            (self.rate, rates, begin.angular_velocity, end.angular_velocity),
            (self.joints, joints, begin.joints, goal.joints),
            (self.joint_rates, joint_rates, begin.joint_rates, end.joint_rates),
        ):
            state.initial, state.final = first, last
            state.guess = np.clip(values, state.min, state.max)
        self.time.guess = np.linspace(0, duration, self.way.nodes)
        self.time.final = ox.Minimize(duration)
        self.time.time_dilation_guess = np.full(self.way.nodes, duration)

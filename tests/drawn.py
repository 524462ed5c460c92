"""Plans made up of one smooth law, which figures and pages are drawn of."""

import numpy as np
from matplotlib.contour import ContourSet
from matplotlib.path import Path as Shape
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import poly2leg
from scenes import make_scenario
from scipy.spatial.transform import Rotation

from jaxplan.certificate import Certificate
from jaxplan.model.path import Goal, Path
from jaxplan.model.status import Status
from jaxplan.model.zones import KeepOut
from jaxplan.planner import Plan
from jaxplan.trajectory.curve import Trajectory


def make_plan(
    terminals: int = 3, instruments: int = 1, *, zones: int = 4, duration: float = 40.0, edges: int = 6
) -> Plan:
    """A plan whose platform turns about one axis and whose joints move along lines, all by one smooth law."""
    scenario = make_scenario(terminals, instruments, keep_out=keep_out_zones(zones), turn=(0.6, -1.1, 0.9))
    still = 0.0 if duration == 0 else 1.0
    start, end = scenario.start, scenario.goal
    first = Rotation.from_rotvec(start.rotation_vector)
    turn = still * (first.inv() * Rotation.from_rotvec(end.rotation_vector)).as_rotvec()
    change = still * (end.joints - start.joints)
    law = Polynomial([0, 0, 0, 10, -15, 6])
    series = poly2leg(law(Polynomial([0.5, 0.5])).coef)[:, None]
    joints = series * change
    joints[0] += start.joints
    share = np.linspace(0, 1, edges + 1)
    trajectory = Trajectory(
        breaks=np.array([0, duration]),
        chart_attitude=first.as_matrix()[None],
        chart_start=np.zeros(1),
        chart_rate=np.zeros((1, 3)),
        coefficients=(series * turn)[None],
        joint_breaks=np.array([0, duration]),
        joint_coefficients=joints[None],
        node_times=duration * share,
        smoothness=2,
        method="paper",
    )
    path = Path(
        attitudes=(first * Rotation.from_rotvec(law(share)[:, None] * turn)).as_matrix(),
        joints=start.joints + law(share)[:, None] * change,
        edge_costs=np.diff(law(share)),
    )
    bound = 0.02 if zones and terminals + instruments else None
    report = Certificate(
        certified=True,
        min_margin=bound,
        worst_time=None if bound is None else 0.25 * duration,
        worst_device=None if bound is None else "terminal-1",
        worst_zone=None if bound is None else "zone-0",
        faults=(),
    )
    goal = Goal(attitude=path.attitudes[-1], joints=path.joints[-1], slew_angle=float(np.linalg.norm(turn)))
    return Plan(
        scenario=scenario, status=Status.OK, goal=goal, path=path, trajectory=trajectory, certificate=report
    )


def filled(area: ContourSet, points: np.ndarray) -> np.ndarray:
    """(k,) which of (k, 2) points of a picture an area covers, counting its rings around each."""
    rings = [Shape(ring) for path in area.get_paths() for ring in path.to_polygons()]
    return sum((ring.contains_points(points) for ring in rings), np.zeros(len(points), int)) % 2 == 1


def keep_out_zones(count: int) -> tuple[KeepOut, ...]:
    rng = np.random.default_rng(5)
    return tuple(
        KeepOut(name=f"zone-{i}", direction=unit(rng.standard_normal(3)), half_angle=rng.uniform(0.05, 0.4))
        for i in range(count)
    )


def unit(vector: np.ndarray) -> np.ndarray:
    """The vector of length one."""
    return np.asarray(vector, dtype=float) / np.linalg.norm(vector)

"""Node sequences of the paper's four cases, kept as data, paths that tests build, and fits of them.

`rrt_cN` are smooth, `astar_cN` zig-zag; `tests/data/node_paths` holds ``R`` (m + 1, 3, 3), body to inertial,
and ``q`` (m + 1, 6), rad, of each.
"""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path as File
from typing import Any

import numpy as np
from builders import make_spacecraft
from scipy.spatial.transform import Rotation

from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import Fit, FitQuery, fit_batch

NAMES = [f"{kind}_c{case}" for kind in ("rrt", "astar") for case in (1, 2, 3, 4)]
ZIG_ZAG = [name for name in NAMES if name.startswith("astar")]


@cache
def load(name: str) -> Path:
    """A stored sequence with edges of equal cost, so that time is split equally."""
    file = File(__file__).parent / "data" / "node_paths" / f"{name}.json"
    data = json.loads(file.read_text(encoding="utf-8"))
    attitudes = np.array(data["R"])
    return Path(attitudes=attitudes, joints=np.array(data["q"]), edge_costs=np.ones(len(attitudes) - 1))


def fit_global(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, **more: Any) -> Fit:
    """The fit by one spline; ``more`` are fields of `FitQuery`."""
    return _fit(path, spacecraft, replace(settings, method="global"), more)


def fit_paper(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, **more: Any) -> Fit:
    """The fit by the paper's scheme; ``more`` are fields of `FitQuery`."""
    return _fit(path, spacecraft, replace(settings, method="paper"), more)


def _fit(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, more: dict[str, Any]) -> Fit:
    return fit_batch([FitQuery(path=path, spacecraft=spacecraft, settings=settings, **more)])[0]


@cache
def fit_stored(name: str, segments: int | None) -> Fit:
    """The paper's fit: 80 s, order 12, weights 1 and 3; segments None for one an interval."""
    path = load(name)
    settings = TrajectorySettings(duration=80.0, segments=segments or path.edges)
    return fit_paper(path, make_spacecraft(), settings)


def wandering(edges: int, terminals: int, *, seed: int, step: float = 0.1) -> Path:
    """A path of random steps that drift, with edges of equal cost; the joints stay within 0.2 rad."""
    rng = np.random.default_rng(seed)
    turns = step * (rng.normal(size=3) + 0.3 * rng.normal(size=(edges, 3)))
    attitudes = [Rotation.random(rng=rng)]
    for turn in turns:
        attitudes.append(attitudes[-1] * Rotation.from_rotvec(turn))
    moves = 0.5 * step * (rng.normal(size=2 * terminals) + 0.3 * rng.normal(size=(edges, 2 * terminals)))
    joints = np.concatenate([np.zeros((1, 2 * terminals)), np.cumsum(moves, axis=0)])
    joints *= 0.2 / np.maximum(np.abs(joints).max(axis=0), 0.2)
    return Path(
        attitudes=np.array([attitude.as_matrix() for attitude in attitudes]),
        joints=joints,
        edge_costs=np.ones(edges),
    )


def turning(angles_deg: list[float], axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> Path:
    """A path without joints that turns about a body axis to the given angles in turn."""
    vectors = np.deg2rad(angles_deg)[:, None] * np.array(axis) / np.linalg.norm(axis)
    base = Rotation.from_rotvec([0.4, -0.2, 0.9])
    return Path(
        attitudes=(base * Rotation.from_rotvec(vectors)).as_matrix(),
        joints=np.zeros((len(angles_deg), 0)),
        edge_costs=np.ones(len(angles_deg) - 1),
    )

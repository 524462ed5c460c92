"""A NaN in one lane of a batch of a thousand: its own lane is never clear, and no other changes.

On the CPU `jnp.max` and `jnp.min` may drop a NaN from some thousand elements on, which a batch easily has.
"""

from dataclasses import replace
from functools import cache, partial

import jax
import numpy as np
from builders import make_spacecraft, scene_of
from scipy.spatial.transform import Rotation

from jaxplan import so3
from jaxplan.cases import random_scenario
from jaxplan.model import constraints
from jaxplan.model.path import edge_margins
from jaxplan.model.status import Status
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.planner.steps import find_goals
from jaxplan.search import Scene, search_batch

LANES = 1000
CRAFT = make_spacecraft(2, 1)
CONES = tabulate(
    [KeepOut(name=f"z{k}", direction=d, half_angle=0.3) for k, d in enumerate(np.eye(3))],
    [
        KeepIn(name=f"k{k}", direction=-d, half_angle=2.0, devices=CRAFT.device_names[:1], any_of=group)
        for k, (d, group) in enumerate(zip(np.eye(3), (None, "g", "g"), strict=True))
    ],
    CRAFT,
)

SIGHTS = CONES.sights(CRAFT.gimbals, CRAFT.fixed_boresights)


def _state(attitude, joints):
    seen = SIGHTS.in_body(joints) @ attitude.T
    return constraints.constraint_margins(CONES, constraints.pair_margins(CONES, seen, CONES.axis))


def _edge(attitude, joints, turn, change):
    return edge_margins(CONES, SIGHTS, attitude, joints, turn, change, 4)


def _motion(attitude, turn):
    return so3.log(attitude.T @ so3.exp(turn)), so3.distance(attitude, so3.exp(turn))


# Each is a batch of a thousand, with what it takes; margins are the answers of the first two.
KERNELS = {
    "margins of states": (_state, ("attitude", "joints")),
    "margins of edges": (_edge, ("attitude", "joints", "turn", "change")),
    "logarithms and distances": (_motion, ("attitude", "turn")),
}


@cache
def kernel(name: str):
    return jax.jit(jax.vmap(KERNELS[name][0]))


def batch(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng([seed, 13])
    return {
        "attitude": Rotation.random(LANES, rng=rng).as_matrix(),
        "joints": rng.uniform(-0.2, 0.2, (LANES, 4)),
        "turn": 0.2 * rng.standard_normal((LANES, 3)),
        "change": 0.1 * rng.standard_normal((LANES, 4)),
    }


def attempt(seed: int) -> str:
    """One NaN somewhere in the inputs of each kernel."""
    rng = np.random.default_rng([seed, 14])
    good = batch(seed)
    for name, (_, wanted) in KERNELS.items():
        with jax.enable_x64(True):
            run = partial(kernel(name))
            before = [np.asarray(part) for part in jax.tree.leaves(run(*(good[key] for key in wanted)))]
            lane, key = int(rng.integers(LANES)), wanted[rng.integers(len(wanted))]
            bad = {k: v.copy() for k, v in good.items()}
            bad[key][lane].flat[rng.integers(bad[key][lane].size)] = rng.choice([np.nan, np.inf, -np.inf])
            after = [np.asarray(part) for part in jax.tree.leaves(run(*(bad[key] for key in wanted)))]
        others = np.arange(LANES) != lane
        for one, other in zip(before, after, strict=True):
            np.testing.assert_array_equal(one[others], other[others], err_msg=f"{name}: another lane changed")
        if name.startswith("margins"):
            assert not np.all(after[0][lane] >= 0), f"{name}: {key} is lost"
        else:
            assert not np.all(np.isfinite(np.concatenate([np.ravel(part[lane]) for part in after]))), name
    return "lost in no lane"


def problem(seed: int) -> tuple[Scene, object]:
    """A search of a random scene."""
    scenario = random_scenario(seed, "hard_keep_out")
    settings = replace(scenario.search, time_limit=np.inf, max_expansions=40)
    return scene_of(scenario, find_goals(scenario)[0]), settings


def searches(count: int, seed: int = 0) -> None:
    """Searches of many scenes, one of them with a NaN in it."""
    rng = np.random.default_rng([seed, 15])
    problems = [problem(number) for number in range(count)]
    good = search_batch(*zip(*problems, strict=True))
    lane = int(rng.integers(count))
    scene, settings = problems[lane]
    name = ("start_joints", "goal_coordinates", "gimbals", "goal_joints")[rng.integers(4)]
    whole = getattr(scene, name)
    broken = np.array(whole.frames if name == "gimbals" else whole)
    broken.flat[rng.integers(broken.size)] = np.nan
    part = replace(whole, frames=broken) if name == "gimbals" else broken
    problems[lane] = (replace(scene, **{name: part}), settings)
    with np.errstate(invalid="ignore"):
        found = search_batch(*zip(*problems, strict=True))
    assert found[lane].status is not Status.OK, f"a path with a NaN in {name}"
    for number, (one, other) in enumerate(zip(good, found, strict=True)):
        if number != lane:
            assert (one.status, one.queue_expansions) == (other.status, other.queue_expansions)
            if one.path is not None:
                np.testing.assert_allclose(other.path.attitudes, one.path.attitudes, atol=1e-6)
                np.testing.assert_allclose(other.path.joints, one.path.joints, atol=1e-6)

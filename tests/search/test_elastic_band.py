"""The elastic band: what it is pushed by, against differences of what it lacks."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_scenario, random_zones, scene_of
from oblique import oblique_scenario
from quick import quick_jit
from reference import assert_each
from scipy.spatial.transform import Rotation

from jaxplan.model.constraints import SIGHT
from jaxplan.search import elastic_band as band
from jaxplan.search.scene import Scene

SCENES = {
    "terminals about z": lambda: scene_of(make_scenario(3, 1, keep_out=random_zones(4))),
    "one terminal, one drive": lambda: scene_of(oblique_scenario(1, 1, 1, seed=1)),
    "two of each": lambda: scene_of(oblique_scenario(2, 2, 1, seed=2)),
    "three drives": lambda: scene_of(oblique_scenario(0, 3, 1, seed=3)),
    "four terminals and a drive": lambda: scene_of(oblique_scenario(4, 1, 0, seed=4)),
}


def crooked(scene: Scene, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A band (4, s) and (J, s) far off the straight motion, beyond ranges here and there."""
    rng, count = np.random.default_rng(seed), band.PIECES + 1
    share = np.linspace(0, 1, count)[:, None]
    end = Rotation.from_matrix(scene.start_attitude.T @ scene.goal_attitude).as_rotvec()
    turns = Rotation.from_rotvec(share * end + rng.normal(size=3) * np.sin(np.pi * share))
    away = rng.normal(size=len(scene.start_joints)) * np.sin(np.pi * share)
    joints = scene.start_joints + share * (scene.goal_joints - scene.start_joints) + 1.5 * away
    quaternions = turns.as_quat(scalar_first=True)
    quaternions *= np.where(np.sum(quaternions * quaternions[:1], axis=1) < 0, -1, 1)[:, None]
    return quaternions.T, joints.T


@quick_jit
def lacking(problem: band.Problem, quaternions: jax.Array, joints: jax.Array) -> jax.Array:
    """(f, s) what each node lacks, of bands (4, f, s) and (J, f, s); a pair of sights counts once."""
    axes, body = band.nodes_seen(problem, quaternions, joints)
    short = jnp.minimum(band.zone_slacks(problem, axes, body, joints), 0)
    beyond = band.beyond_limits(problem, joints)
    weight = jnp.where(problem.rows.frame == SIGHT, 0.5, 1.0)  # rows that are there twice
    return band.PENALTY * (jnp.einsum("z,zdfs->fs", weight, short**2) + jnp.sum(beyond**2, axis=0))


@pytest.mark.parametrize("name", SCENES)
def test_the_push_of_zones_and_ranges_is_the_derivative_of_what_is_lacking(name):
    scene = SCENES[name]()
    problem = band.make_problem(scene, jnp.asarray(8.0), jnp.asarray(0.05))
    gimbals, step = scene.gimbals, 1e-6
    size = 3 + gimbals.joint_count
    changes = step * np.concatenate([np.eye(size), -np.eye(size)])  # of bands, a component each
    terms = quick_jit(band._penalty_derivatives)
    pushed = np.zeros(2, bool)
    for seed in range(3):
        quaternions, joints = crooked(scene, seed)
        push, _, limit_push, _ = (np.asarray(part) for part in terms(problem, quaternions, joints))
        pushed |= [np.any(push != 0), np.any(limit_push != 0)]
        turned = [
            Rotation.from_quat(quaternions.T, scalar_first=True) * Rotation.from_rotvec(change[:3])
            for change in changes
        ]
        every = np.stack([turn.as_quat(scalar_first=True).T for turn in turned], axis=1)
        ahead, behind = np.split(
            np.asarray(lacking(problem, every, joints[:, None] + changes.T[3:, :, None])), 2
        )
        of_joints = [
            *push[3, : gimbals.terminals],
            *push[4, : gimbals.terminals],
            *push[3, gimbals.terminals : gimbals.count],
        ]
        expected = np.concatenate([push[:3].sum(axis=1), np.reshape(of_joints, (-1, 25)) + limit_push])
        np.testing.assert_allclose((ahead - behind) / (2 * step), expected, rtol=1e-5, atol=1e-4)
    assert pushed.all()


def test_a_band_descends_and_leaves_its_ends_alone():
    scene = SCENES["two of each"]()
    problem = band.make_problem(scene, jnp.asarray(8.0), jnp.asarray(0.01))
    descend = quick_jit(partial(band.descend, iterations=8))
    for seed in range(3):
        quaternions, joints = (jnp.asarray(part) for part in crooked(scene, seed))
        before = float(band.energy(problem, quaternions[:, None], joints[:, None])[0])
        turned, moved = descend(problem, quaternions, joints)
        after = float(band.energy(problem, turned[:, None], moved[:, None])[0])
        assert after < 0.5 * before
        for own, given in ((turned, quaternions), (moved, joints)):
            np.testing.assert_allclose(own[:, [0, -1]], given[:, [0, -1]], rtol=0, atol=1e-12)
        low, high = problem.ranges
        beyond = np.maximum(low[:, None] - moved, moved - high[:, None]).max()
        assert_each(beyond, "<", 0.2)

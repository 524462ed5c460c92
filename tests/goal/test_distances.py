import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.goal.distances import Platform, Pointers, speed_limits, ways
from jaxplan.goal.least_time import platform

RNG = np.random.default_rng(3)
LIKE = {"rate_limit": 0.02, "acceleration_limit": 0.004}
UNLIKE = {"rate_limit": np.array([0.02, 0.05, 0.03]), "acceleration_limit": np.array([0.01, 0.002, 0.004])}


@jax.jit
def found_ways(
    quaternion: np.ndarray, pointers: Pointers, turning: Platform
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Ways and slopes, and of each way twice the bends, one at a time."""
    values, slopes, bent = ways(quaternion, pointers, turning)
    bends = [bent(2 * jnp.zeros_like(values).at[number].set(1)) for number in range(len(values))]
    return values, slopes, jnp.stack(bends, axis=2)


def some_pointers(count: int) -> Pointers:
    """Devices of any mounting, some of whose angles are cut, and some of which have one joint or none."""
    directions = RNG.normal(size=(count, 3))
    low = RNG.uniform(-3, 0, size=(count, 2))
    moves = np.ones((count, 2), bool)
    moves[-2:, 1] = moves[-1:, 0] = False
    return Pointers(
        direction=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        frame=Rotation.random(count, rng=RNG).as_matrix(),
        ranges=np.stack([low, low + RNG.uniform(1, 7, size=(count, 2))], axis=-1),
        cut=np.arange(count) % 2 == 0,
        rest=RNG.uniform(-1, 1, size=(count, 2)),
        moves=moves,
        rate=np.ones((count, 2)),
        acceleration=np.ones((count, 2)),
    )


@pytest.mark.parametrize("limits", [LIKE, UNLIKE], ids=["like axes", "unlike axes"])
def test_slopes_and_bends_are_those_of_the_values(limits):
    pointers, turning = some_pointers(6), platform(jp.Spacecraft(terminals=(), **limits), 100.0)
    lanes, step = Rotation.random(30, rng=RNG), 1e-5

    def at(turns):
        return found_ways(turns.as_quat(scalar_first=True).T, pointers, turning)

    count = len(speed_limits(pointers, turning)[0])
    either = [
        [at(lanes * Rotation.from_rotvec(sign * step * axis)) for sign in (1, -1)] for axis in np.eye(3)
    ]
    values, slopes, bends = at(lanes)
    by_values, by_slopes = (
        np.stack([np.asarray(up[of] - down[of]) for up, down in either]) / (2 * step) for of in range(2)
    )
    assert len(values) == count
    np.testing.assert_allclose(slopes, by_values, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(bends, by_slopes + np.swapaxes(by_slopes, 0, 1), rtol=1e-5, atol=1e-7)


def test_where_nothing_has_turned_slopes_and_bends_are_finite():
    pointers, turning = some_pointers(6), platform(jp.Spacecraft(terminals=(), **UNLIKE), 100.0)
    for part in found_ways(np.array([[1.0], [0], [0], [0]]), pointers, turning):
        assert np.all(np.isfinite(part))

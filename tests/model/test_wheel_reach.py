"""What arrays of wheels reach: by linear programs and by the corners of half-spaces, for awkward axes too."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from builders import make_spacecraft
from quick import quick_jit
from reference import random_units
from scipy.optimize import linprog
from scipy.spatial import HalfspaceIntersection
from wheels import INERTIA, numbers, random_wheels, wheels

from jaxplan.goal.least_time import platform
from jaxplan.model.duration_bound import rest_bounds
from jaxplan.model.wheel_reach import WheelSpeeds, fitted_frames, reaches
from jaxplan.model.wheels import MINIMAX, PSEUDO_INVERSE
from jaxplan.trajectory.node_times import turn_time

PYRAMID = np.array([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]]) / np.sqrt(2)
PLANE = np.array([[1, 0, 0], [0, 1, 0], [0.6, 0.8, 0], [0, 0, 1.0]])
NEARLY = PLANE + 1e-7 * random_units(np.random.default_rng(2), 4)
ARRAYS = {
    "pyramid": wheels(PYRAMID, stored=[0.4, -0.2, 0.3, 0.1]),
    "plane": wheels(PLANE, [0.02, 0.03, 0.04, 0.05]),
    "nearly a plane": wheels(NEARLY / np.linalg.norm(NEARLY, axis=1, keepdims=True)),
    "twice along an axis": wheels(np.vstack([np.eye(3), [[-1, 0, 0]]]), stored=[1.0, 0, 0, 0.9]),
    **{f"{count} about random axes": random_wheels(count, seed=count) for count in (3, 4, 5, 6, 8)},
}

# Of each kind one; for every other number of wheels the same would be compiled anew.
AWKWARD = ["pyramid", "plane", "nearly a plane", "twice along an axis", "5 about random axes"]

SLOPES_OF_TOPS = quick_jit(jax.grad(lambda craft: jnp.sum(platform(craft, 100.0).top), allow_int=True))


def craft_of(array, allocation):
    return replace(make_spacecraft(1), inertia=INERTIA, wheels=array, allocation=allocation)


def polytope(craft, which):
    """Half-spaces ``A x <= b`` of the torques (0) or momenta (1) that the pseudo-inverse allows."""
    axes, torque, momentum, stored = numbers(craft)
    share = np.linalg.pinv(axes.T)
    apart = stored - share @ (stored @ axes) if which else 0 * stored
    bound = (torque, momentum)[which]
    return np.vstack([share, -share]), np.concatenate([bound - apart, bound + apart])


def farthest(craft, which, direction):
    """The largest product with a direction of either sign, by linprog."""
    axes, torque, momentum, _ = numbers(craft)
    if craft.allocation == MINIMAX:
        return np.abs(axes @ direction) @ (torque, momentum)[which]
    rows, bound = polytope(craft, which)
    return max(
        -linprog(-sign * direction, A_ub=rows, b_ub=bound, bounds=(None, None)).fun for sign in (1, -1)
    )


@pytest.mark.parametrize("allocation", [PSEUDO_INVERSE, MINIMAX])
@pytest.mark.parametrize("name", ARRAYS)
def test_the_reach_along_a_direction_is_that_of_a_linear_program(name, allocation):
    craft = craft_of(ARRAYS[name], allocation)
    directions = np.vstack([np.eye(3), random_units(np.random.default_rng(3), 5)])
    for which, reach in enumerate(reaches(craft)):
        known = [farthest(craft, which, own) for own in directions]
        if name == "nearly a plane":  # where rounding would count, more than the least is said
            assert np.all(reach.along(directions) >= np.array(known) * (1 - 1e-9))
        else:
            np.testing.assert_allclose(reach.along(directions), known, rtol=1e-8)


@pytest.mark.parametrize("name", ARRAYS)
def test_the_largest_size_is_that_of_a_corner(name):
    craft = craft_of(ARRAYS[name], PSEUDO_INVERSE)
    rng = np.random.default_rng(4)
    matrices = [np.linalg.inv(INERTIA), np.diag([0, 1.0, 1.0]), (root := rng.normal(size=(3, 3))) @ root.T]
    for which, reach in enumerate(reaches(craft)):
        rows, bound = polytope(craft, which)
        corners = HalfspaceIntersection(np.column_stack([rows, -bound]), np.zeros(3)).intersections
        for matrix in matrices:
            known = np.sqrt(np.max(np.sum((corners @ matrix) * corners, axis=1)))
            assert reach.largest(matrix) >= known * (1 - 1e-9)
            if name != "nearly a plane":
                assert reach.largest(matrix) == pytest.approx(known, rel=1e-5)


def test_many_wheels_reach_no_more_than_is_said():
    craft = craft_of(random_wheels(11, seed=1), PSEUDO_INVERSE)
    for which, reach in enumerate(reaches(craft)):
        for direction in random_units(np.random.default_rng(5), 10):
            most = farthest(craft, which, direction)
            assert reach.along(direction[None])[0] == pytest.approx(most, rel=1e-8)
            assert most <= reach.largest(np.outer(direction, direction)) * (1 + 1e-9)


def test_a_pseudo_inverse_takes_longer_than_the_envelope_and_bounds_say_so():
    turns = random_units(np.random.default_rng(6), 40) * np.linspace(0.5, 3, 40)[:, None]
    fast = {"rate_limit": 1.0, "acceleration_limit": 1.0}
    by_inverse, by_envelope = (
        rest_bounds(replace(craft_of(random_wheels(5, seed=5), own), **fast), turns, np.zeros((40, 2)))
        for own in (PSEUDO_INVERSE, MINIMAX)
    )
    assert np.all(by_inverse >= by_envelope * (1 - 1e-9))
    assert np.mean(by_inverse / by_envelope) > 1.02


@pytest.mark.parametrize("allocation", [PSEUDO_INVERSE, MINIMAX])
@pytest.mark.parametrize("name", ARRAYS)
def test_boxes_in_fitted_frames_hold_all_that_wheels_allow(name, allocation):
    craft = craft_of(ARRAYS[name], allocation)
    frames, speeds = fitted_frames(craft), WheelSpeeds.of(craft, 0.0, INERTIA)
    np.testing.assert_allclose(
        frames @ np.swapaxes(frames, 1, 2), np.tile(np.eye(3), (len(frames), 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    rates, accelerations = speeds.boxes(frames, np.full(3, 9.0), np.full(3, 9.0), 0.0)
    for axes, *limits in zip(frames, accelerations, rates, strict=True):
        for which, limit in enumerate(limits):
            along = [farthest(craft, which, np.linalg.solve(INERTIA, axis)) for axis in axes]
            np.testing.assert_allclose(limit, along, rtol=1e-6 if name == "nearly a plane" else 1e-8)


@pytest.mark.parametrize("allocation", [PSEUDO_INVERSE, MINIMAX])
def test_bounds_of_short_turns_are_near_what_a_turn_about_one_axis_takes(allocation):
    """On short turns nothing is gained by turning about other axes on the way, whatever wheels allow."""
    rng = np.random.default_rng(9)
    for axes in (PYRAMID, random_units(rng, 3), random_units(rng, 4)):
        craft = craft_of(wheels(axes), allocation)
        craft = replace(craft, rate_limit=1.0, acceleration_limit=1.0)
        for size, least in ((0.02, 0.9), (1.0, 0.66)):
            turns = random_units(rng, 40) * size
            bounds = rest_bounds(craft, turns, np.zeros((40, 2)))
            takes = np.array([turn_time(turn, craft) for turn in turns])
            assert np.all(bounds <= takes * (1 + 1e-9))
            assert np.all(bounds >= least * takes)


@pytest.mark.slow
def test_slopes_of_the_bound_by_axes_and_limits_are_those_of_differences():
    turn, moves = np.array([[0.9, -0.4, 0.7]]), np.zeros((1, 2))
    axes, torque, momentum, _ = numbers(craft_of(random_wheels(4, seed=3), PSEUDO_INVERSE))

    def bound(given, limit):
        array = [
            replace(wheel, axis=axis, torque=own)
            for wheel, axis, own in zip(wheels(axes, torque, momentum), given, limit, strict=True)
        ]
        craft = replace(craft_of(tuple(array), PSEUDO_INVERSE), rate_limit=1.0, acceleration_limit=1.0)
        return rest_bounds(craft, turn, moves)[0]

    with jax.enable_x64(True):
        found = jax.jit(jax.grad(bound, argnums=(0, 1)))(axes, torque)
        base = axes, torque
        for number, slope in enumerate(found):
            known = np.empty(base[number].shape)
            for place in np.ndindex(known.shape):
                step = np.zeros(known.shape)
                step[place] = 1e-6
                ahead, back = (
                    [own + sign * step if k == number else own for k, own in enumerate(base)]
                    for sign in (1, -1)
                )
                known[place] = (bound(*ahead) - bound(*back)) / 2e-6
            np.testing.assert_allclose(slope, known, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("name", AWKWARD)
def test_slopes_of_what_goals_of_least_time_go_by_are_finite(name):
    """Corners that are none stand as zeros among the others, and a plane leaves nothing of an axis."""
    craft = craft_of(ARRAYS[name], PSEUDO_INVERSE)
    craft = replace(craft, inertia=np.diag(np.diag(INERTIA)))
    with jax.enable_x64(True):
        slopes = SLOPES_OF_TOPS(craft)
        slopes = [slopes.inertia, *(one.axis for one in slopes.wheels)]
    assert np.all(np.isfinite(np.concatenate([np.ravel(one) for one in slopes])))
    assert np.any(slopes[0])

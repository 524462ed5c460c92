"""Arrays of reaction wheels for tests, and what they give and hold by plain numpy."""

from dataclasses import replace
from itertools import combinations

import numpy as np
from builders import make_scenario
from reference import attitudes_of, random_units, spin_of
from scipy.optimize import linprog

import jaxplan as jp

INERTIA = np.array([[20.0, 1.0, 0.0], [1.0, 25.0, -2.0], [0.0, -2.0, 30.0]])
# Of fewer wheels, so that some of them bind in torque and some in momentum.
TIGHT = {"torque": 0.4, "momentum": 0.45, "stored": 0.2}


def wheels(axes, torque=0.05, momentum=1.5, stored=0.0):
    """Wheels about axes (n, 3), with numbers of all or of each."""
    given = zip(axes, *(np.broadcast_to(x, len(axes)) for x in (torque, momentum, stored)), strict=True)
    return tuple(
        jp.Wheel(name=f"wheel-{k}", axis=axis, torque=float(t), momentum=float(m), stored=float(s))
        for k, (axis, t, m, s) in enumerate(given, 1)
    )


def random_wheels(count, seed):
    """Wheels about random axes that differ in all numbers, and hold something at the start."""
    rng = np.random.default_rng(seed)
    while True:
        axes = random_units(rng, count)
        if np.linalg.svd(axes, compute_uv=False)[-1] > 0.4:
            break
    torque, momentum = rng.uniform(0.03, 0.06, count), rng.uniform(1.0, 1.6, count)
    return wheels(axes, torque, momentum, momentum * rng.uniform(-0.3, 0.3, count))


def scarce(count, seed):
    """Wheels of which a motion fills some, and overloads others if it is any quicker."""
    return tuple(
        replace(one, **{name: factor * getattr(one, name) for name, factor in TIGHT.items()})
        for one in random_wheels(count, seed)
    )


def least_shared(axes, limit, vector):
    """The least largest share of limits (n,) by which a vector is shared out, and what each gives."""
    count = len(axes)
    found = linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.block([[np.eye(count), -limit[:, None]], [-np.eye(count), -limit[:, None]]]),
        b_ub=np.zeros(2 * count),
        A_eq=np.column_stack([axes.T, np.zeros(3)]),
        b_eq=vector,
        bounds=[*((None, None) for _ in axes), (0, None)],
    )
    return found.fun, found.x[:-1]


def not_against(array):
    """Wheels that hold the same together, with nothing against each other."""
    axes, limit, stored = (
        np.array([getattr(one, name) for one in array]) for name in ("axis", "momentum", "stored")
    )
    own = least_shared(axes, limit, stored @ axes)[1]
    return tuple(replace(one, stored=float(held)) for one, held in zip(array, own, strict=True))


def with_wheels(array, allocation="pseudo_inverse", seed=0, terminals=1, turn=(0.3, -0.5, 0.4), **settings):
    """A scenario of a spacecraft with wheels, and settings of its trajectory."""
    array = not_against(array) if allocation == "minimax" else array
    scenario = make_scenario(terminals, seed=seed, turn=turn)
    craft = replace(scenario.spacecraft, inertia=INERTIA, wheels=array, allocation=allocation)
    return replace(scenario, spacecraft=craft, trajectory=replace(scenario.trajectory, **settings))


def numbers(craft):
    """Axes (n, 3), and torque, momentum and stored momentum (n,) of wheels."""
    axes = np.array([wheel.axis for wheel in craft.wheels])
    return axes, *(
        np.array([getattr(wheel, name) for wheel in craft.wheels])
        for name in ("torque", "momentum", "stored")
    )


def exchanged(trajectory, craft, time):
    """The wheels' torque on the body (k, 3) N m and their momentum (k, 3) N m s, body axes, at times (k,)."""
    axes, *_, stored = numbers(craft)
    rate, acceleration, _ = spin_of(trajectory, time)
    attitude, inertia = attitudes_of(trajectory, time), np.asarray(craft.inertia)
    start = np.zeros(1)
    total = attitudes_of(trajectory, start)[0] @ (inertia @ spin_of(trajectory, start)[0][0] + stored @ axes)
    carried = np.einsum("kji,j->ki", attitude, total)
    return acceleration @ inertia + np.cross(rate, carried), carried - rate @ inertia


def by_pseudo_inverse(trajectory, craft, time):
    """Torques and momenta (k, n) of all wheels over their limits."""
    axes, torque, momentum, stored = numbers(craft)
    given, held = exchanged(trajectory, craft, time)
    share = np.linalg.pinv(axes.T)
    return given @ share.T / torque, (stored + (held - stored @ axes) @ share.T) / momentum


def by_envelope(trajectory, craft, time):
    """Torque and momentum over the zonotopes of the limits, by facets (k, pairs): within at most 1."""
    axes, torque, momentum, _ = numbers(craft)
    found = []
    for vectors, bound in zip(exchanged(trajectory, craft, time), (torque, momentum), strict=True):
        across = np.array([np.cross(a, b) for a, b in combinations(axes, 2)])
        across = across[np.linalg.norm(across, axis=1) > 1e-9]
        found.append(vectors @ across.T / (np.abs(across @ axes.T) @ bound))
    return found


def instants(trajectory, count):
    """Times (count,) of a trajectory, s, those on either side of its breaks among them."""
    last = trajectory.duration
    times = np.linspace(0, last, count - 2 * (len(trajectory.breaks) - 2))
    inner = trajectory.breaks[1:-1]
    return np.sort(np.concatenate([times, inner, np.nextafter(inner, 0)]))

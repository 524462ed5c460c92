"""Derivatives of whole plans of random spacecraft by all that is said of devices, beside differences."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxplan as jp
from jaxplan import so3

STEP = 1e-4
TOLERANCE = 1e-6  # of the usual size of a random sum of derivatives
WAYS = 4  # random sums of all numbers of a curve
CURVE = ("coefficients", "joint_coefficients", "chart_attitude", "chart_rate", "joint_breaks", "breaks")


def moved(scenario, by):
    """All mountings turned, ranges and masks moved, and limits scaled, along a random way of length `by`."""
    rng, craft = np.random.default_rng(1), scenario.spacecraft

    def shifted(value):
        return None if value is None else value + by * 0.1 * rng.standard_normal(np.shape(value))

    def scaled(device, *names):
        given = {name: getattr(device, name) for name in names}
        return {
            name: None if value is None else value * (1 + by * 0.3 * rng.standard_normal(np.shape(value)))
            for name, value in given.items()
        }

    def turned(device, *names):
        turn = jnp.asarray(so3.exp(by * 0.1 * rng.standard_normal(3)))
        return {name: turn @ jnp.asarray(getattr(device, name)) for name in names}

    def of_terminal(one):
        mounting = one.mounting and replace(one.mounting, **turned(one.mounting, "yaw_axis", "boresight"))
        joints = [
            f"{joint}{kind}_limit" for joint in ("", "yaw_", "pitch_") for kind in ("rate", "acceleration")
        ]
        angles = ("mount", "yaw_limit", "yaw_range", "pitch_limit", "pitch_range")
        own = {name: shifted(getattr(one, name)) for name in angles}
        return replace(
            one, mounting=mounting, mask=tuple(map(shifted, one.mask)), **own, **scaled(one, *joints)
        )

    def of_drive(one):
        limits = scaled(one, "rate_limit", "acceleration_limit")
        return replace(one, range=shifted(one.range), **turned(one, "axis", "boresight"), **limits)

    platform = ("rate_limit", "acceleration_limit", "rate_norm_limit", "acceleration_norm_limit")
    return replace(
        scenario,
        spacecraft=replace(
            craft,
            terminals=tuple(map(of_terminal, craft.terminals)),
            drives=tuple(map(of_drive, craft.drives)),
            instruments=tuple(replace(one, **turned(one, "boresight")) for one in craft.instruments),
            **scaled(craft, *platform),
        ),
    )


@pytest.mark.slow
# Together they give devices in all ways; 52 is at its limit twice, going straight.
@pytest.mark.parametrize("seed", [52, 68])
def test_a_plan_follows_mountings_ranges_masks_and_limits(seed):
    plan = jp.plan(jp.random_scenario(seed, "any_spacecraft"), progress=False)
    told = jp.differentiable(plan)

    def curve(by):
        found = told(moved(plan.scenario, by))
        return jnp.concatenate([jnp.ravel(jnp.asarray(getattr(found, name))) for name in CURVE])

    with jax.enable_x64(True):
        found = np.asarray((curve(STEP) - curve(-STEP)) / (2 * STEP))
        ways = np.random.default_rng(2).standard_normal((WAYS, len(found)))
        slopes = [float(jax.grad(lambda by, way=way: way @ curve(by))(0.0)) for way in ways]
    largest = float(np.max(np.abs(found)))
    assert largest > 0.1
    np.testing.assert_allclose(slopes, ways @ found, rtol=0, atol=TOLERANCE * np.linalg.norm(found))

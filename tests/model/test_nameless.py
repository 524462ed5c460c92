"""Scenarios without names have the structure in common, and all numbers left."""

from dataclasses import replace

import jax
import numpy as np
from builders import at_rest, make_spacecraft
from reference import direction

import jaxplan as jp
from jaxplan.model.hidden_spans import Hidden
from jaxplan.model.nameless import nameless

TIMES = np.linspace(0.0, 100.0, 11)
PATH = jp.DirectionPath.through(TIMES, direction(1e-3 * TIMES, np.full(11, 0.3)))
SCENE = jp.Scenario(
    name="one",
    spacecraft=make_spacecraft(1, 1),
    start=at_rest(np.zeros(3), np.zeros(2)),
    goal=jp.Targets.of({"camera-1": PATH}),
    keep_out=(jp.KeepOut(name="sun", direction=PATH, half_angle=0.1, devices=("camera-1",)),),
)


def test_what_differs_in_names_alone_has_one_structure_and_the_same_numbers():
    seen = replace(PATH, called="ship", hidden=(Hidden(target="ship", by="earth", start=20.0, end=30.0),))
    other = replace(
        SCENE,
        name="other",
        epoch=np.datetime64("2031-05-06T07:08:09"),
        goal=replace(SCENE.goal, directions=(seen,)),
        keep_out=(replace(SCENE.keep_out[0], name="moon", direction=replace(PATH, called="moon")),),
        search=replace(SCENE.search, seed=3, improvements=2),
    )
    first, second = nameless(SCENE), nameless(other)
    assert jax.tree.structure(other) != jax.tree.structure(SCENE)
    assert jax.tree.structure(second) == jax.tree.structure(first)
    for plain, own in ((first, SCENE), (second, other)):
        for left, given in zip(*map(jax.tree.leaves, (plain, own)), strict=True):
            np.testing.assert_array_equal(left, given)


def test_what_tells_the_trajectory_stays():
    plain = nameless(SCENE)
    assert plain.spacecraft.device_names == SCENE.spacecraft.device_names
    assert plain.goal.devices == SCENE.goal.devices
    assert plain.keep_out[0].devices == ("camera-1",)
    assert plain.trajectory.duration == SCENE.trajectory.duration
    wider = replace(SCENE, search=replace(SCENE.search, clearance=0.2))
    assert nameless(wider).search.clearance == 0.2

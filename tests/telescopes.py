"""Scenes of space telescopes that tests and benches share."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import jaxplan as jp

FOLDER = Path(__file__).parent / "scenarios"


def load(name, **settings):
    """The scenario of a file, with some settings of its trajectory."""
    scenario = jp.load_scenario(FOLDER / f"{name}.toml")
    return replace(scenario, trajectory=replace(scenario.trajectory, **settings))


def hubble(seed, **settings):
    """The telescope between random attitudes that are clear of the Sun."""
    rng, ends = np.random.default_rng(seed), []
    scenario = load("hubble", **settings)
    while len(ends) < 2:
        turn = Rotation.random(rng=rng)
        if turn.apply([1, 0, 0]) @ scenario.keep_out[0].direction < np.cos(np.deg2rad(25)):
            ends.append(replace(scenario.start, rotation_vector=turn.as_rotvec()))
    return replace(scenario, start=ends[0], goal=ends[1])

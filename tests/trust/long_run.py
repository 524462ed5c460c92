"""Scenario after scenario of every sort: each answer is a certified plan or says why there is none.

A plan is looked at by scipy and numpy alone (`dense`, `manoeuvres`): limits and zones on a grid that no part
of the package has seen, both ends, and where its terminals point. Its file is read back and written again.
"""

import json
import resource
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from dense import assert_kept, end_states
from reference import assert_each, attitudes_of, boresights_of, joints_of
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.goals import GivenState
from jaxplan.schema import dump_scenario, parse_scenario
from trust.mixed import mixed_scenario, shape_of
from trust.tally import Tally, tally

SAMPLES = 801
ENDS = 1e-7  # rad and rad/s, by which an end may be missed
LIMIT_S = 600.0  # after which a scene counts as hanging


def attempt(seed: int) -> str:
    """The status of one scenario's plan, which is as it should be."""
    scenario = mixed_scenario(seed)
    again = parse_scenario(dump_scenario(scenario))  # it is one that a file may hold
    assert again == scenario
    plan = jp.plan(scenario, throw=False, progress=False)
    examine(plan)
    return plan.status.name


def examine(plan: jp.Plan) -> None:
    """Raise if an answer is not what an answer is to be."""
    assert plan.timings["total"] >= 0
    assert str(plan)
    json.dumps(plan.summary(), allow_nan=False)
    kept_in_a_file(plan)
    if not plan.ok:
        assert plan.message, "no word on what is wrong"
        assert (
            plan.certificate is None
            or not plan.certificate.certified
            or plan.status is jp.Status.LIMITS_TOO_TIGHT
        )
        return
    assert plan.certificate.certified
    trajectory, scenario = plan.trajectory, plan.scenario
    craft, zones = scenario.spacecraft, [*scenario.keep_out, *scenario.keep_in]
    if trajectory.duration > 0:
        assert_kept(trajectory, craft, zones, SAMPLES)
        rates = end_states(trajectory)[0]
        for number, end in enumerate((scenario.start, scenario.goal)):
            own = np.concatenate([end.angular_velocity, end.joint_rates])
            np.testing.assert_allclose(rates[number], own, rtol=1e-5, atol=ENDS)
    assert_ends(plan)


def assert_ends(plan: jp.Plan) -> None:
    """It starts where it is to start, and ends in the goal, or with its terminals at their targets."""
    trajectory, scenario = plan.trajectory, plan.scenario
    times = np.array([0.0, trajectory.duration])
    moving = trajectory if trajectory.duration > 0 else None
    if moving is None:
        sample = trajectory.sample(times)
        attitudes, joints = sample.attitude, sample.joints
        seen = np.array(scenario.spacecraft.boresights(attitudes[1], joints[1]))
    else:
        attitudes, joints = attitudes_of(trajectory, times), joints_of(trajectory, times)[0]
        seen = boresights_of(trajectory, scenario.spacecraft, times)[1]
    wanted = [scenario.start] + [scenario.goal] * isinstance(scenario.goal, GivenState)
    for number, end in enumerate(wanted):
        expected = Rotation.from_rotvec(end.rotation_vector)
        assert (expected.inv() * Rotation.from_matrix(attitudes[number])).magnitude() <= ENDS
        np.testing.assert_allclose(joints[number] - end.joints, 0, atol=ENDS)
    if len(wanted) == 1:
        targets = scenario.goal.directions
        across = np.linalg.norm(np.cross(seen[: len(targets)], targets), axis=1)
        assert_each(across, "<=", ENDS)
        np.testing.assert_array_less(0, np.sum(seen[: len(targets)] * targets, axis=1))


def kept_in_a_file(plan: jp.Plan) -> None:
    """A plan that is read back is written with the same bytes."""
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder) / "a.json", Path(folder) / "b.json"
        plan.save(first)
        jp.load_plan(first).save(second)
        assert first.read_bytes() == second.read_bytes()


def run(seeds: Sequence[int]) -> list[Tally]:
    """Many scenarios, and what memory the same ones take when they are planned again and again.

    Those of a shape come one after the other, so that its kernels are compiled once.
    """
    return [
        tally("mixed scenes: certified, or a status", sorted(seeds, key=shape_of), attempt, limit_s=LIMIT_S),
        leaks(max(len(seeds) // 50, 20)),
    ]


def leaks(count: int, shape: tuple[int, int] = (3, 0)) -> Tally:
    """Plans of one shape, over and over, while memory does not grow."""
    kept: list[float] = []
    failures = []
    for number in range(2 * count):
        jp.plan(mixed_scenario(number % 8, shape, 8), throw=False, progress=False)
        kept.append(memory())
    grown = kept[-1] - kept[count - 1]
    if grown > 0.1 * count:
        failures.append(f"{grown:.0f} MiB")
    note = f"{grown:+.1f} MiB in the last {count}, of {kept[-1]:.0f}"
    return Tally(what="memory over the same scenes again", count=2 * count, failures=failures, note=note)


def memory() -> float:
    """Of this process at the most so far, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

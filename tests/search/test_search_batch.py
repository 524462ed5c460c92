"""Many searches in one call: each finds what it finds by itself, whatever lies beside it."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from builders import make_scenario, scene_of
from reference import assert_each
from trust import lanes

from jaxplan.cases import SKY_KINDS, random_scenario
from jaxplan.model.path import Path
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.paper.rrt_star import Star
from jaxplan.planner.steps import find_goals
from jaxplan.runtime.batching import Seconds
from jaxplan.search import PLANNERS, Scene, SearchResult, add_planner, mha, remove_planner, search_batch
from jaxplan.search.astar import Search
from jaxplan.search.kernel_calls import CPU_CALLS, POOL, Call, Kernel, Scenes, SearchRun
from jaxplan.search.rrt_connect import Connect
from jaxplan.search.trees import Space

REACH = Kernel(lambda scene, times: times * scene.goal_joints)
TURN = Kernel(lambda scene: scene.goal_attitude[0])


class Tally:
    """A run that asks a number of times for one thing, and then for another."""

    def __init__(self, rounds: int) -> None:
        self.rounds, self.total, self.row = rounds, np.zeros(4), None

    def next_request(self) -> Call | None:
        if self.rounds:
            return Call(REACH, (float(self.rounds - 1),))
        return Call(TURN, ()) if self.row is None else None

    def accept(self, answer: np.ndarray) -> None:
        if self.rounds:
            self.rounds, self.total = self.rounds - 1, self.total + answer
        else:
            self.row = answer


def informed(scene: Scene, settings: SearchSettings) -> SearchRun:
    return Search(scene, settings, mha.rules(scene))


def trees(scene: Scene, settings: SearchSettings) -> SearchRun:
    return Connect(Space(scene, settings))


def star(scene: Scene, settings: SearchSettings) -> SearchRun:
    return Star(Space(scene, settings))


def random_problem(seed: int, kind: str, **changes: object) -> tuple[Scene, SearchSettings]:
    scenario = random_scenario(seed, kind)
    return scene_of(scenario, find_goals(scenario)[0]), replace(scenario.search, **changes)


def assert_agree(first: SearchResult, second: SearchResult) -> None:
    assert first.status is second.status
    assert (first.path is None) == (second.path is None)
    if first.path is not None and second.path is not None:
        for name in ("attitudes", "joints", "edge_costs"):
            np.testing.assert_allclose(
                getattr(first.path, name), getattr(second.path, name), rtol=0, atol=1e-6
            )


@pytest.mark.slow
@pytest.mark.parametrize("scenes", [1, 2, 4 * CPU_CALLS + 3])
def test_a_batch_agrees_with_one_by_one_in_every_batch_shape(scenes):
    # Of seed 5, two ways are as long as each other.
    problems = [random_problem(7 + k // 5, SKY_KINDS[k % 5], max_expansions=20) for k in range(scenes)]
    answers = search_batch(*zip(*problems, strict=True))
    assert len(answers) == scenes
    for (scene, settings), answer in zip(problems, answers, strict=True):
        assert_agree(answer, PLANNERS["mha"](scene, settings))


def test_a_batch_may_mix_methods():
    problems = [
        random_problem(seed, "hard_keep_out", method=method, max_expansions=60)
        for method in PLANNERS
        for seed in range(2)
    ]
    answers = search_batch(*zip(*problems, strict=True))
    assert {answer.status for answer in answers} == {Status.OK, Status.NODE_LIMIT}
    for (scene, settings), answer in zip(problems, answers, strict=True):
        assert_agree(answer, PLANNERS[settings.method](scene, settings))


def test_the_same_call_gives_the_same_bytes():
    problems = [random_problem(seed, "hard_keep_out", max_expansions=60) for seed in range(6)]
    first, again = (search_batch(*zip(*problems, strict=True)) for _ in range(2))
    for one, other in zip(first, again, strict=True):
        assert (one.status, one.queue_expansions) == (other.status, other.queue_expansions)
        if one.path is not None:
            np.testing.assert_array_equal(one.path.attitudes, other.path.attitudes)
            np.testing.assert_array_equal(one.path.joints, other.path.joints)


def test_spacecraft_of_different_kinds_may_share_a_batch():
    scenarios = [make_scenario(terminals, 1, turn=(0.5, 0.2, 0.1)) for terminals in (0, 3, 0, 2, 3)]
    scenes = [scene_of(scenario) for scenario in scenarios]
    answers = search_batch(scenes, [scenario.search for scenario in scenarios])
    for scene, answer in zip(scenes, answers, strict=True):
        assert answer.path.joints.shape[1] == 2 * scene.gimbals.count
        np.testing.assert_array_equal(answer.path.attitudes[-1], scene.goal_attitude)


def test_a_batch_needs_settings_for_each_scene_and_may_be_empty():
    scene, settings = random_problem(0, "keep_in")
    assert search_batch([], []) == []
    with pytest.raises(ValueError, match="settings: must be one a scene, 2, not 1"):
        search_batch([scene, scene], [settings])


def test_a_time_limit_ends_the_searches_of_a_batch():
    problems = [random_problem(seed, "hard_keep_out", time_limit=1e-9) for seed in (10, 19)]
    assert Status.TIME_LIMIT in {answer.status for answer in search_batch(*zip(*problems, strict=True))}


@pytest.mark.parametrize("make", [informed, trees, star])
def test_a_run_that_is_out_of_time_ends_without_a_path(make):
    scene, settings = random_problem(10, "hard_keep_out", time_limit=0.0)
    run = make(scene, settings)
    Scenes([scene]).run([run])
    assert (run.result().status, run.result().path) == (Status.TIME_LIMIT, None)


def test_each_search_is_told_the_time_it_took():
    problems = [random_problem(seed, kind, max_expansions=40) for seed in (0, 10) for kind in SKY_KINDS]
    seconds = Seconds(len(problems))
    search_batch(*zip(*problems, strict=True), seconds)
    assert_each(seconds.spent, ">", 0)


@pytest.mark.parametrize("backend", ["cpu", "gpu"])
def test_each_call_is_about_its_own_scene_whatever_waits_beside_it(backend, monkeypatch):
    """Runs that ask different things a different number of times; side by side as on an accelerator."""
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    scenes = [scene_of(make_scenario(2, seed=seed)) for seed in range(4)]
    many = Scenes([scenes[k % 4] for k in range(POOL)])
    numbers = list(range(0, POOL, 2))
    runs = [Tally(k % 7) for k in numbers]
    many.part(numbers).run(runs)
    for k, run in zip(numbers, runs, strict=True):
        rounds, scene = k % 7, scenes[k % 4]
        np.testing.assert_allclose(run.total, rounds * (rounds - 1) / 2 * scene.goal_joints, rtol=1e-14)
        np.testing.assert_array_equal(run.row, scene.goal_attitude[0])


def test_a_nan_in_one_scene_is_no_path_and_changes_no_other():
    for seed in range(3):
        lanes.searches(3, seed)


def test_a_fault_in_one_search_is_not_hidden():
    class Faulty(Tally):
        def accept(self, answer: np.ndarray) -> None:
            raise RuntimeError("out of order")

    scene = scene_of(make_scenario(2))
    with pytest.raises(RuntimeError, match="out of order"):
        Scenes([scene, scene]).run([Tally(1), Faulty(1)])


class OneNode:
    """A planner that asks one thing, and then says that the start is all there is."""

    def __init__(self, scene: Scene, settings: SearchSettings) -> None:
        self.scene, self.settings, self.asked = scene, settings, None

    def next_request(self) -> Call | None:
        return Call(REACH, (2.0,)) if self.asked is None else None

    def accept(self, answer: np.ndarray) -> None:
        self.asked = answer

    def result(self) -> SearchResult:
        return one_node(self.scene, self.settings, self.asked)


def one_node(scene: Scene, settings: SearchSettings, joints: np.ndarray | None = None) -> SearchResult:
    joints = 2 * scene.goal_joints if joints is None else joints
    path = Path(attitudes=scene.start_attitude[None], joints=joints[None], edge_costs=np.zeros(0))
    return SearchResult(status=Status.OK, path=path, expansions=settings.seed)


@pytest.mark.parametrize("planner", [one_node, OneNode])
def test_a_planner_of_ones_own_may_be_a_function_or_a_run(planner):
    problems = [random_problem(seed, "keep_out", method="one-node") for seed in range(3)]
    problems = [(scene, replace(own, seed=seed)) for seed, (scene, own) in enumerate(problems)]
    problems.insert(1, random_problem(0, "keep_out", max_expansions=20))
    add_planner("one-node", planner)
    try:
        answers = search_batch(*zip(*problems, strict=True))
        alone = PLANNERS["one-node"](*problems[-1])
        with pytest.raises(ValueError, match="there is a planner of that name"):
            add_planner("one-node", planner)
    finally:
        remove_planner("one-node")
    assert "one-node" not in PLANNERS
    for (scene, settings), answer in zip(problems, answers, strict=True):
        if settings.method == "one-node":
            np.testing.assert_allclose(answer.path.joints[0], 2 * scene.goal_joints)
            assert answer.expansions == settings.seed
    assert_agree(alone, answers[-1])

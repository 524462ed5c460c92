from dataclasses import replace

import jax
import numpy as np
import pytest
from scenes import make_scenario, scene_of
from trust import lanes

from jaxplan.cases import SKY_KINDS, random_scenario
from jaxplan.model.scenario import SearchSettings
from jaxplan.model.status import Status
from jaxplan.planner.goals import find_goals
from jaxplan.search import PLANNERS, Scene, SearchResult, search_batch
from jaxplan.search.lockstep import CALLS, POOL, Call, Kernel, together


def random_problem(seed: int, kind: str, **changes: object) -> tuple[Scene, SearchSettings]:
    scenario = random_scenario(seed, kind)
    return scene_of(scenario, find_goals(scenario)[0]), replace(scenario.search, **changes)


def assert_same(first: SearchResult, second: SearchResult) -> None:
    """To the last bit."""
    assert first.status is second.status
    assert first.queue_expansions == second.queue_expansions
    assert (first.path is None) == (second.path is None)
    if first.path is not None and second.path is not None:
        assert np.array_equal(first.path.attitudes, second.path.attitudes)
        assert np.array_equal(first.path.joints, second.path.joints)
        assert np.array_equal(first.path.edge_costs, second.path.edge_costs)


@pytest.mark.parametrize("scenes", [1, 2, CALLS + 3])
def test_lockstep_gives_the_same_answers_as_one_by_one_in_every_batch_shape(scenes):
    problems = [random_problem(k // 5, SKY_KINDS[k % 5], max_expansions=20) for k in range(scenes)]
    answers = search_batch(*zip(*problems, strict=True))
    assert len(answers) == scenes
    for (scene, settings), answer in zip(problems, answers, strict=True):
        assert_same(answer, PLANNERS["mha"](scene, settings))


def test_every_planner_runs_in_lockstep_with_the_others():
    problems = [
        random_problem(seed, "hard_keep_out", method=method, max_expansions=60)
        for method in PLANNERS
        for seed in range(2)
    ]
    answers = search_batch(*zip(*problems, strict=True))
    assert {answer.status for answer in answers} == {Status.OK, Status.NODE_LIMIT}
    for (scene, settings), answer in zip(problems, answers, strict=True):
        assert_same(answer, PLANNERS[settings.method](scene, settings))


def test_spacecraft_of_different_kinds_may_share_a_batch():
    scenarios = [make_scenario(terminals, 1, turn=(0.5, 0.2, 0.1)) for terminals in (0, 3, 0, 2, 3)]
    scenes = [scene_of(scenario) for scenario in scenarios]
    answers = search_batch(scenes, [scenario.search for scenario in scenarios])
    for scene, answer in zip(scenes, answers, strict=True):
        assert answer.path.joints.shape[1] == 2 * len(scene.mounts)
        assert np.array_equal(answer.path.attitudes[-1], scene.goal_attitude)


def test_a_batch_needs_settings_for_each_scene_and_may_be_empty():
    scene, settings = random_problem(0, "keep_in")
    assert search_batch([], []) == []
    with pytest.raises(ValueError, match="settings: must be one a scene, 2, not 1"):
        search_batch([scene, scene], [settings])


def test_a_time_limit_ends_the_searches_of_a_batch():
    problems = [random_problem(seed, "hard_keep_out", time_limit=1e-9) for seed in (10, 19)]
    assert Status.TIME_LIMIT in {answer.status for answer in search_batch(*zip(*problems, strict=True))}


@pytest.mark.parametrize("abreast", [False, True])
def test_each_call_is_about_its_own_scene_whatever_waits_beside_it(abreast, monkeypatch):
    """Searches that ask different things a different number of times; side by side as on an accelerator."""
    if abreast:
        monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    reach = Kernel(lambda scene, times, gate: times * scene.goal_joints)
    turn = Kernel(lambda scene, gate: scene.goal_attitude[0])

    def search(rounds: int):
        total = np.zeros(4)
        for k in range(rounds):
            total += yield Call(reach, (float(k),))
        return total, (yield Call(turn, ()))

    scenes = [scene_of(make_scenario(2, seed=seed)) for seed in range(4)]
    many = [scenes[k % 4] for k in range(POOL + CALLS + 5)]
    found = together(many, [search(k % 7) for k in range(len(many))])
    for k, (total, row) in enumerate(found):
        rounds = k % 7
        assert np.allclose(total, rounds * (rounds - 1) / 2 * many[k].goal_joints, rtol=1e-14)
        assert np.array_equal(row, many[k].goal_attitude[0])


def test_a_nan_in_one_scene_is_no_path_and_changes_no_other():
    for seed in range(3):
        lanes.searches(3, seed)


def test_a_fault_in_one_search_is_not_hidden():
    scene = scene_of(make_scenario(2))

    def search():
        yield Call(Kernel(lambda scene, gate: scene.goal_joints), ())
        raise RuntimeError("out of order")

    with pytest.raises(RuntimeError, match="out of order"):
        together([scene, scene], [search(), search()])

"""Tuning by the gradient, the numbers it may tune and the bounds it keeps."""

import re
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from builders import make_scenario
from quick import quick_jit

import jaxplan as jp
from jaxplan.cases import paper_case
from jaxplan.derivatives import hold_each
from jaxplan.planner.entry_points import plan_with_fits
from jaxplan.runtime import jit
from jaxplan.runtime.jit import kernel_count
from jaxplan.schema import scenario_to_dict, with_settings
from jaxplan.schema.numbers import find_number, with_numbers
from jaxplan.tuning import descent
from jaxplan.tuning.objectives import OBJECTIVES, make_objective, mean_slope, objective_label
from jaxplan.tuning.parameters import parameters

CASE = paper_case(1)  # the paper's method in 80 s
ARRAYS = replace(
    CASE,
    spacecraft=replace(
        CASE.spacecraft,
        inertia=np.diag([20.0, 25.0, 30.0]),
        torque_limit=np.array([0.2, 0.25, 0.3]),
        wheel_momentum_limit=np.full(3, 12.0),
    ),
    start=replace(
        CASE.start,
        rotation_vector=np.array([0.1, -0.3, 0.2]),
        joints=np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]),
        angular_velocity=np.array([0.001, 0.002, 0.003]),
        joint_rates=0.002 + 0.001 * np.arange(6),
    ),
)
SMALL = make_scenario(1)
SMALL = replace(SMALL, trajectory=replace(SMALL.trajectory, method="paper", duration=30.0))
WEIGHTS = ("trajectory.rate_weight", "trajectory.acceleration_weight")


@pytest.mark.parametrize(
    ("objective", "label"),
    [
        ("peak_acceleration", "peak acceleration (deg/s²)"),
        ("smallest_margin", "\N{MINUS SIGN}smallest margin (deg)"),
        ({"effort": 1.0}, "effort ((deg/s²)² s)"),
        ({"peak_rate": 2.0, "duration": 0.5}, "2 peak rate + 0.5 duration"),
        (jp.measures.roughness, "roughness"),
        (lambda trajectory, scenario: 0.0, "objective"),
    ],
)
def test_an_objective_has_a_label_with_its_unit(objective, label):
    assert objective_label(objective) == label


def test_every_objective_has_a_unit():
    assert all(objective_label(name).endswith(")") for name in OBJECTIVES)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("trajectory.duration_s", 80.0),
        ("keep_out[0].half_angle_deg", 21.0),
        ("spacecraft.terminal[1].mount_deg", 120.0),
        ("spacecraft.rate_limit_deg_s", 3.0),
        ("search.clearance_deg", 0.5),
        ("goal.yaw_limit_deg", 88.0),
        ("start.attitude[1]", -0.3),
        ("start.yaw_rad[1]", 0.2),
        ("start.pitch_rad[0]", 0.4),
        ("start.angular_velocity_rad_s[2]", 0.003),
        ("start.joint_rates_rad_s[3]", 0.005),
        ("spacecraft.torque_limit_nm[1]", 0.25),
        ("spacecraft.wheel_momentum_limit_nms", 12.0),
    ],
)
def test_a_number_is_found_by_its_name_and_replaced(name, value):
    place = find_number(ARRAYS, name)
    assert place.get(ARRAYS) == pytest.approx(value)
    changed = with_numbers(ARRAYS, {place: 0.9 * value})
    assert place.get(changed) == pytest.approx(0.9 * value)
    held = scenario_to_dict(changed)
    for part in re.findall(r"\w+", name):
        held = held[int(part) if part.isdigit() else part]
    np.testing.assert_allclose(held, 0.9 * value, err_msg="as the file has it")
    assert scenario_to_dict(with_numbers(changed, {place: value})) == scenario_to_dict(ARRAYS)


def test_numbers_of_arrays_are_traced_where_they_stand():
    names = ("start.pitch_rad[0]", "spacecraft.torque_limit_nm[1]", "spacecraft.wheel_momentum_limit_nms")
    places = [find_number(ARRAYS, name) for name in names]

    def total(numbers):
        changed = with_numbers(ARRAYS, dict(zip(places, numbers, strict=True)))
        craft = changed.spacecraft
        weights = jnp.arange(1.0, 7.0)
        return (
            weights @ changed.start.joints + jnp.sum(craft.torque_limit) + jnp.sum(craft.wheel_momentum_limit)
        )

    assert jax.grad(total)(jnp.ones(3)).tolist() == [4.0, 1.0, 3.0]  # the first pitch comes after three yaws


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("trajectory.acceleration_wait", "perhaps acceleration_weight is meant"),
        ("keep_out[9].half_angle_deg", "keep_out has"),
        ("keep_out.half_angle_deg", r"write keep_out\[0\]"),
        ("keep_out[0].direction", "depend on each other"),
        ("keep_out[0].direction[1]", "depend on each other"),
        ("goal.targets[0]", "depend on each other"),
        ("spacecraft.inertia_kg_m2", "depend on each other"),
        ("start.attitude", r"has 3 numbers, write attitude\[0\]"),
        ("start.yaw_rad[3]", "has 3 numbers"),
        ("start.joint_rates_rad_s[6]", "has 6 numbers"),
        ("start.yaw_deg[0]", "is held as yaw_rad"),
        ("spacecraft.torque_limit_nm", r"3 numbers that differ, write torque_limit_nm\[0\]"),
        ("spacecraft.terminal[0].rate_limit_deg_s[0]", "is a single number: write no index"),
        ("spacecraft.rate_limit_deg_s[3]", r"has 3 numbers, the last is rate_limit_deg_s\[2\]"),
        ("spacecraft.jerk_limit_deg_s3[1]", "is not set here: give it a value first"),
        ("search.seed", "no single number"),
        ("search[0].clearance_deg", "no table with rows"),
        ("trajectory.", "is no key"),
        ("trajectory.node_tube_deg", "is not set here: give it a value first"),
        ("search.max_expansions", "is a whole number"),
    ],
)
def test_what_is_no_number_is_told_what_there_is(name, said):
    with pytest.raises(KeyError, match=said):
        find_number(ARRAYS, name)


def test_one_axis_of_a_limit_that_all_share_gets_a_number_of_its_own():
    place = find_number(CASE, "spacecraft.rate_limit_deg_s[1]")
    shared = find_number(CASE, "spacecraft.rate_limit_deg_s").get(CASE)
    assert place.get(CASE) == shared
    changed = with_numbers(CASE, {place: 0.5})
    written = scenario_to_dict(changed)["spacecraft"]["rate_limit_deg_s"]
    assert written == pytest.approx([shared, 0.5, shared])
    with pytest.raises(KeyError, match="3 numbers that differ"):
        find_number(changed, "spacecraft.rate_limit_deg_s")

    def squares(number):
        return jnp.sum(with_numbers(CASE, {place: number}).spacecraft.rate_limit ** 2)

    assert jax.grad(squares)(2.0) == pytest.approx(4 * np.deg2rad(1) ** 2)


def test_limits_that_are_not_set_are_no_numbers():
    with pytest.raises(KeyError, match="not set here: give it a value first"):
        find_number(CASE, "spacecraft.torque_limit_nm[0]")


def test_a_mounting_by_vectors_has_no_angle():
    terminal = replace(
        CASE.spacecraft.terminals[0], mount=None, mounting=jp.Mount(yaw_axis=[0, 0, 1], boresight=[1, 0, 0])
    )
    terminals = (terminal, *CASE.spacecraft.terminals[1:])
    mounted = replace(CASE, spacecraft=replace(CASE.spacecraft, terminals=terminals))
    with pytest.raises(KeyError, match="has mount, whose vectors may not change by themselves"):
        find_number(mounted, "spacecraft.terminal[0].mount_deg")


def test_a_word_is_no_number():
    stretched = replace(CASE, trajectory=replace(CASE.trajectory, duration="stretched"))
    with pytest.raises(KeyError, match='is "stretched" here, and no number'):
        find_number(stretched, "trajectory.duration_s")


def test_parameters_begin_where_the_scenario_is_and_keep_their_bounds():
    over = {"trajectory.duration_s": (40.0, 120.0), "trajectory.acceleration_weight": (1e-2, 1e3)}
    over |= {"spacecraft.terminal[0].mount_deg": (-30.0, 60.0)}
    tuned = (*parameters(CASE, over), *parameters(CASE, ("spacecraft.rate_limit_deg_s",)))
    for one in tuned:
        assert float(one.value(one.free())) == pytest.approx(one.first, rel=1e-12, abs=1e-9)
        ends = one.value(jnp.array([-50.0, 50.0]))
        np.testing.assert_allclose(ends, [one.low, one.high], rtol=1e-6)


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({"trajectory.duration_s": (90.0, 120.0)}, "must lie between its bounds 90 and 120"),
        ({"trajectory.duration_s": (10.0, np.inf)}, "must be two finite numbers, the lower one first"),
        ({"trajectory.duration_s": (120.0, 60.0)}, "must be two finite numbers, the lower one first"),
        ({"trajectory.duration_s": 80.0}, "must be two finite numbers"),
        ("trajectory.duration_s", "must be a list of names"),
        ((3,), "must be the name of a number"),
        (("search.clearance_deg",), "settings of the search have no gradient"),
        (("start.angular_velocity_rad_s[0]",), r'give bounds, as in over=\{"start.angular_velocity_rad_s'),
        (("spacecraft.terminal[1].mount_deg",), "mount_deg = 120: may be negative"),
        (
            {"keep_out[0].half_angle_deg": (10.0, 200.0)},
            r"bound 200 of keep_out\[0\].half_angle_deg: must lie in",
        ),
        ((), "nothing to tune"),
    ],
)
def test_senseless_bounds_are_refused_by_name(over, said):
    with pytest.raises(ValueError, match=said):
        parameters(CASE, over)


def test_an_unknown_name_is_a_fault_of_the_scenario_with_the_nearest_one_told():
    for scenarios in (CASE, [CASE, CASE]):
        with pytest.raises(jp.ScenarioError, match="unknown key jerk_wight, perhaps jerk_weight is meant"):
            jp.tune(scenarios, "effort", over=["trajectory.jerk_wight"])


def test_a_call_that_makes_no_sense_is_refused_before_anything_is_planned():
    with pytest.raises(ValueError, match="unknown objective 'speed': must be one of peak_acceleration"):
        jp.tune(CASE, "speed", over=WEIGHTS)
    with pytest.raises(ValueError, match="objective has no weights"):
        jp.tune(CASE, {}, over=WEIGHTS)
    with pytest.raises(ValueError, match=r"objective\['effort'\] = nan: must be a finite number"):
        jp.tune(CASE, {"effort": np.nan}, over=WEIGHTS)
    with pytest.raises(TypeError, match="a name, weights by name or a function, not NoneType"):
        jp.tune(CASE, None, over=WEIGHTS)
    with pytest.raises(TypeError, match="resume must be a Tuning, not dict"):
        jp.tune(CASE, "effort", over=WEIGHTS, resume={})
    with pytest.raises(ValueError, match=r"peak_torque needs spacecraft\.inertia_kg_m2"):
        jp.tune(SMALL, "peak_torque", over=WEIGHTS)
    with pytest.raises(ValueError, match="smallest_margin needs zones"):
        jp.tune(SMALL, "smallest_margin", over=WEIGHTS)
    moving = jp.DirectionPath.through([0.0, 900.0], [[1.0, 0.0, 0.0], [0.96, 0.28, 0.0]])
    zones = [jp.KeepOut(name=name, direction=moving, half_angle=0.1) for name in ("earth", "moon")]
    timed = replace(SMALL, keep_out=zones, trajectory=replace(SMALL.trajectory, duration=60.0))
    with pytest.raises(
        ValueError, match=r"still, and earth and moon move: .* has slopes here is peak_acc"
    ) as e:
        jp.tune(timed, {"effort": 1.0, "smallest_margin": 2.0}, over=WEIGHTS)
    names = str(e.value).rpartition("is ")[2].split(", ")
    assert "effort" in names
    assert not {"peak_torque", "smallest_margin"} & {*names}  # nor an inertia
    weak = replace(SMALL, spacecraft=replace(SMALL.spacecraft, inertia=np.eye(3), torque_limit="little"))
    with pytest.raises(ValueError, match=r"scenarios\[0\]: spacecraft\.torque_limit = 'little': must be"):
        jp.tune(weak, "effort", over=("spacecraft.torque_limit_nm",))
    with pytest.raises(ValueError, match="steps = 0"):
        jp.tune(CASE, "effort", over=WEIGHTS, steps=0)
    with pytest.raises(ValueError, match="no scenarios"):
        jp.tune([], "effort", over=WEIGHTS)
    blocked = replace(CASE, keep_out=(replace(CASE.keep_out[0], half_angle=3.0), *CASE.keep_out[1:]))
    with pytest.raises(ValueError, match=f"{CASE.name} has no plan to begin with: INVALID_START"):
        jp.tune(blocked, "effort", over=WEIGHTS)


@pytest.mark.slow
def test_ready_made_objectives_are_those_of_dense_samples():
    plan = jp.plan(replace(CASE, spacecraft=replace(CASE.spacecraft, inertia=np.diag([5.0, 7.0, 9.0]))))
    t = np.linspace(0, plan.trajectory.duration, 200_001)
    s = plan.trajectory.sample(t)
    inertia = plan.scenario.spacecraft.inertia
    momentum = s.angular_velocity @ inertia
    torque = s.angular_acceleration @ inertia + np.cross(s.angular_velocity, momentum)
    squares = np.sum(s.angular_acceleration**2, axis=1) + np.sum(s.joint_accelerations**2, axis=1)
    expected = {
        "peak_torque": np.abs(torque).max(),
        "effort": np.rad2deg(np.rad2deg(np.trapezoid(squares, t))),
        "smallest_margin": -np.rad2deg(plan.certificate.min_margin),
    }
    asked = {name: OBJECTIVES[name] for name in expected}
    asked["weighted"] = make_objective({"duration": 2.0, "effort": 0.5})
    kernel = quick_jit(lambda curve: {name: one(curve, plan.scenario) for name, one in asked.items()})
    found = {name: float(value) for name, value in kernel(plan.trajectory).items()}
    weighted = found.pop("weighted")
    assert found == pytest.approx(expected, rel=2e-3)
    assert weighted == pytest.approx(160 + 0.5 * found["effort"])


@pytest.mark.slow
def test_tuning_lowers_the_peak_acceleration_and_is_certified_resumable_and_the_same_again():
    whole = jp.tune(CASE, "peak_acceleration", over=WEIGHTS, steps=20, progress=False)
    assert whole.message == ""
    assert whole.plans[0].ok
    assert [row["step"] for row in whole.history] == list(range(21))
    peaks = [
        np.abs(plan.trajectory.sample(np.linspace(0, 80, 20_001)).angular_acceleration).max()
        for plan in (jp.plan(CASE), *whole.plans)
    ]
    assert peaks[1] <= 0.97 * peaks[0]
    assert whole.before == pytest.approx(np.rad2deg(peaks[0]), rel=1e-4)
    assert whole.history[-1]["objective"] == pytest.approx(np.rad2deg(peaks[1]), rel=1e-4)
    assert str(whole).splitlines()[1].split() == ["before", "after"]
    half = jp.tune(CASE, "peak_acceleration", over=WEIGHTS, steps=10, progress=False)
    again = jp.tune(CASE, "peak_acceleration", over=WEIGHTS, steps=10, progress=False, resume=half)
    assert again.history == whole.history
    assert again.numbers == whole.numbers


def test_numbers_without_a_certified_plan_are_never_the_answer():
    over = {"trajectory.duration_s": (5.0, 60.0)}
    call = {"over": over, "optimizer": optax.adam(1.0), "progress": False}
    first = jp.tune(SMALL, "duration", steps=3, **call)
    assert first.label == "duration (s)"
    again = jp.tune(SMALL, "duration", steps=1, resume=first, **call)
    for result in (first, again):
        assert "no certified plans" in result.message
        assert all(plan.ok for plan in result.plans)
        assert result.objective == pytest.approx(result.numbers["trajectory.duration_s"])
        assert str(result).splitlines()[3].split()[-1] == f"{result.objective:.6g}"


def test_what_is_kept_back_of_the_torque_is_tuned_as_its_scaling_says():
    """Of a motion that is stretched to its torque the time is one over the root of what is left of that."""
    reserve = "robust.torque_reserve_percent"
    craft = replace(SMALL.spacecraft, inertia=np.array([2000.0, 2500.0, 3000.0]), torque_limit=0.5)
    scenario = replace(SMALL, spacecraft=craft, robust=jp.Robust(torque_reserve=20.0))
    scenario = replace(scenario, trajectory=replace(scenario.trajectory, duration="stretched"))
    result = jp.tune(scenario, "duration", over={reserve: (5.0, 40.0)}, steps=3, progress=False)
    assert result.plans[0].ok
    found = result.numbers[reserve]
    assert 5.0 < found < 19.0
    assert result.scenario.robust.torque_reserve == pytest.approx(found)
    assert result.objective == pytest.approx(result.before * np.sqrt(0.8 / (1 - found / 100)), rel=1e-6)


DURATION = "trajectory.duration_s"


def test_steps_far_too_large_lead_back_to_the_beginning_and_can_be_gone_on_from():
    """Beyond the optimum, at 40 s, the first step is carried to the other end, at 60 s, and stays there."""

    def off(trajectory, scenario):
        return (jp.measures.duration(trajectory) - 40.0) ** 2

    call = {"over": {DURATION: (20.0, 60.0)}, "optimizer": optax.sgd(1e3), "progress": False}
    result = jp.tune(SMALL, off, steps=2, **call)
    assert "are not the best ones, so these are those of step 0" in result.message
    assert "nothing lower than at the beginning was found: try smaller steps" in result.message
    assert result.before == result.objective  # both are of plans, and the numbers are the same
    before, after = str(result).splitlines()[3].split()[-2:]
    assert before == after
    assert result.numbers[DURATION] == pytest.approx(30.0)
    assert result.scenario.trajectory.duration == result.plans[0].trajectory.duration
    assert result.scenario.trajectory.duration == pytest.approx(30.0)
    assert result.objective == pytest.approx(100.0)
    assert [row["objective"] for row in result.history] == pytest.approx([100.0, 400.0, 400.0], abs=1e-3)
    again = jp.tune(SMALL, off, steps=1, resume=result, **call)
    assert again.history[:-1] == result.history  # the descent goes on from where it was, at 60 s
    assert again.history[-1][DURATION] == pytest.approx(60.0)
    assert again.objective == result.objective


def test_the_best_numbers_on_the_way_are_the_answer_where_the_objective_misleads():
    def uphill(trajectory, scenario):
        duration = jp.measures.duration(trajectory)
        return 2 * jax.lax.stop_gradient(duration) - duration  # the slope has the wrong sign

    def rippled(trajectory, scenario):
        duration = jp.measures.duration(trajectory)
        return duration + 3 * jnp.sin(9 * duration)

    call = {"over": {DURATION: (25.0, 60.0)}, "progress": False}
    worse = jp.tune(SMALL, uphill, steps=3, **call)
    assert worse.history[-1]["objective"] > 31
    assert worse.objective == pytest.approx(30.0)
    noisy = jp.tune(SMALL, rippled, steps=3, optimizer=optax.sgd(0.002), **call)
    values = [row["objective"] for row in noisy.history]
    assert values[1] < values[0] - 2 < values[3] - 4
    assert noisy.objective == pytest.approx(values[1], rel=1e-6)
    assert noisy.numbers[DURATION] == noisy.history[1][DURATION]
    assert noisy.message == "the last numbers are not the best ones, so these are those of step 1"


def test_only_the_same_call_is_gone_on_with():
    call = {"over": WEIGHTS, "steps": 1, "progress": False}
    first = jp.tune(SMALL, "effort", **call)
    longer = replace(SMALL, trajectory=replace(SMALL.trajectory, duration=60.0))
    for changed, said in (
        ({"scenarios": longer}, "scenarios"),
        ({"scenarios": [SMALL, longer]}, "scenarios"),
        ({"over": WEIGHTS[:1]}, "over"),
        ({"over": dict.fromkeys(WEIGHTS, (0.1, 9.0))}, "over"),
        ({"objective": "duration"}, "objective"),
        ({"optimizer": optax.sgd(0.1, momentum=0.9)}, "optimizer"),
    ):
        asked = {"scenarios": SMALL, "objective": "effort", **call, "resume": first, **changed}
        with pytest.raises(ValueError, match=rf"resume is the result of another call: .*{said}"):
            jp.tune(**asked)


@pytest.mark.parametrize(
    ("objective", "said"),
    [
        (lambda trajectory, scenario: None, "number, not NoneType"),
        (lambda trajectory, scenario: jnp.ones(3), r"single number, not an array of shape \(3,\)"),
    ],
)
def test_an_objective_that_returns_no_single_number_is_refused_by_name(objective, said):
    with pytest.raises(TypeError, match=f"objective: must return a .*{said}"):
        jp.tune(CASE, objective, over=["trajectory.rate_weight"], steps=1, progress=False)


@pytest.mark.parametrize(
    "objective",
    [
        lambda trajectory, scenario: float(jp.measures.effort(trajectory)),
        lambda trajectory, scenario: 1.0 if jp.measures.effort(trajectory) > 0 else 2.0,
        lambda trajectory, scenario: np.sum(np.asarray(trajectory.breaks)),
        lambda trajectory, scenario: jnp.sum(trajectory.breaks[trajectory.breaks > 1]),
    ],
    ids=["float", "if", "numpy", "mask"],
)
def test_an_objective_that_asks_for_traced_values_is_told_to_use_jax(objective):
    with pytest.raises(TypeError, match=r"objective: must be made of jax\.numpy and jp\.measures alone"):
        jp.tune(CASE, objective, over=["trajectory.rate_weight"], steps=1, progress=False)


def test_an_objective_that_is_no_number_ends_the_descent_before_it():
    over = {"trajectory.duration_s": (20.0, 60.0)}
    with pytest.raises(ValueError, match="not finite at the numbers to begin with"):
        jp.tune(SMALL, lambda t, s: jp.measures.duration(t) * jnp.nan, over=over, progress=False)
    result = jp.tune(
        SMALL,
        lambda t, s: jnp.sqrt(jp.measures.duration(t) - 28.0),
        over=over,
        steps=6,
        progress=False,
    )
    assert "beyond, the objective is not finite" in result.message
    assert result.numbers["trajectory.duration_s"] > 28.0
    assert np.isfinite(result.objective)


def test_numbers_that_change_nothing_are_named():
    over = [WEIGHTS[0], "trajectory.duration_s"]
    result = jp.tune(SMALL, "duration", over=over, steps=1, progress=False)
    assert "without influence on the objective: trajectory.rate_weight" in result.message


def test_where_the_gradient_is_zero_to_begin_with_it_stops_and_says_so():
    result = jp.tune(SMALL, "duration", over=WEIGHTS[:1], steps=9, progress=False)
    assert len(result.history) == 1
    words = "no step was made: the objective's gradient in trajectory.rate_weight is zero at the beginning"
    assert result.message == words


@pytest.mark.parametrize("fails", [False, True])
def test_a_rehearsal_compiles_the_kernel_and_changes_no_slope(fails, monkeypatch):
    monkeypatch.setattr(jit, "_MOST_KERNELS", np.inf)  # none is forgotten meanwhile
    plan = jp.plan(SMALL, progress=False)
    tuned = parameters(SMALL, WEIGHTS)
    aim = make_objective("effort")

    def find():
        if fails:
            raise ValueError("nothing is held")
        return jp.hold(plan), plan.scenario

    def pairs():
        yield jp.hold(plan), plan.scenario

    with jax.enable_x64(True):
        free = jnp.array([one.free() for one in tuned])
    elsewhere = mean_slope(pairs(), aim, tuned, free + 0.5, often=False)
    expected = elsewhere(free)
    count = kernel_count()
    value, slope = mean_slope(pairs(), aim, tuned, free, often=False, rehearsal=find)(free)
    assert (value, kernel_count()) == (expected[0], count)
    np.testing.assert_array_equal(slope, expected[1])


def test_slopes_in_numbers_that_no_goal_depends_on_leave_the_goal_as_it_is():
    """With a limit of rates beside it the goal is followed, and the first slope is the same."""
    plan = jp.plan(SMALL, progress=False)
    aim, held = make_objective("effort"), jp.hold(plan)
    found = []
    for names in (["trajectory.duration_s"], ["trajectory.duration_s", "spacecraft.rate_limit_deg_s"]):
        tuned = parameters(SMALL, names)
        free = jnp.array([one.free() for one in tuned])
        value, slope = mean_slope([(held, plan.scenario)], aim, tuned, free, often=False)(free)
        found.append((value, slope[0]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-8)
    assert found[0][1] != 0


def test_fits_of_plans_are_held_as_fits_made_anew_are():
    given = replace(SMALL, trajectory=replace(SMALL.trajectory, method="global"))
    shortest = replace(given, trajectory=replace(given.trajectory, duration="minimum"))
    plans, fits = plan_with_fits([given, SMALL, shortest], progress=False)
    assert all(plan.ok for plan in plans)
    assert fits[2] is None  # it is fitted anew near itself
    for plan, fit in zip(plans[:2], fits[:2], strict=True):
        assert fit.trajectory is plan.trajectory
        (held,) = hold_each([plan], nodes=32, known=[fit])
        (anew,) = hold_each([plan], nodes=32)
        one, other = map(jax.tree.leaves, (held, anew))
        for left, right in zip(one, other, strict=True):
            np.testing.assert_allclose(left, right, rtol=1e-6, atol=1e-9)


def test_what_a_scenario_tells_by_itself_is_refused_before_it_is_planned(monkeypatch):
    def never(*_, **__):
        raise AssertionError("this takes long, and is not needed")

    monkeypatch.setattr(descent._Descent, "_plans_to_begin_with", never)
    scenario = with_settings(
        jp.paper_case(1), {"trajectory.duration_s": "minimum", "trajectory.method": "global"}
    )
    craft, rates = scenario.spacecraft, {"angular_velocity": np.array([0.0, 0.0, 1e-3])}
    spinning = replace(scenario, start=replace(scenario.start, **rates))
    wish = jp.Wish(device=craft.device_names[-1], direction=np.array([1.0, 0.0, 0.0]))
    first = {craft.device_names[0]: np.array([1.0, 0.0, 0.0])}
    wished = replace(scenario, goal=jp.Targets.of(first, prefer=(wish,)))
    over = ["trajectory.jerk_weight"]
    for odd, words in (
        (spinning, "has no derivatives: it is a shortest motion with rates at its ends"),
        (wished, "has no derivatives: its goal is one of least time with wishes"),
        (replace(wished, start=spinning.start), "for 2 reasons"),
    ):
        with pytest.raises(ValueError, match=words):
            jp.tune(odd, "effort", over=over)


def test_an_optimizer_of_ones_own_may_look_at_values_and_count_its_calls():
    scene, seen = jp.paper_case(2), []

    def update(gradients, state, parameters=None):
        seen.append(float(gradients[0]))
        return -0.01 * gradients, state

    own = optax.GradientTransformation(lambda parameters: optax.EmptyState(), update)
    for optimizer in (own, optax.adam(lambda count: 0.1 if count < 2 else 0.01)):
        found = jp.tune(
            scene,
            "effort",
            over=["trajectory.duration_s"],
            optimizer=optimizer,
            steps=3,
            progress=False,
        )
        assert len(found.history) == 4
    assert len(set(seen)) == 3


def test_a_fault_of_an_optimizer_itself_is_raised_as_it_is():
    def update(gradients, state, parameters=None):
        raise TypeError("no such thing")

    broken = optax.GradientTransformation(lambda parameters: optax.EmptyState(), update)
    with pytest.raises(TypeError, match="no such thing"):
        jp.tune(
            jp.paper_case(2),
            "effort",
            over=["trajectory.duration_s"],
            optimizer=broken,
            steps=1,
            progress=False,
        )

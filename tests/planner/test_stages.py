"""Plans of spacecraft whose gimbals push back: torque and momentum at dense samples, by plain numpy."""

from dataclasses import replace

import numpy as np
import pytest
from builders import make_observer, make_scenario
from scipy.spatial.transform import Rotation
from stages import exchanged, momentum, torque, with_stages
from wheels import INERTIA, instants, numbers, random_wheels, wheels, with_wheels

import jaxplan as jp
from jaxplan.trajectory.problem import FitProblem

SAMPLES = 100_000  # in all of the plans of one test
SIZE = 1.0  # kg m^2 of a stage, of which whole spacecraft here have 20 to 30
DURATIONS = ("minimum", "stretched", 120.0)


def wheeled(terminals, duration, allocation="pseudo_inverse", size=SIZE, seed=0, **settings):
    scenario = with_wheels(
        random_wheels(4, seed=terminals), allocation, seed, terminals, duration=duration, **settings
    )
    return replace(scenario, spacecraft=with_stages(scenario.spacecraft, size, terminals))


def thrusting(duration):
    """A spacecraft with a drive and limits of torque and momentum of the whole."""
    scenario = make_scenario(craft=with_stages(replace(make_observer(), inertia=INERTIA), SIZE, 5))
    limits = {"torque_limit": np.array([0.1, 0.08, 0.12]), "wheel_momentum_limit": np.array([0.6, 0.7, 0.5])}
    craft = replace(scenario.spacecraft, **limits)
    return replace(scenario, spacecraft=craft, trajectory=replace(scenario.trajectory, duration=duration))


def shares(plan, count):
    """Largest shares of limits by numpy, by quantity, at so many samples of a plan."""
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    time = instants(trajectory, count)
    if not craft.wheels:
        samples = trajectory.sample(np.minimum(time, trajectory.duration))
        own = samples.angular_velocity, samples.joints, samples.joint_rates
        return {
            "torque": np.abs(torque(trajectory, craft, time) / craft.torque_limit).max(),
            "wheel_momentum": np.abs(momentum(craft, *own) / craft.wheel_momentum_limit).max(),
        }
    axes, most, full, stored = numbers(craft)
    given, held = exchanged(trajectory, craft, time)
    if craft.allocation == "minimax":
        pairs = np.array([np.cross(a, b) for k, a in enumerate(axes) for b in axes[k + 1 :]])
        reach = np.abs(pairs @ axes.T)
        return {
            "wheel_torques": np.abs(given @ pairs.T / (reach @ most)).max(),
            "wheel_momenta": np.abs(held @ pairs.T / (reach @ full)).max(),
        }
    share = np.linalg.pinv(axes.T)
    return {
        "wheel_torques": np.abs(given @ share.T / most).max(),
        "wheel_momenta": np.abs((stored + (held - stored @ axes) @ share.T) / full).max(),
    }


WORDS = {"wheel_torques": "wheel torque", "wheel_momenta": "wheel momentum"}  # of one of the wheels


@pytest.fixture(scope="module")
def plans():
    scenarios = [wheeled(terminals, duration) for terminals in (1, 3) for duration in DURATIONS]
    scenarios += [thrusting(duration) for duration in DURATIONS]
    scenarios.append(wheeled(2, "minimum", "minimax"))
    scenarios.append(wheeled(2, "stretched", method="paper"))
    found = jp.plan_batch(scenarios, progress=False)
    assert all(plan.ok for plan in found), [plan.message for plan in found]
    return found


def test_limits_are_kept_and_what_is_proved_is_near_what_is_met(plans):
    for plan in plans:
        for name, most in shares(plan, SAMPLES // len(plans)).items():
            bound = plan.certificate.peaks[name]
            assert most <= 1 + 1e-9, (plan.scenario.trajectory.duration, name)
            assert most <= bound * (1 + 1e-9)
            assert bound <= 1.01 * most


def test_what_is_just_tighter_is_broken_and_refused(plans):
    for plan in plans:
        craft = plan.scenario.spacecraft
        for name, most in shares(plan, 4001).items():
            factor = most * (1 - 1e-4)
            if craft.wheels:
                key = {"wheel_torques": "torque", "wheel_momenta": "momentum"}[name]
                array = tuple(replace(one, **{key: getattr(one, key) * factor}) for one in craft.wheels)
                tight = replace(craft, wheels=array)
            else:
                tight = replace(craft, **{f"{name}_limit": getattr(craft, f"{name}_limit") * factor})
            refused = jp.certify(replace(plan, scenario=replace(plan.scenario, spacecraft=tight)))
            assert not refused.certified
            words = WORDS.get(name, name.replace("_", " "))
            assert any(words in fault for fault in refused.faults), refused.faults


def test_an_inertia_that_is_changed_in_place_is_proved_anew(plans):
    plan = plans[0]
    craft, moments = plan.scenario.spacecraft, np.full(3, 1e-3)
    terminals = (replace(craft.terminals[0], pitch_inertia=moments), *craft.terminals[1:])
    own = replace(plan, scenario=replace(plan.scenario, spacecraft=replace(craft, terminals=terminals)))
    before = jp.certify(own).peaks
    moments *= 100
    assert jp.certify(own).peaks != before


def test_no_plan_is_quicker_than_its_bound_and_shortest_motions_use_what_there_is(plans):
    for plan in plans:
        assert plan.duration_bound <= plan.trajectory.duration
        names = shares(plan, 101)
        if plan.scenario.trajectory.duration != 120.0:
            assert max(plan.certificate.peaks[name] for name in (*names, "joint_rates")) > 0.99


@pytest.mark.slow
def test_light_stages_may_be_left_out_of_all_but_the_last_search(monkeypatch):
    """The motions found are as short as when every search knows of them, and keep the limits with them."""
    scenarios = [wheeled(count, "minimum", size=0.05, seed=count) for count in (1, 2, 3)]
    quick = jp.plan_batch(scenarios, progress=False)
    taken = []
    monkeypatch.setattr(FitProblem, "stiff", property(lambda own: taken.append(own) or own))
    thorough = jp.plan_batch(scenarios, progress=False)
    assert taken
    for one, other in zip(quick, thorough, strict=True):
        assert one.ok, one.message
        assert other.ok, other.message
        assert one.trajectory.duration <= 1.002 * other.trajectory.duration
        assert max(np.max(share) for share in shares(one, 20_000).values()) <= 1 + 1e-9


def test_heavy_stages_are_known_to_every_search():
    problem = FitProblem(
        attitudes=np.stack([np.eye(3), Rotation.from_rotvec([0.0, 0.6, 0.8]).as_matrix()]),
        joints=np.zeros((2, 2)),
        turns=np.array([[0.0, 0.6, 0.8]]),
        fractions=None,
        rates=np.zeros((2, 5)),
        spacecraft=wheeled(1, "minimum", size=0.05).spacecraft,
        cones=None,
        settings=jp.TrajectorySettings(),
    )
    assert problem.stiff.spacecraft.stages is None
    np.testing.assert_array_equal(problem.stiff.spacecraft.whole_inertia, problem.spacecraft.whole_inertia)
    heavy = replace(problem, spacecraft=wheeled(1, "minimum", size=2.0).spacecraft)
    assert heavy.stiff is heavy


def test_what_is_left_out_without_the_inertia_of_stages_breaks_limits():
    scenario = wheeled(3, "minimum", size=1.5)
    craft = scenario.spacecraft
    light = replace(
        craft,
        terminals=tuple(replace(one, yaw_inertia=None, pitch_inertia=None) for one in craft.terminals),
    )
    plan = jp.plan(replace(scenario, spacecraft=light), progress=False)
    told = jp.certify(replace(plan, scenario=scenario))
    assert not told.certified
    assert told.peaks["wheel_torques"] > 1.1


def test_measures_tell_of_stages_and_files_keep_them(plans, tmp_path):
    plan = plans[0]
    craft, time = plan.scenario.spacecraft, np.linspace(0, plan.trajectory.duration, 60)
    axes, _, _, stored = numbers(craft)
    given, held = exchanged(plan.trajectory, craft, time)
    share = np.linalg.pinv(axes.T)
    found = jp.measures.wheel_torques(plan.trajectory, craft, time)
    np.testing.assert_allclose(found, given @ share.T, atol=1e-7)
    found = jp.measures.wheel_momenta(plan.trajectory, craft, time)
    np.testing.assert_allclose(found, stored + (held - stored @ axes) @ share.T, atol=1e-12)
    most = np.abs(exchanged(plan.trajectory, craft, instants(plan.trajectory, 8001))[0]).max()
    assert float(jp.measures.peak_torque(plan.trajectory, craft)) == pytest.approx(most, rel=1e-4)
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    assert jp.certify(again).peaks == plan.certificate.peaks


def test_rates_at_the_ends_count_in_the_total_momentum():
    scenario = wheeled(2, 80.0)
    start, goal = (
        replace(
            end,
            angular_velocity=side * np.array([0.01, -0.008, 0.006]),
            joint_rates=side * np.array([0.01, -0.02, 0.01, 0.005]),
        )
        for end, side in ((scenario.start, 1.0), (scenario.goal, -0.5))
    )
    plan = jp.plan(replace(scenario, start=start, goal=goal), progress=False)
    for name, most in shares(plan, 8001).items():
        assert most <= plan.certificate.peaks[name] * (1 + 1e-9)
        assert plan.certificate.peaks[name] <= 1.01 * most


def test_what_wheels_hold_at_a_goal_in_motion_counts_what_gimbals_carry_there():
    """A wheel that just holds it, by numpy, is enough; of one that just does not, the message tells it."""
    scenario = wheeled(2, 80.0)
    start = replace(scenario.start, angular_velocity=np.zeros(3), joint_rates=np.zeros(4))
    goal = replace(
        scenario.goal,
        angular_velocity=np.array([0.0, 0.01, 0.0]),
        joint_rates=np.array([-0.02, 0.01, 0.015, -0.005]),
    )
    craft = replace(scenario.spacecraft, wheels=wheels(np.eye(3), 1.0, 5.0))
    scenario = replace(scenario, spacecraft=craft, start=start, goal=goal)
    carried = momentum(craft, goal.angular_velocity[None], goal.joints[None], goal.joint_rates[None])[0]
    alone = INERTIA @ goal.angular_velocity
    assert abs(carried[1]) < 0.95 * abs(alone[1])
    for share in (1.01, 0.99):
        limits = [5.0, share * abs(carried[1]), 5.0]
        own = replace(scenario, spacecraft=replace(craft, wheels=wheels(np.eye(3), 1.0, limits)))
        plan = jp.plan(own, throw=False, progress=False)
        assert plan.ok is (share > 1), plan.message
    assert f'wheel "wheel-2" would hold {abs(carried[1]):.4g} N m s' in plan.message

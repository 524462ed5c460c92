"""Plans of spacecraft with reaction wheels: what each wheel gives and holds, at dense samples by numpy."""

from dataclasses import replace

import numpy as np
import pytest
from wheels import (
    by_envelope,
    by_pseudo_inverse,
    exchanged,
    instants,
    least_shared,
    numbers,
    random_wheels,
    wheels,
    with_wheels,
)

import jaxplan as jp
from jaxplan.planner.validity import start_breaches

SAMPLES = 100_000  # in all of the plans of one test
DURATIONS = ("minimum", "stretched", 120.0)
COUNTS = (3, 4, 5, 6)
MEASURES = (jp.measures.wheel_torques, jp.measures.wheel_momenta)
NAMES = ("wheel_torques", "wheel_momenta")


@pytest.fixture(scope="module", params=["pseudo_inverse", "minimax"])
def plans(request):
    """Plans of each allocation, with 3 to 6 wheels about random axes that hold something at the start."""
    scenarios = [
        with_wheels(random_wheels(count, seed=count + 10 * number), request.param, duration=duration)
        for count in COUNTS
        for number, duration in enumerate(DURATIONS)
    ]
    found = jp.plan_batch(scenarios, progress=False)
    assert all(plan.ok for plan in found), [plan.message for plan in found]
    return found


def shares(plan, count):
    """Largest shares of the limits of torque and momentum at so many samples of a plan."""
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    stated = by_pseudo_inverse if craft.allocation == "pseudo_inverse" else by_envelope
    return [np.abs(own).max() for own in stated(trajectory, craft, instants(trajectory, count))]


def test_every_wheel_keeps_its_limits_and_what_is_proved_is_near_what_is_met(plans):
    some = SAMPLES // len(plans)
    for plan in plans:
        for name, most in zip(NAMES, shares(plan, some), strict=True):
            bound = plan.certificate.peaks[name]
            assert most <= 1 + 1e-9, (plan.scenario.spacecraft.allocation, name)
            assert most <= bound + 1e-6  # the samples' accelerations are differences, which err by some 1e-7
            assert bound <= 1.01 * most
    near = [max(plan.certificate.peaks[name] for name in NAMES) for plan in plans[:: len(DURATIONS)]]
    assert min(near) > 0.999  # a shortest motion has a wheel at its limit


def test_what_is_just_tighter_is_broken_and_refused(plans):
    for plan in plans[::2]:  # of each count and duration some
        craft = plan.scenario.spacecraft
        for most, limit in zip(shares(plan, 4001), ("torque", "momentum"), strict=True):
            tight = replace(
                craft,
                wheels=tuple(
                    replace(one, **{limit: getattr(one, limit) * most * (1 - 1e-4)}) for one in craft.wheels
                ),
            )
            own = replace(plan, scenario=replace(plan.scenario, spacecraft=tight))
            assert max(shares(own, 4001)) > 1
            refused = jp.certify(own)
            assert not refused.certified
            assert any(fault.startswith(f"wheel {limit} of ") for fault in refused.faults), refused.faults


def test_a_linear_program_finds_wheel_torques_and_momenta_within_limits(plans):
    if plans[0].scenario.spacecraft.allocation != "minimax":
        return
    for plan in plans:
        craft, time = plan.scenario.spacecraft, instants(plan.trajectory, 400)[::8]
        axes, torque, momentum, _ = numbers(craft)
        for vectors, bound in zip(exchanged(plan.trajectory, craft, time), (torque, momentum), strict=True):
            for vector in vectors:
                assert least_shared(axes, bound, vector)[0] <= 1 + 1e-9


def test_the_duration_is_above_its_bound_and_shortest_motions_use_the_wheels_more(plans):
    for shortest, stretched, given in zip(*(plans[k :: len(DURATIONS)] for k in range(3)), strict=True):
        assert given.trajectory.duration == 120.0
        for plan in (shortest, stretched, given):
            assert plan.duration_bound <= plan.trajectory.duration
        assert shortest.duration_bound > 0.3 * shortest.trajectory.duration


def test_empty_wheels_along_the_body_axes_give_no_gyroscopic_torque():
    box = wheels(np.eye(3), [0.05, 0.06, 0.04], [0.9, 1.0, 1.1])
    plan = jp.plan(with_wheels(box, duration="minimum"), progress=False)
    time = instants(plan.trajectory, 2001)
    samples = plan.trajectory.sample(np.minimum(time, plan.trajectory.duration))
    inertia = plan.scenario.spacecraft.inertia
    turned = samples.angular_acceleration @ inertia / [0.05, 0.06, 0.04]
    held = samples.angular_velocity @ inertia / [0.9, 1.0, 1.1]
    for name, values in zip(NAMES, (turned, held), strict=True):
        assert plan.certificate.peaks[name] == pytest.approx(np.abs(values).max(), rel=2e-3)
    assert plan.certificate.peaks["wheel_torques"] == pytest.approx(1, abs=1e-4)


def test_a_turn_that_fills_a_wheel_however_slow_is_refused_with_the_reason():
    held = wheels(np.eye(3), 1.0, [2.0, 0.2, 0.2], [1.9, 0.0, 0.0])
    for duration in ("stretched", "minimum", 200.0):
        plan = jp.plan(with_wheels(held, duration=duration), throw=False, progress=False)
        assert plan.status is jp.Status.LIMITS_TOO_TIGHT
        for word in ("slowing down does not help", "stored_nms", "momentum"):
            assert word in plan.message, plan.message
        assert "inertia" not in plan.message  # of a body at rest, which carries nothing
        assert plan.trajectory is None  # there is none to show
        at_speed = with_wheels(held, duration=duration)
        begun = replace(at_speed.start, angular_velocity=np.array([0.0, 0.002, 0.0]))
        plan = jp.plan(replace(at_speed, start=begun), throw=False, progress=False)
        assert plan.status is jp.Status.LIMITS_TOO_TIGHT
        assert plan.trajectory is None or plan.trajectory.duration < 1e4
        named = "spacecraft.inertia_kg_m2 and the rates of [start]"  # which the momentum follows from, too
        assert named in plan.message or "slowing down" not in plan.message, plan.message


def test_the_reason_names_the_full_wheels_with_what_they_would_hold():
    """Of each wheel at the goal, by numpy; on the way of the wheel that fills there, and where."""
    held = wheels(np.eye(3), 1.0, [2.0, 0.2, 0.2], [1.9, 0.0, 0.0])
    scene = with_wheels(held)
    plan = jp.plan(scene, throw=False, progress=False)
    left = plan.goal.attitude.T @ scene.start.attitude @ [1.9, 0.0, 0.0]
    told = [
        f'wheel "wheel-{k}" would hold {abs(left[k - 1]):.4g} N m s, of 0.2 N m s at most'
        for k in (2, 3)
        if abs(left[k - 1]) > 0.2
    ]
    assert len(told) == 2
    assert f"at the goal, however slowly it is reached, {' and '.join(told)}, so" in plan.message
    assert "[robust]" not in plan.message
    reserve = replace(scene, robust=jp.Robust(momentum_reserve=3.0))
    plan = jp.plan(reserve, throw=False, progress=False)
    assert "of 0.194 N m s at most" in plan.message
    assert "or lower [robust] momentum_reserve_percent = 3, which is taken off" in plan.message
    begun = jp.GivenState(rotation_vector=np.zeros(3), joints=scene.start.joints)
    goal = replace(begun, rotation_vector=np.array([3.1, 0.0, 0.0]))
    filled = wheels(
        np.eye(3), 1.0, [9.0, 2.0, 0.5], [0.0, 1.9, 0.0]
    )  # about y, and opposite after half a turn
    for method in ("global", "paper"):
        half = replace(with_wheels(filled, method=method), start=begun, goal=goal)
        half = replace(half, keep_out=(), keep_in=())
        plan = jp.plan(half, throw=False, progress=False)
        assert plan.status is jp.Status.LIMITS_TOO_TIGHT
        words = (
            'turned about slowly, wheel "wheel-3" would hold 1.9 N m s with the body turned by 90 deg, of 0.5'
        )
        assert words in plan.message, plan.message


def test_wheels_that_are_full_against_each_other_leave_no_motion():
    """Whatever the body has of momentum fills one of them, but for rounding, and but for what is left."""
    axes = np.array([[0.8, 0.0, 0.6], [0.0, 0.8, 0.6], [-0.8, 0.0, 0.6], [0.0, -0.8, 0.6]])
    for momentum in (5.0, 0.7, 12.3):
        for share in (1.0, 1 - 1e-9, 1 - 1e-3) if momentum == 5.0 else (1.0, 1 - 1e-9):
            held = wheels(axes, 0.2, momentum, share * momentum * np.array([1, -1, 1, -1]))
            for duration in ("minimum", "stretched", 100.0):
                plan = jp.plan(with_wheels(held, duration=duration), throw=False, progress=False)
                if share < 1 - 1e-6:
                    assert plan.ok or "duration_s to" in plan.message, plan.message
                    continue
                assert plan.status is jp.Status.LIMITS_TOO_TIGHT
                assert plan.trajectory is None
                for k in (1, 2, 3, 4):
                    words = f'wheel "wheel-{k}" would hold {momentum:.4g} N m s at the '
                    assert words in plan.message, plan.message
                assert "slowing down does not help" in plan.message


def test_a_start_that_only_the_reserve_overfills_says_so():
    for allocation, owner in (("pseudo_inverse", 'wheel "wheel-1"'), ("minimax", "the array across ")):
        scene = with_wheels(wheels(np.eye(3), 1.0, 8.0, [-7.7, 0.0, 0.0]), allocation)
        assert start_breaches(scene) == ()
        assert start_breaches(replace(scene, robust=jp.Robust(momentum_reserve=3.75))) == ()  # to rounding
        kept = replace(scene, robust=jp.Robust(momentum_reserve=5.0))
        plan = jp.plan(kept, throw=False, progress=False)
        assert plan.status is jp.Status.INVALID_START
        assert plan.message.startswith(owner)
        for words in (
            "7.7 N m s at the start, of 7.6 N m s at most",
            "reserve_percent = 5 leaves of 8 N m s",
        ):
            assert words in plan.message, plan.message
        assert "[robust]" in plan.message
        assert "without it that is enough" in plan.message


def test_what_wheels_hold_at_the_end_is_what_they_store_for_the_way_back(plans):
    """There and back the total momentum is the same, so that the way back ends as the way there began."""
    plan = plans[len(DURATIONS)]
    scenario, craft = plan.scenario, plan.scenario.spacecraft
    time = instants(plan.trajectory, 500)
    axes, *limits, _ = numbers(craft)
    found = (measure(plan.trajectory, craft, time) for measure in MEASURES)
    if craft.allocation != "pseudo_inverse":
        with pytest.raises(ValueError, match="has no wheels"):
            jp.measures.wheel_torques(plan.trajectory, replace(craft, wheels=()), 0.0)
        vectors = exchanged(plan.trajectory, craft, time)
        for own, vector, limit in zip(found, vectors, limits, strict=True):
            np.testing.assert_allclose(own @ axes, vector, atol=1e-7)  # by differences
            for shared, whole in zip(own[::20], vector[::20], strict=True):
                least = least_shared(axes, limit, whole)[0]
                assert np.max(np.abs(shared) / limit) == pytest.approx(least, abs=1e-6)  # likewise
        return
    for own, shares_, limit in zip(
        found, by_pseudo_inverse(plan.trajectory, craft, time), limits, strict=True
    ):
        np.testing.assert_allclose(own, shares_ * limit, atol=1e-7)
    held = jp.measures.wheel_momenta(plan.trajectory, craft, plan.trajectory.duration)
    array = tuple(replace(one, stored=float(own)) for one, own in zip(craft.wheels, held, strict=True))
    back = replace(
        scenario, spacecraft=replace(craft, wheels=array), start=scenario.goal, goal=scenario.start
    )
    back = jp.plan(back, progress=False)
    end = jp.measures.wheel_momenta(back.trajectory, back.scenario.spacecraft, back.trajectory.duration)
    np.testing.assert_allclose(end, [wheel.stored for wheel in craft.wheels], atol=1e-7)


def test_the_papers_method_stretches_to_the_limits_of_wheels_and_files_keep_them(tmp_path):
    scenario = with_wheels(random_wheels(4, seed=31), method="paper", duration="stretched")
    plan = jp.plan(scenario, progress=False)
    assert max(plan.certificate.peaks[name] for name in NAMES) == pytest.approx(1, abs=1e-3)
    plan.save(tmp_path / "plan.json")
    again = jp.load_plan(tmp_path / "plan.json")
    assert jp.certify(again).peaks == plan.certificate.peaks


def test_rates_at_the_ends_count_in_the_total_momentum():
    array = random_wheels(4, seed=21)
    scenario = with_wheels(array, duration=80.0)
    start, goal = (
        replace(end, angular_velocity=side * np.array([0.01, -0.008, 0.006]))
        for end, side in ((scenario.start, 1.0), (scenario.goal, -0.5))
    )
    plan = jp.plan(replace(scenario, start=start, goal=goal), progress=False)
    for name, most in zip(NAMES, shares(plan, 8001), strict=True):
        assert most <= plan.certificate.peaks[name] * (1 + 1e-9)
        assert plan.certificate.peaks[name] <= 1.01 * most

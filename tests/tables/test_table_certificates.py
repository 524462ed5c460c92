"""What is proved of tables, beside motions between rows by scipy and dense samples of them."""

from dataclasses import replace

import numpy as np
import pytest
from exports import EPOCH, flown_plan
from reference import assert_each, random_units, unit
from scipy.spatial.transform import Rotation, Slerp
from wheels import INERTIA, random_wheels

import jaxplan as jp
from jaxplan.tables import INTERPOLATIONS, sampled
from jaxplan.tables.interpolation import reading
from jaxplan.tables.table import HERMITE, LINEAR, RATE, RODRIGUES, SLERP

DURATION = 30.0
DENSE = np.linspace(0, DURATION, 20_001)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


def table_of(plan: jp.Plan, step: float) -> jp.AttitudeTable:
    """Rows of a plan at multiples of a step."""
    times = np.arange(0, DURATION + step / 2, step)
    values = plan.trajectory.sample(np.minimum(times, DURATION))
    return jp.AttitudeTable(
        times=times,
        quaternions=Rotation.from_matrix(values.attitude).as_quat(scalar_first=True),
        angular_velocity=values.angular_velocity,
        joints=values.joints,
        joint_rates=values.joint_rates,
        joint_names=plan.scenario.spacecraft.joint_names,
    )


def rotations(quaternions: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternions, scalar_first=True)


def by_scipy(table: jp.AttitudeTable, how: str, times: np.ndarray) -> Rotation:
    """The attitude between rows, written with scipy's rotations."""
    rows = rotations(table.quaternions)
    if how == SLERP:
        return Slerp(table.times, rows)(times)
    own = np.clip(np.searchsorted(table.times, times, side="right") - 1, 0, len(table.times) - 2)
    share = ((times - table.times[own]) / np.diff(table.times)[own])[:, None]
    if how == LINEAR:
        q = table.quaternions
        return rotations(q[own] + share * (q[own + 1] - q[own]))
    if how == RATE:
        elapsed = (times - table.times[own])[:, None]
        return rows[own] * Rotation.from_rotvec(elapsed * table.angular_velocity[own])
    assert how == RODRIGUES
    first, second = rows[own].as_mrp(), rows[own + 1].as_mrp()
    far = np.linalg.norm(second - first, axis=1) > 1
    second[far] = -second[far] / np.sum(second[far] ** 2, axis=1, keepdims=True)
    return Rotation.from_mrp(first + share * (second - first))


@pytest.mark.parametrize("how", [SLERP, LINEAR, RATE, RODRIGUES])
@pytest.mark.parametrize("step", [0.5, 7.5])
def test_readers_motions_are_those_of_scipy(plan, how, step):
    table = table_of(plan, step)
    quaternions, _ = sampled(table, how, DENSE)
    off = rotations(quaternions).inv() * by_scipy(table, how, DENSE)
    assert_each(off.magnitude(), "<", 1e-7)


def test_hermite_keeps_attitudes_and_rates_of_both_rows(plan):
    table = table_of(plan, 2.5)
    small, inner = 1e-5, table.times[1:-1]
    for side in (-1, 1):
        near, _ = sampled(table, HERMITE, inner + side * small)
        at, _ = sampled(table, HERMITE, inner)
        turn = (rotations(at).inv() * rotations(near)).as_rotvec() * side / small
        np.testing.assert_allclose(turn, table.angular_velocity[1:-1], atol=1e-4)
    _, joints = sampled(table, HERMITE, table.times)
    np.testing.assert_allclose(joints, table.joints, atol=1e-12)


def random_table(seed: int, turn: float) -> jp.AttitudeTable:
    """Rows whose neighbours are up to an angle apart, at uneven times."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.2, 3.0, 12)
    axes = rng.normal(size=(12, 3))
    turns = unit(axes) * rng.uniform(0, turn, (12, 1))
    rows = [Rotation.random(rng=rng)]
    for each in turns:
        rows.append(rows[-1] * Rotation.from_rotvec(each))
    return jp.AttitudeTable(
        times=np.append(0, np.cumsum(steps)),
        quaternions=Rotation.concatenate(rows).as_quat(scalar_first=True),
        angular_velocity=rng.normal(size=(13, 3)) * 0.3,
    )


@pytest.mark.parametrize("how", INTERPOLATIONS)
@pytest.mark.parametrize("turn", [0.05, 1.0, 2.9])
def test_pieces_that_are_proved_are_as_close_to_the_motion_as_told(how, turn):
    for seed in range(4):
        table = random_table(seed, turn)
        found = reading(table, how, 1e-4, 1e-3)
        times = np.linspace(0, table.duration, 4001)[:-1]
        own = np.searchsorted(found.breaks, times, side="right") - 1
        elapsed = times - found.breaks[own]
        width = np.diff(found.breaks)[own]
        x = 2 * elapsed / width - 1
        values = np.einsum(
            "kpc,kp->kc",
            found.coefficients[own],
            np.polynomial.legendre.legvander(x, found.coefficients.shape[1] - 1),
        )
        half = Rotation.from_rotvec(elapsed[:, None] * found.chart_rate[own] / 2)
        eta = Rotation.from_rotvec(values - elapsed[:, None] * found.chart_rate[own])
        pieces = Rotation.from_matrix(found.chart_attitude[own]) * half * eta * half
        truth_there = rotations(sampled(table, how, times)[0])
        assert_each((pieces.inv() * truth_there).magnitude(), "<=", found.off + 1e-7)
        after = rotations(sampled(table, how, times + 1e-6 * width)[0])
        speed = (truth_there.inv() * after).as_rotvec() / (1e-6 * width)[:, None]
        if how != HERMITE:
            inside = (x < 0.99) & (np.linalg.norm(speed, axis=1) < 100)
            apart = np.linalg.norm(speed - found.chart_rate[own], axis=1)[inside]
            assert_each(apart, "<=", found.rate_off * 1.001 + 1e-4)


def scene_around(plan: jp.Plan, clearance_deg: float) -> jp.Scenario:
    """The plan's scene with a wide zone for each device, which that misses by an angle."""
    craft, dense = plan.scenario.spacecraft, plan.trajectory.sample(DENSE)
    tracks = np.asarray(craft.boresights(dense.attitude, dense.joints))
    axes = random_units(np.random.default_rng(3), 200)
    zones = []
    for number, name in enumerate(craft.device_names):
        nearest = np.arccos(np.clip(tracks[::20, number] @ axes.T, -1, 1)).min(axis=0)
        axis = axes[np.argmax(nearest)]
        least = np.arccos(np.clip(tracks[:, number] @ axis, -1, 1)).min()
        half = float(least - np.deg2rad(clearance_deg + number))
        zones.append(jp.KeepOut(name=f"beside {name}", direction=axis, half_angle=half, devices=(name,)))
    return replace(plan.scenario, keep_out=tuple(zones))


def least_margin(scene: jp.Scenario, table: jp.AttitudeTable, how: str, known: tuple[str, ...]) -> float:
    """The least margin of devices to their zones over dense samples of a reader's motion, rad."""
    times = np.linspace(table.times[0], table.times[-1], 20_001)
    quaternions, joints = sampled(table, how, times)
    joints = np.zeros((len(times), scene.spacecraft.joint_count)) if joints is None else joints
    beams = np.asarray(scene.spacecraft.boresights(rotations(quaternions).as_matrix(), joints))
    names = scene.spacecraft.device_names
    return min(
        float(
            (
                np.arccos(np.clip(beams[:, names.index(device)] @ zone.direction, -1, 1)) - zone.half_angle
            ).min()
        )
        for zone in scene.keep_out
        for device in zone.devices
        if device in known
    )


@pytest.mark.parametrize("how", INTERPOLATIONS)
@pytest.mark.parametrize("step", [0.1, 1.5, 3.0])
def test_the_certificates_margin_is_below_the_motions_and_close_to_it(plan, how, step):
    scene, table = scene_around(plan, 8.0), table_of(plan, step)
    found = jp.certify_table(table, how, scene)
    seen = least_margin(scene, table, how, scene.spacecraft.device_names)
    assert found.min_margin <= seen + 1e-9
    assert found.min_margin >= seen - np.deg2rad(0.05)
    assert found.certified == (seen >= 0)
    assert found.interpolation == how
    assert found.numbers == len(table.times) * 16


@pytest.mark.parametrize("how", INTERPOLATIONS)
def test_peaks_of_rates_are_above_those_of_differences_and_close(plan, how):
    scene, table = scene_around(plan, 8.0), table_of(plan, 1.5)
    found = jp.certify_table(table, how, scene)
    times = np.linspace(0, DURATION, 60_001)
    attitudes = rotations(sampled(table, how, times)[0])
    turn = (attitudes[:-1].inv() * attitudes[1:]).as_rotvec() / np.diff(times)[:, None]
    within = np.diff(np.searchsorted(table.times, times, side="right")) == 0  # no jump of attitude between
    seen = np.abs(turn[within]).max() / scene.spacecraft.rate_limit
    assert found.peaks["angular_velocity"] >= seen - 1e-6
    assert found.peaks["angular_velocity"] <= seen * 1.02 + 1e-6
    if how == HERMITE:
        assert "angular_acceleration" in found.peaks
        assert found.rate_jump < 1e-8
    else:
        assert "angular_acceleration" not in found.peaks
        assert "angular acceleration" in " ".join(found.left_out)
    if how == SLERP:
        steps = (rotations(table.quaternions[:-1]).inv() * rotations(table.quaternions[1:])).as_rotvec() / 1.5
        jumps = np.linalg.norm(np.diff(steps, axis=0), axis=1)
        assert found.rate_jump == pytest.approx(jumps.max(), abs=1e-9)
        assert found.rate_jump_time == pytest.approx(table.times[1 + np.argmax(jumps)])
    assert (found.attitude_jump > 1e-4) == (how == RATE)


def test_a_table_without_joints_is_proved_for_what_is_fixed_to_the_body(plan):
    scene, table = scene_around(plan, 8.0), table_of(plan, 0.5)
    bare = replace(table, joints=None, joint_rates=None, joint_names=())
    found = jp.certify_table(bare, SLERP, scene)
    seen = least_margin(scene, bare, SLERP, ("instrument-0",))
    assert found.certified
    assert seen - np.deg2rad(0.05) <= found.min_margin <= seen
    assert found.worst_device == "instrument-0"
    told = " ".join(found.left_out)
    assert "terminal-0, terminal-1: the table has no joints" in told
    assert "beside terminal-0, beside terminal-1" in told
    assert not {"yaw", "pitch", "joint_rates"} & set(found.peaks)


def test_zones_that_move_are_held_against_the_tables_own_times(plan):
    scene, table = scene_around(plan, 8.0), table_of(plan, 0.5)
    axis = scene.keep_out[-1].direction
    times = np.linspace(0, 200, 41)
    turning = np.array([0.0, 0.004, 0.002])
    samples = Rotation.from_rotvec(np.outer(times, turning)).apply(axis)
    moving = jp.DirectionPath(times=times, samples=samples, slopes=np.cross(turning, samples))
    zone = replace(scene.keep_out[-1], direction=moving)
    scene = replace(scene, keep_out=(zone,), epoch=np.datetime64(EPOCH, "ns"))
    for late in (0.0, 40.0, 120.0):
        shifted = replace(table, epoch=scene.epoch + np.timedelta64(int(late * 1e9), "ns"))
        found = jp.certify_table(shifted, SLERP, scene)
        beams = np.asarray(
            scene.spacecraft.boresights(
                rotations(sampled(table, SLERP, DENSE)[0]).as_matrix(), sampled(table, SLERP, DENSE)[1]
            )
        )[:, -1]
        axes = np.stack([moving.at(time) for time in DENSE + late])
        seen = (np.arccos(np.clip(np.sum(beams * axes, axis=1), -1, 1)) - zone.half_angle).min()
        assert seen - np.deg2rad(0.05) <= found.min_margin <= seen + 1e-9
        assert late <= found.worst_time <= late + DURATION
    early = replace(table, epoch=scene.epoch - np.timedelta64(5, "s"))
    with pytest.raises(ValueError, match="begins 5 s before the scene"):
        jp.certify_table(early, SLERP, scene)
    beyond = replace(table, epoch=scene.epoch + np.timedelta64(180, "s"))
    with pytest.raises(ValueError, match="moves and is known until 200 s"):
        jp.certify_table(beyond, SLERP, scene)


def test_how_far_the_last_row_is_off_its_targets_is_told_as_far_as_it_is_known(plan):
    scene, table = scene_around(plan, 8.0), table_of(plan, 0.5)
    craft = scene.spacecraft
    values = plan.trajectory.sample(np.array([DURATION]))
    beams = np.asarray(craft.boresights(values.attitude, values.joints))[0]
    aside = Rotation.from_rotvec(0.01 * unit(np.cross(beams[-1], [0.1, 0.2, 0.9]))).apply(beams[-1])
    goal = jp.Targets(devices=("terminal-0", "instrument-0"), directions=np.stack([beams[0], aside]))
    scene = replace(scene, goal=goal)
    assert jp.certify_table(table, SLERP, scene).goal_off == pytest.approx(0.01, abs=1e-9)
    elsewhere = jp.certify_table(table, SLERP, replace(scene, goal=scene.start))
    assert elsewhere.goal_off > 0.5
    assert elsewhere.misses_goal
    assert elsewhere.summary()["misses_goal"]
    assert elsewhere.certified == jp.certify_table(table, SLERP, scene).certified
    assert str(elsewhere).splitlines()[1].startswith("misses the goal")
    bare = replace(table, joints=None, joint_rates=None, joint_names=())
    assert jp.certify_table(bare, SLERP, scene).goal_off == pytest.approx(0.01, abs=1e-9)
    of_terminal = jp.Targets(devices=("terminal-0",), directions=beams[:1])
    assert jp.certify_table(bare, SLERP, replace(scene, goal=of_terminal)).goal_off is None
    short = jp.DirectionPath(  # known for a part of the table alone
        times=np.array([0.0, 10.0]), samples=np.stack([beams[0], aside]), slopes=np.zeros((2, 3))
    )
    moving = jp.Targets(devices=("instrument-0",), directions=(short,))
    found = jp.certify_table(table, SLERP, replace(scene, goal=moving))
    assert found.certified
    assert found.goal_off is None


def test_long_tables_are_proved_in_parts_as_in_one(plan, monkeypatch):
    scene, table = scene_around(plan, 8.0), table_of(plan, 0.1)
    whole = jp.certify_table(table, SLERP, scene)
    monkeypatch.setattr("jaxplan.tables.proof._INTERVALS_PER_BATCH", 37)
    parts = jp.certify_table(table, SLERP, scene)
    assert parts.min_margin == pytest.approx(whole.min_margin, abs=np.deg2rad(0.01))
    assert parts.worst_time == pytest.approx(whole.worst_time, abs=0.5)
    assert parts.peaks["angular_velocity"] == pytest.approx(whole.peaks["angular_velocity"], rel=1e-6)


@pytest.mark.parametrize("together", [7, 500])
def test_jumps_of_attitude_are_told_of_all_rows_wherever_parts_join(plan, monkeypatch, together):
    scene, table = scene_around(plan, 8.0), table_of(plan, 1.5)
    monkeypatch.setattr("jaxplan.tables.proof._INTERVALS_PER_BATCH", together)
    rows = rotations(table.quaternions)
    reached = rows[:-1] * Rotation.from_rotvec(1.5 * table.angular_velocity[:-1])
    missed = (reached.inv() * rows[1:]).magnitude()
    assert jp.certify_table(table, RATE, scene).attitude_jump == pytest.approx(missed.max(), rel=1e-9)


@pytest.mark.parametrize("how", [SLERP, HERMITE])
def test_nothing_is_claimed_of_wheels(plan, how):
    scene = scene_around(plan, 8.0)
    scene = replace(scene, spacecraft=replace(scene.spacecraft, inertia=INERTIA, wheels=random_wheels(4, 1)))
    found = jp.certify_table(table_of(plan, 1.5), how, scene)
    assert found.certified
    assert not any("wheel" in name for name in found.peaks)
    assert "what wheels hold at a row depends on all that came before" in " ".join(found.left_out)


def mutants(table: jp.AttitudeTable, scene: jp.Scenario) -> dict[str, jp.AttitudeTable]:
    """Tables that fly and of which most break something, by what was done to them."""
    q, joints, found = table.quaternions, table.joints, {}
    axis, boresight = scene.keep_out[-1].direction, scene.spacecraft.instruments[0].boresight
    for row in range(4, 58, 3):  # one row has the instrument in its zone
        there = rotations(q[row]).apply(boresight)
        turn = Rotation.align_vectors([axis], [there])[0].as_rotvec() * 0.95
        into = q.copy()
        into[row] = (Rotation.from_rotvec(turn) * rotations(q[row])).as_quat(scalar_first=True)
        found[f"row {row} into a zone"] = replace(table, quaternions=into)
    for row in range(5, 57, 4):
        swung = joints.copy()
        swung[row, row % 4] += 9.5
        found[f"joint {row % 4} out of range in row {row}"] = replace(table, joints=swung)
    for factor in (0.004, 0.008, 0.012, 0.3):
        found[f"{factor} of the time"] = replace(table, times=factor * table.times)
    for order in ([1, 2, 3, 0], [0, 2, 1, 3], [0, 3, 2, 1], [3, 0, 1, 2], [0, 1, 3, 2], [2, 1, 0, 3]):
        found[f"components {order}"] = replace(table, quaternions=q[:, order])
    for number, vector in enumerate(np.vstack([np.eye(3), -np.eye(3)])):
        other = (Rotation.from_rotvec(1.2 * vector) * rotations(q)).as_quat(scalar_first=True)
        found[f"inertial frame {number}"] = replace(table, quaternions=other)
        other = (rotations(q) * Rotation.from_rotvec(1.2 * vector)).as_quat(scalar_first=True)
        found[f"body frame {number}"] = replace(table, quaternions=other)
    found["inverted"] = replace(table, quaternions=q * [1.0, -1.0, -1.0, -1.0])
    found["joints of each other"] = replace(table, joints=joints[:, ::-1])
    found["degrees for radians"] = replace(table, joints=np.rad2deg(joints))
    names = ("times", "quaternions", "angular_velocity", "joints", "joint_rates")
    for first, gap in ((2, 24), (10, 20), (20, 30), (30, 20), (5, 50)):
        kept = np.r_[0:first, first + gap : len(q)]
        found[f"{gap} rows dropped"] = replace(table, **{name: getattr(table, name)[kept] for name in names})
    for here, there in ((4, 50), (12, 40), (20, 30), (8, 33), (2, 58)):
        swapped = np.arange(len(q))
        swapped[[here, there]] = there, here
        found[f"rows {here} and {there} swapped"] = replace(table, quaternions=q[swapped])
    return found


def breaks_something(scene: jp.Scenario, table: jp.AttitudeTable) -> bool:
    """Whether dense samples of a table are in a zone, beyond a range, or too fast."""
    craft = scene.spacecraft
    if least_margin(scene, table, SLERP, craft.device_names) < 0:
        return True
    rows, steps = rotations(table.quaternions), np.diff(table.times)[:, None]
    rates = np.abs((rows[:-1].inv() * rows[1:]).as_rotvec() / steps).max() / craft.rate_limit
    joint_rates = (np.abs(np.diff(table.joints, axis=0) / steps) / craft.joint_rate_limits).max()
    low, high = craft.joint_ranges.T
    return bool(rates > 1 or joint_rates > 1 or np.any(table.joints < low) or np.any(table.joints > high))


def test_of_tables_broken_on_purpose_exactly_those_that_break_something_are_refused(plan):
    scene, table = scene_around(plan, 0.3), table_of(plan, 0.5)
    assert jp.certify_table(table, SLERP, scene).certified
    tables = mutants(table, scene)
    broken = {name for name, one in tables.items() if breaks_something(scene, one)}
    refused = {name for name, one in tables.items() if not jp.certify_table(one, SLERP, scene).certified}
    assert refused == broken
    assert len(broken) >= 50


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (
            lambda table, scene: jp.certify_table(table, "spline", scene),
            "interpolation = 'spline': must be one of",
        ),
        (
            lambda table, scene: jp.certify_table(replace(table, angular_velocity=None), HERMITE, scene),
            "has no angular velocities",
        ),
        (
            lambda table, scene: jp.certify_table(
                replace(
                    table, joints=table.joints[:, :2], joint_rates=None, joint_names=table.joint_names[:2]
                ),
                SLERP,
                scene,
            ),
            "has no column of terminal-0 pitch",
        ),
    ],
)
def test_what_cannot_be_held_against_a_scene_is_told(plan, call, told):
    with pytest.raises(ValueError, match=told):
        call(table_of(plan, 1.0), plan.scenario)

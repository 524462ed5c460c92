"""The nodes of least energy, against random changes of them and minima that scipy finds by itself."""

from dataclasses import replace

import numpy as np
import pytest
from passing import LINKS, LOW, MINE, SUN, Aim, Orbit, deg, observer, relay, relay_zones, satellite, site
from reference import angle, boresights, random_units, unit
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.directions import DirectionPath, as_path
from jaxplan.model.tabulation import tabulate
from jaxplan.timeline.least_energy import LeastMotion, Nodes, Wanted
from jaxplan.timeline.pursuit import Pursuit

TIMES = np.linspace(200.0, 320.0, 7)
SITE, FRIEND = site(LOW, 260.0, 1.0), satellite(Orbit(900.0, 80.0, 0.0, 30.0), LOW)
DOWN = LOW.frame(200.0) @ np.diag([1.0, -1, -1])
AHEAD = MINE.frame(200.0) @ Rotation.from_rotvec([0.1, -0.05, 0.2]).as_matrix()
SLEW, WEIGHTS = 30.0, (1.0, 3.0)
CLOSE = 1.01  # times the least energy
ALONG = SITE.at(TIMES)
ACROSS = unit(np.cross([0.3, 0.5, 0.8], ALONG))
LEVEL = np.stack([ACROSS, np.cross(ALONG, ACROSS), ALONG], axis=2)  # the telescope to the site, at no roll
TOWARD = [aim.at(TIMES) for aim in LINKS.values()]


def searching(craft, aims, zones=(), free=(), **wanted):
    """The search for aims, that comes from a state."""
    targets = jp.Targets.of({name: aim.path() for name, aim in aims.items()}) if aims else None
    given = {"attitude": DOWN, "joints": np.zeros(craft.joint_count), "slew_time": SLEW} | wanted
    return LeastMotion(Pursuit.of(craft, tabulate(tuple(zones), (), craft), targets), Wanted(**given), free)


def solved(search, guess=DOWN, joints=None) -> Nodes:
    rest = search.wanted.joints if joints is None else joints
    return search.solve(TIMES, np.tile(guess, (len(TIMES), 1, 1)), rest)


def residuals(attitudes, joints, attitude, rest):
    """What has the energy as half its square: rates and accelerations of all, and the way to the first."""
    step = TIMES[1] - TIMES[0]
    turns = Rotation.from_matrix(np.swapaxes(attitudes[:-1], 1, 2) @ attitudes[1:]).as_rotvec()
    rates = np.concatenate([turns, np.diff(joints, axis=0)], axis=1) / step
    bends = np.diff(rates, axis=0) / step
    away = np.concatenate([Rotation.from_matrix(attitude.T @ attitudes[0]).as_rotvec(), joints[0] - rest])
    weighed = zip(
        (step * WEIGHTS[0], step * WEIGHTS[1], WEIGHTS[0] / SLEW), (rates, bends, away), strict=True
    )
    return np.concatenate([np.sqrt(weight) * part.ravel() for weight, part in weighed])


def energy(attitudes, joints, attitude, rest):
    """The energy of nodes."""
    return np.sum(residuals(attitudes, joints, attitude, rest) ** 2) / 2


def least(function, *firsts):
    """The least half of a sum of squares that scipy finds from some first guesses."""
    return min(least_squares(function, np.ravel(first), xtol=1e-10, ftol=1e-10).cost for first in firsts)


def rolled(roll):
    """Attitudes (k, 3, 3) whose z is toward the site, rolled about it by angles (k,)."""
    return LEVEL @ Rotation.from_rotvec(np.multiply.outer(roll, [0.0, 0.0, 1.0])).as_matrix()


def angles_to(attitudes):
    """Yaws and pitches (k, 2n) of the relay's terminals that point at their neighbours."""
    yaws, pitches = [], []
    for mount, toward in zip(deg(0, 180, -90, 90), TOWARD, strict=True):
        seen = np.einsum("kji,kj->ki", attitudes, toward)
        seen = Rotation.from_euler("z", -mount).apply(seen)
        yaws.append(np.arctan2(seen[:, 1], seen[:, 0]))
        pitches.append(np.arcsin(seen[:, 2]))
    return np.stack([*yaws, *pitches], axis=1)


def test_the_roll_about_a_telescopes_target_is_as_calm_as_scipy_finds_it():
    craft = observer()
    found = solved(searching(craft, {"telescope": SITE}))

    def price(roll):
        return residuals(rolled(roll), np.zeros((len(TIMES), 3)), DOWN, np.zeros(3))

    expected = least(price, *(np.full(len(TIMES), first) for first in (0.0, 2.0, 4.0)))
    own = energy(found.attitudes, found.joints, DOWN, np.zeros(3))
    assert expected * (1 - 1e-6) <= own <= CLOSE * expected


def test_the_platform_under_four_terminals_moves_as_little_as_scipy_finds():
    craft, search = relay(), searching(relay(), LINKS, attitude=AHEAD, joints=np.zeros(8))
    found = solved(search, AHEAD)

    def price(turns):
        attitudes = AHEAD @ Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix()
        return residuals(attitudes, angles_to(attitudes), AHEAD, np.zeros(8))

    expected = least(price, np.zeros((len(TIMES), 3)))
    own = energy(found.attitudes, found.joints, AHEAD, np.zeros(8))
    assert expected * (1 - 1e-6) <= own <= CLOSE * expected
    np.testing.assert_allclose(found.joints, angles_to(found.attitudes), rtol=0, atol=1e-7)
    assert np.all(np.abs(found.joints) < craft.joint_ranges[:, 1])


@pytest.mark.parametrize("size", [0.3, 0.03, 0.003])
def test_no_random_change_of_the_nodes_has_less_energy(size):
    search = searching(relay(), LINKS, attitude=AHEAD, joints=np.zeros(8))
    found = solved(search, AHEAD)
    own, rng = energy(found.attitudes, found.joints, AHEAD, np.zeros(8)), np.random.default_rng(3)
    for number in range(60):
        each = rng.normal(size=(1 if number % 2 else len(TIMES), 3)) * size
        attitudes = found.attitudes @ Rotation.from_rotvec(each + np.zeros((len(TIMES), 3))).as_matrix()
        assert energy(attitudes, angles_to(attitudes), AHEAD, np.zeros(8)) > own / CLOSE


def test_targets_are_met_at_all_nodes():
    craft, aims = observer(), {"telescope": SITE, "antenna": FRIEND}
    found = solved(searching(craft, aims))
    seen = boresights(craft, found.attitudes, found.joints)
    for name, aim in aims.items():
        off = angle(seen[:, craft.device_names.index(name)], aim.path().at(TIMES))
        assert np.max(off) < 1e-11


def test_two_instruments_leave_nothing_to_choose():
    craft = observer()
    truth = rolled(np.linspace(0.0, 0.4, len(TIMES)))
    camera = DirectionPath.through(TIMES, truth @ craft.instruments[1].boresight)
    targets = jp.Targets.of({"telescope": SITE.path(), "camera": camera})
    own = Pursuit.of(craft, tabulate((), (), craft), targets)
    wanted = Wanted(attitude=DOWN, joints=np.zeros(3), slew_time=SLEW)
    found = LeastMotion(own, wanted).solve(
        TIMES, truth @ Rotation.from_rotvec([0.1, 0, 0.1]).as_matrix(), np.zeros(3)
    )
    np.testing.assert_allclose(found.attitudes, truth, rtol=0, atol=1e-9)


def test_a_zone_is_kept_at_all_nodes_with_some_room():
    # it lies where the camera would look without it, halfway through
    craft = observer()
    camera = craft.device_names.index("camera")
    free = solved(searching(craft, {"telescope": SITE}))
    middle = boresights(craft, free.attitudes, free.joints)[3, camera]
    zone = jp.KeepOut(name="moon", direction=middle, half_angle=deg(4), devices=("camera",))
    search = searching(craft, {"telescope": SITE}, [zone])
    found = solved(search)
    margin = angle(boresights(craft, found.attitudes, found.joints)[:, camera], middle) - deg(4)
    assert np.min(margin) > deg(0.04)
    np.testing.assert_array_equal(search.broken(found), 0)
    assert np.max(np.abs(search.broken(free))) > deg(3)


def test_a_zone_that_moves_is_kept_where_it_is_at_each_node():
    craft, earth = relay(), relay_zones()[1]
    search = searching(craft, LINKS, [earth], attitude=AHEAD, joints=np.zeros(8))
    found = solved(search, AHEAD)
    seen = boresights(craft, found.attitudes, found.joints)
    margin = np.min(angle(seen, -unit(MINE.position(TIMES))[:, None]), axis=1) - earth.half_angle
    assert np.min(margin) > 0
    np.testing.assert_array_equal(search.broken(found), 0)


def test_ranges_of_joints_are_kept_with_some_room():
    # without the limit the aft terminal would yaw and pitch beyond it
    craft = relay()
    before = AHEAD @ Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix()
    free = solved(searching(craft, LINKS, attitude=before, joints=np.zeros(8)), before)
    most = np.max(np.abs(free.joints[:, 1]))
    tight = replace(
        craft,
        terminals=tuple(
            replace(one, yaw_limit=float(most - deg(5))) if one.name == "aft" else one
            for one in craft.terminals
        ),
    )
    search = searching(tight, LINKS, attitude=before, joints=np.zeros(8))
    found = solved(search, before)
    assert np.max(np.abs(found.joints[:, 1])) < most - deg(5.04)
    np.testing.assert_array_equal(search.broken(found), 0)
    ends = np.concatenate([found.joints - tight.joint_ranges[:, 0], tight.joint_ranges[:, 1] - found.joints])
    assert np.min(ends) > 0


def test_what_cannot_be_kept_is_told_by_how_far_it_is_broken():
    craft = observer()
    zone = jp.KeepOut(name="site", direction=SITE.path(), half_angle=deg(6), devices=("telescope",))
    search = searching(craft, {"telescope": SITE}, [zone])
    np.testing.assert_allclose(search.broken(solved(search)), deg(6), rtol=1e-9)


def test_a_wish_is_weighed_against_the_energy_as_scipy_weighs_it():
    craft, array = observer(), 1
    drive = 2  # its joint
    search = searching(craft, {"telescope": SITE}, free=(drive,), wishes=((array, as_path(SUN)),))
    found = solved(search)
    step = TIMES[1] - TIMES[0]

    def missed(attitudes, joints):
        beam = boresights(craft, attitudes, joints)[:, array]
        return np.sqrt(0.1 * step * WEIGHTS[0]) * np.ravel(beam - SUN)

    def price(unknown):
        attitudes, joints = rolled(unknown[: len(TIMES)]), np.zeros((len(TIMES), 3))
        joints[:, drive] = unknown[len(TIMES) :]
        return worth(attitudes, joints)

    def worth(attitudes, joints):
        moving = residuals(attitudes, joints, DOWN, np.zeros(3))
        return np.concatenate([moving, missed(attitudes, joints)])

    expected = least(price, *(np.repeat([first, 0.0], len(TIMES)) for first in (0.0, 1.5, 3.0, 4.5)))
    assert np.sum(worth(found.attitudes, found.joints) ** 2) / 2 <= 1.02 * expected
    free = solved(searching(craft, {"telescope": SITE}))
    before, after = (angle(boresights(craft, n.attitudes, n.joints)[:, array], SUN) for n in (free, found))
    assert np.max(after) < np.min(before)


def test_joints_of_devices_without_a_target_or_a_wish_stay():
    found = solved(searching(observer(), {"telescope": SITE}), joints=np.array([0.3, -0.2, 0.7]))
    np.testing.assert_array_equal(found.joints, np.tile([0.3, -0.2, 0.7], (len(TIMES), 1)))


def test_without_targets_and_zones_nothing_moves():
    search = searching(relay(), {}, attitude=AHEAD, joints=np.zeros(8))
    found = solved(search, AHEAD)
    np.testing.assert_allclose(found.attitudes, np.tile(AHEAD, (len(TIMES), 1, 1)), rtol=0, atol=1e-9)
    np.testing.assert_array_equal(found.joints, 0)


def test_a_spacecraft_without_targets_moves_out_of_the_way_of_a_zone():
    # a zone comes along and passes over where the telescope looks
    craft = observer()
    ahead = DOWN[:, 2]
    across = unit(np.cross(ahead, random_units(np.random.default_rng(1))))

    def passing(time):
        far = np.deg2rad(0.5) * (np.asarray(time) - 260.0)
        return np.cos(far)[:, None] * ahead + np.sin(far)[:, None] * across

    zone = jp.KeepOut(
        name="passer", direction=Aim(passing).path(700.0), half_angle=deg(8), devices=("telescope",)
    )
    search = searching(craft, {}, [zone])
    found = solved(search)
    margin = angle(found.attitudes[:, :, 2], passing(TIMES)) - deg(8)
    assert np.min(margin) > 0
    np.testing.assert_array_equal(search.broken(found), 0)

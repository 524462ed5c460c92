"""What targets ask of attitudes and joints while they are followed."""

import numpy as np
import pytest
from passing import LINKS, LOW, MINE, SUN, Aim, Orbit, deg, observer, relay, relay_zones, satellite, site
from reference import angle, boresights, unit
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.model.constraints import Constraints
from jaxplan.model.directions import DirectionPath
from jaxplan.model.tabulation import tabulate
from jaxplan.timeline.pursuit import Pursuit

TIMES = np.linspace(200.0, 320.0, 9)
SITE, FRIEND = site(LOW, 260.0, 1.0), satellite(Orbit(900.0, 80.0, 0.0, 30.0), LOW)


def rows(craft, *zones) -> Constraints:
    return tabulate(tuple(zones), (), craft)


def pursuit(craft, zones=(), **aims) -> Pursuit:
    """The pursuit of aims, of paths, or of directions that stand still."""
    given = {name: aim.path() if isinstance(aim, Aim) else aim for name, aim in aims.items()}
    return Pursuit.of(craft, rows(craft, *zones), jp.Targets.of(given) if given else None)


def random_attitudes(seed):
    return Rotation.random(len(TIMES), rng=np.random.default_rng(seed)).as_matrix()


def down(time, rng, most=0.2):
    """Attitudes (k, 3, 3) whose z looks at the Earth, but for some turn."""
    base = np.stack([LOW.frame(t) @ np.diag([1.0, -1, -1]) for t in time])
    return base @ Rotation.from_rotvec(rng.uniform(-most, most, (len(time), 3))).as_matrix()


@pytest.mark.parametrize(
    "aims",
    [
        {"telescope": SITE},
        {"telescope": SITE, "camera": FRIEND},
        {"array": SUN},
        {"antenna": FRIEND, "telescope": SITE, "array": SUN},
    ],
    ids=lambda aims: "+".join(aims),
)
def test_the_slopes_of_what_targets_ask_are_those_of_differences(aims):
    own = pursuit(observer(), **aims)
    attitudes, step = random_attitudes(1), 1e-6
    value, slope = own.residuals(attitudes, TIMES)
    assert value.shape == (len(TIMES), own.equations)
    for axis in range(3):
        turn = Rotation.from_rotvec(step * np.eye(3)[axis])
        ahead = own.residuals(attitudes @ turn.as_matrix(), TIMES)[0]
        behind = own.residuals(attitudes @ turn.inv().as_matrix(), TIMES)[0]
        np.testing.assert_allclose(slope[..., axis], (ahead - behind) / (2 * step), rtol=0, atol=1e-9)


def test_terminals_ask_nothing_of_the_attitude():
    own = pursuit(relay(), **LINKS)
    attitudes = random_attitudes(2)
    assert own.equations == 0
    np.testing.assert_array_equal(own.meeting(attitudes, TIMES), attitudes)
    value, slope = own.residuals(attitudes, TIMES)
    assert value.shape == (len(TIMES), 0)
    assert slope.shape == (len(TIMES), 0, 3)


@pytest.mark.parametrize(
    "aims",
    [{"telescope": SITE}, {"telescope": SITE, "array": SUN}, {"telescope": SITE, "antenna": FRIEND}],
    ids=lambda aims: "+".join(aims),
)
def test_all_devices_point_at_their_targets_where_these_are_met(aims):
    craft, own = observer(), pursuit(observer(), **aims)
    met = own.meeting(down(TIMES, np.random.default_rng(3)), TIMES)
    joints = own.joints(met, TIMES, np.zeros(3))
    assert np.max(own.errors(met, joints, TIMES)) < 1e-11
    seen = boresights(craft, met, joints)  # by the tests' own rotations
    for name, aim in aims.items():
        toward = aim.path().at(TIMES) if isinstance(aim, Aim) else aim
        assert np.max(angle(seen[:, craft.device_names.index(name)], toward)) < 1e-11
    np.testing.assert_allclose(
        met @ np.swapaxes(met, 1, 2), np.tile(np.eye(3), (len(TIMES), 1, 1)), atol=1e-12
    )


def test_the_turn_to_where_targets_are_met_is_the_least_one():
    own = pursuit(observer(), telescope=SITE)
    given = down(TIMES, np.random.default_rng(4), 0.05)
    met = own.meeting(given, TIMES)
    turned = Rotation.from_matrix(np.swapaxes(given, 1, 2) @ met).magnitude()
    least = angle(given[:, :, 2], SITE.path().at(TIMES))
    np.testing.assert_allclose(turned, least, rtol=2e-3)


def test_an_instrument_behind_its_target_is_brought_to_it_and_not_to_the_opposite():
    # the equations of an instrument hold with its back to the target, too
    own = pursuit(observer(), telescope=SITE)
    far = down(TIMES, np.random.default_rng(5)) @ Rotation.from_rotvec([0.0, 1.2, 0.0]).as_matrix()
    met = own.meeting(far, TIMES)
    assert np.max(own.errors(met, np.zeros((len(TIMES), 3)), TIMES)) < 1e-11


def test_two_instruments_with_targets_that_fit_are_both_met():
    craft = observer()
    truth = down(TIMES, np.random.default_rng(6))
    camera = truth @ craft.instruments[1].boresight
    at = {time: number for number, time in enumerate(TIMES)}
    for time, number in at.items():
        own = pursuit(craft, telescope=truth[number] @ [0.0, 0, 1], camera=camera[number])
        off = truth[[number]] @ Rotation.from_rotvec([[0.2, -0.1, 0.15]]).as_matrix()
        met = own.meeting(off, np.array([time]))
        np.testing.assert_allclose(met[0], truth[number], rtol=0, atol=1e-9)


def test_two_instruments_with_targets_that_do_not_fit_share_the_error():
    craft = observer()
    truth = down(TIMES[:1], np.random.default_rng(7))
    camera = Rotation.from_rotvec([0.0, 0.02, 0.0]).apply(craft.instruments[1].boresight)
    own = pursuit(craft, telescope=truth[0] @ [0.0, 0, 1], camera=truth[0] @ camera)
    met = own.meeting(truth, TIMES[:1])
    assert np.all(np.isfinite(met))
    error = own.errors(met, np.zeros((1, 3)), TIMES[:1])[0]
    np.testing.assert_allclose(error, 0.01, rtol=0.05)


def test_the_joints_of_other_devices_stay_as_they_are():
    own = pursuit(observer(), telescope=SITE)
    rest = np.random.default_rng(8).uniform(-1, 1, (len(TIMES), 3))
    met = own.meeting(down(TIMES, np.random.default_rng(8)), TIMES)
    np.testing.assert_array_equal(own.joints(met, TIMES, rest), rest)
    np.testing.assert_array_equal(own.unwrapped(rest), rest)


def test_of_yaws_a_turn_apart_the_nearest_to_the_given_one_is_taken():
    craft = observer()
    wide = jp.Spacecraft(
        terminals=(
            jp.Terminal(
                name="antenna",
                mounting=craft.terminals[0].mounting,
                yaw_range=deg(-400.0, 400.0),
                pitch_range=deg(-85.0, 85.0),
                rate_limit=deg(4.0),
                acceleration_limit=deg(1.0),
            ),
        ),
        rate_limit=deg(2.0),
        acceleration_limit=deg(0.5),
    )
    toward = unit([np.cos(0.3), np.sin(0.3), 0.2])
    own = pursuit(wide, antenna=toward)
    for near, expected in ((0.0, 0.3), (5.0, 0.3 + 2 * np.pi), (-6.5, 0.3 - 2 * np.pi)):
        found = own.joints(np.eye(3)[None], np.zeros(1), np.array([[near, 0.0]]))
        np.testing.assert_allclose(found[0, 0], expected, rtol=0, atol=1e-12)


def test_a_yaw_that_follows_a_target_all_round_does_not_jump_by_a_turn():
    craft = observer()
    time = np.linspace(0.0, 100.0, 40)
    azimuth = np.linspace(2.5, 2.5 + 3 * np.pi, 40)

    toward = unit(np.stack([np.cos(azimuth), np.sin(azimuth), np.full(40, 0.3)], axis=-1))
    own = pursuit(craft, antenna=DirectionPath.through(time, toward))
    joints = own.joints(np.tile(np.eye(3), (40, 1, 1)), time, np.zeros((40, 3)))
    smooth = own.unwrapped(joints)
    assert np.max(np.abs(np.diff(joints[:, 0]))) > 6
    assert np.max(np.abs(np.diff(smooth[:, 0]))) < 0.3
    turns = (smooth - joints) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.ptp(smooth[:, 0]), 3 * np.pi, rtol=2e-2)


def test_margins_are_those_of_the_zones_where_they_are_at_each_time():
    craft, zones = relay(), relay_zones()
    own = pursuit(craft, zones, **LINKS)
    attitudes = np.stack([MINE.frame(t) for t in TIMES])
    joints = own.joints(attitudes, TIMES, np.zeros((len(TIMES), 8)))
    found = own.margins(attitudes, joints, TIMES)
    seen = boresights(craft, attitudes, joints)
    earth = -unit(MINE.position(TIMES))[:, None]
    expected = np.concatenate(
        [angle(seen, SUN) - zones[0].half_angle, angle(seen, earth) - zones[1].half_angle], axis=1
    )  # of each pair of zone and device
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(own.margins(attitudes, joints, TIMES), found)  # from what is kept

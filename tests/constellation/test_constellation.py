"""Links, starts and zones of a constellation against closed forms, and the planning of a small shell."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from reference import angle, assert_each, boresights
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.constellation import relay_spacecraft
from jaxplan.constellation.links import CLEARANCE, waiting_directions
from jaxplan.constellation.switch import LinkSwitch, nominal_attitudes
from jaxplan.goal import decompose
from jaxplan.goal.multistart import nearest_attitudes
from jaxplan.model.goals import Targets
from jaxplan.model.tabulation import tabulate
from jaxplan.plotting import constellation_figure
from jaxplan.sky import orbits

R, MU = 6378.137, 398600.4418
SUN = np.array([0.0, np.cos(np.deg2rad(23.44)), np.sin(np.deg2rad(23.44))])
LARGE, STAR = (
    jp.walker("53:1584/72/39", 550.0, epoch_angle=0.3),
    jp.walker("86.4:66/6/2", 781.0, pattern="star"),
)
SMALL, ODD = jp.walker("30:36/6/3", 2000.0), jp.walker("97.6:35/5/4", 3000.0)


@pytest.fixture(scope="module")
def switch():
    return jp.link_switch(SMALL, sun_direction=SUN, sun_half_angle=np.deg2rad(15.0), drift_time=120.0)


@pytest.fixture(scope="module")
def planned(switch):
    return jp.plan_constellation(switch, progress=False)


@pytest.fixture(scope="module")
def large():
    return jp.link_switch(LARGE, sun_direction=SUN)


def down(shell):
    return -shell.positions() / shell.radius


def seen_at_first(scenario):
    """What the terminals see at the start."""
    attitude = Rotation.from_rotvec(scenario.start.rotation_vector).as_matrix()
    return boresights(scenario.spacecraft, attitude, scenario.start.joints)


def test_links_in_a_plane_dip_by_half_their_arc_and_clear_the_earths_limb(large):
    shell = large.shell
    limb = np.arcsin((R + 80.0) / (R + 550.0))
    drift = 90.0 * np.sqrt(MU / (R + 550.0) ** 3)
    assert large.earth_half_angle == pytest.approx(limb + drift, abs=1e-12)
    off_nadir = angle(large.directions[0], down(shell)[:, None])
    aside = ~large.sun_outage[0, :, :2]
    np.testing.assert_allclose(off_nadir[:, :2][aside], np.pi / 2 - np.pi / 22, atol=1e-12)
    assert_each(angle(large.directions, down(shell)[:, None]), ">=", large.earth_half_angle)


def test_a_link_in_a_plane_is_refused_where_its_chord_meets_the_air():
    # the chord of 1 / S of a turn comes down to r cos(pi / S)
    for slots, altitude in ((9, 550.0), (10, 550.0), (8, 600.0), (8, 700.0)):
        shell = jp.walker(f"30:{2 * slots}/2/0", altitude)
        lowest = (R + altitude) * np.cos(np.pi / slots) - R
        topology = np.stack([shell.neighbours(0, 1), shell.neighbours(0, -1)], axis=-1)
        craft = replace(relay_spacecraft(), terminals=relay_spacecraft().terminals[:2])
        known = {"spacecraft": craft, "before": topology, "after": topology, "drift_time": 0.0}
        assert jp.link_switch(shell, lowest_altitude=lowest - 0.01, **known).earth_half_angle < np.pi / 2
        with pytest.raises(ValueError, match="below lowest_altitude"):
            jp.link_switch(shell, lowest_altitude=lowest + 0.01, **known)


# the problems


def test_every_start_points_along_its_links(large):
    shell = large.shell
    position = shell.positions()
    toward = position[large.before] - position[:, None]
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    scenarios = large.scenarios()
    seen = np.stack([seen_at_first(scenario) for scenario in scenarios])
    linked = ~large.sun_outage[0]
    assert np.sum(~linked) > 10
    assert_each(angle(seen, toward)[linked], "<", 1e-9)
    assert_each(angle(seen, large.directions[0]), "<", 1e-9)
    assert_each(np.abs(large.joints), "<=", large.spacecraft.joint_ranges[:, 1])
    assert_each(angle(seen, SUN), ">=", large.sun_half_angle)
    assert_each(angle(seen, down(shell)[:, None]), ">=", large.earth_half_angle)


def test_goals_are_the_links_after_the_switch(large):
    shell = large.shell
    scenario = large.scenario(700)
    np.testing.assert_array_equal(large.sun_outage[:, 700], False)
    position = shell.positions()
    seen = orbits.line_of_sight(position[700], position[large.after[700]])
    np.testing.assert_allclose(scenario.goal.directions, seen, atol=1e-15)
    assert scenario.trajectory.duration == "stretched"
    assert [zone.name for zone in scenario.keep_out] == ["Sun", "Earth"]


def test_starts_are_as_near_to_the_nominal_attitude_as_step_1_comes(large):
    shell, craft = large.shell, large.spacecraft
    for number in (0, 5, 333, 700, 1200):
        up, ahead = shell.positions()[number] / shell.radius, shell.velocities()[number]
        ahead = ahead / np.linalg.norm(ahead)
        nominal = np.stack([ahead, np.cross(up, ahead), up], axis=-1)
        targets = Targets(
            directions=large.directions[0, number], angular_velocity=np.zeros(3), joint_rates=np.zeros(6)
        )
        best = decompose(craft, nominal, targets, tabulate((), (), craft), max_goals=1).goals[0]
        turned = Rotation.from_matrix(nominal.T @ large.attitudes[number]).magnitude()
        assert turned == pytest.approx(best.slew_angle, abs=1e-9)


def test_starts_that_the_batch_does_not_find_are_left_to_step_1(switch):
    craft, shell = switch.spacecraft, switch.shell
    nominal = nominal_attitudes(*shell.states())
    *_, found = nearest_attitudes(craft, nominal, switch.directions[0])
    assert 0 < np.sum(found) < 36
    seen = np.stack([seen_at_first(scenario) for scenario in switch.scenarios()])
    assert_each(angle(seen, switch.directions[0]), "<", 1e-9)
    assert_each(np.abs(switch.joints), "<=", craft.joint_ranges[:, 1])


def test_drives_and_instruments_change_no_start_of_terminals_and_begin_in_range_at_rest(switch):
    drives = [
        jp.Drive(
            name=name,
            axis=[0, 1, 0],
            boresight=[0, 0, -1],
            range=np.deg2rad(angles),
            rate_limit=0.1,
            acceleration_limit=0.1,
        )
        for name, angles in (("array", [-180, 180]), ("panel", [20, 180]))
    ]
    telescope = jp.Instrument(name="telescope", boresight=[0, 0, 1])
    craft = replace(switch.spacecraft, drives=drives, instruments=[telescope])
    sun = {"sun_direction": SUN, "sun_half_angle": np.deg2rad(15.0), "drift_time": 120.0}
    more = jp.link_switch(SMALL, spacecraft=craft, **sun)
    np.testing.assert_array_equal(more.joints[:, :6], switch.joints)
    np.testing.assert_array_equal(more.joints[:, 6:], np.deg2rad([[0, 20]] * 36))
    for scenario in more.scenarios():
        np.testing.assert_array_equal(scenario.start.joint_rates, np.zeros(8))
        np.testing.assert_array_equal(scenario.goal.joint_rates, np.zeros(8))
        assert all(zone.devices == ("fore", "aft", "cross") for zone in scenario.keep_out)
    result = jp.plan_constellation(more, satellites=[0, 7], progress=False)
    np.testing.assert_array_equal(result.certified, True)


def test_links_through_the_sun_wait_beside_its_cone_as_near_as_may_be(large):
    sun_angle = angle(large.directions, SUN)
    rim = large.sun_half_angle + CLEARANCE
    np.testing.assert_allclose(sun_angle[large.sun_outage], rim, atol=1e-12)
    assert_each(sun_angle[~large.sun_outage], ">=", rim)
    # nearness: with nothing else in the way the link, the Sun and the place are in one plane
    rng = np.random.default_rng(0)
    links = SUN + 0.1 * rng.uniform(-1, 1, (30, 3))
    links /= np.linalg.norm(links, axis=-1, keepdims=True)
    free, there = waiting_directions(links, SUN, 0.2, np.tile(-SUN, (30, 1)), 0.5)
    np.testing.assert_array_equal(there, True)
    np.testing.assert_allclose(angle(free, links), 0.2 + CLEARANCE - angle(links, SUN), atol=1e-12)
    # with the Earth half in the way, no direction tried at random that is clear of both is nearer
    nadir = Rotation.from_rotvec([1.3, 0, 0]).apply(SUN)
    places, there = waiting_directions(links, SUN, 0.2, np.tile(nadir, (30, 1)), 1.2)
    np.testing.assert_array_equal(there, True)
    assert np.any(angle(places, links) > angle(free, links) + 0.01)
    tried = SUN + 0.4 * rng.uniform(-1, 1, (100_000, 3))
    tried /= np.linalg.norm(tried, axis=-1, keepdims=True)
    clear = (angle(tried, SUN) >= 0.2 + CLEARANCE) & (angle(tried, nadir) >= 1.2 + CLEARANCE)
    assert_each(angle(places, SUN), ">=", 0.2 + CLEARANCE - 1e-12)
    assert_each(angle(places, nadir), ">=", 1.2 + CLEARANCE)
    for link, place in zip(links, places, strict=True):
        assert angle(link, place) <= np.min(angle(tried[clear], link)) + 0.01


def test_a_link_right_to_the_sun_has_a_place_to_wait():
    places, there = waiting_directions(SUN[None], SUN, 0.2, -SUN[None], 0.5)
    assert there[0]
    assert angle(places[0], SUN) == pytest.approx(0.2 + CLEARANCE)
    _, there = waiting_directions(SUN[None], SUN, 0.2, SUN[None], 0.5)
    assert not there[0]


# planning


@pytest.mark.slow
def test_a_small_shell_is_planned_and_certified(planned, switch):
    np.testing.assert_array_equal(planned.certified, True)
    assert set(planned.status) == {"OK"}
    assert len(planned.table) == 36
    np.testing.assert_array_equal(planned.planned, np.arange(36))
    assert_each(planned.min_margin, ">=", 0)
    assert_each(planned.duration, ">", 0)
    assert np.sum(planned.sun_outage) == np.sum(np.any(switch.sun_outage, axis=(0, 2))) > 0


def test_arrays_and_table_say_what_a_plan_says(planned, switch):
    plan = jp.plan(switch.scenario(7), progress=False)
    row = planned.table[7]
    assert (row["satellite"], row["plane"], row["slot"]) == (7, 1, 1)
    assert row["duration_s"] == planned.duration[7] == plan.trajectory.duration
    assert planned.slew_angle[7] == pytest.approx(plan.goal.slew_angle, rel=1e-14)
    assert planned.min_margin[7] == pytest.approx(plan.certificate.min_margin, rel=1e-14)
    outages = [row["sun_outages_before"] + row["sun_outages_after"] for row in planned.table]
    assert sum(outages) == np.sum(switch.sun_outage)
    assert planned.timings[7]["satellite"] == 7
    assert planned.timings[7]["total_s"] > 0


def test_the_summary_counts(planned, switch):
    summary = planned.summary()
    record = summary.record()
    assert record["planned"] == record["scenes"] == 36
    assert record["sun_outages_before"] == np.sum(switch.sun_outage[0])
    assert record["satellites_with_sun_outages"] == np.sum(planned.sun_outage)
    assert record["beyond_drift_time"] == np.sum(planned.duration > 120.0)
    assert record["spreads"]["duration (s)"]["most"] == np.max(planned.duration)
    assert "30:36/6/3 at 2000 km" in str(planned)
    assert "<table>" in planned._repr_html_()


def test_links_kept_through_the_sun_are_counted_as_invalid():
    half_angle = np.deg2rad(15.0)
    kept = jp.link_switch(SMALL, sun_direction=SUN, sun_half_angle=half_angle, sun_outage="keep")
    inside = np.any(angle(kept.directions, SUN) < half_angle, axis=2)
    chosen = np.flatnonzero(np.any(inside, axis=0))
    result = jp.plan_constellation(kept, satellites=chosen, progress=False)
    np.testing.assert_array_equal(result.planned, chosen)
    expected = np.where(inside[0, chosen], "INVALID_START", "INVALID_GOAL")
    np.testing.assert_array_equal(result.status, expected)
    np.testing.assert_array_equal(result.certified, False)
    np.testing.assert_array_equal(result.duration, np.nan)
    assert Counter(result.status) == result.summary().statuses


def test_the_switches_of_docstrings_can_be_made():
    for of in (jp.plan_constellation, jp.link_switch):
        notation, altitude = re.search(
            r'jp\.walker\("(.*?)", ([\d.]+)\)', of.__doc__.split("Example:")[1]
        ).groups()
        assert isinstance(jp.link_switch(jp.walker(notation, float(altitude))), LinkSwitch)


# what is wrong is named


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"sun_direction": [0, 0, 2.0]}, ["sun_direction", "unit vector"]),
        ({"sun_direction": [0, 0, np.nan]}, ["sun_direction"]),
        ({"sun_direction": "sun"}, ["sun_direction: must be a unit vector (3,) of numbers"]),
        ({"before": [[0, 1, 2], [3]]}, ["before has shape (0,)"]),
        ({"sun_half_angle": 2.0, "sun_outage": "hope"}, ["sun_half_angle = 2.0", "'wait' or 'keep'"]),
        ({"lowest_altitude": np.nan, "drift_time": -1}, ["lowest_altitude = nan", "drift_time = -1"]),
        ({"time": "noon"}, ["time = 'noon'"]),
        ({"before": np.zeros((36, 2), int)}, ["before has shape (36, 2)", "(36, 3)"]),
        ({"after": np.full((36, 3), 36)}, ["after[0, 0] = 36", "[0, 35]"]),
        ({"before": np.zeros((36, 3), int)}, ["satellite 0 (plane 0, slot 0), fore", "the satellite itself"]),
        ({"drift_time": 400.0}, ["satellite 0", "fore to satellite 1 before the switch", "drift_time"]),
    ],
)
def test_a_switch_that_cannot_be_is_refused(options, words):
    with pytest.raises(jp.ScenarioError) as raised:
        jp.link_switch(SMALL, **options)
    for word in words:
        assert word in str(raised.value)


def test_links_that_are_impossible_for_different_reasons_are_counted_apart(switch):
    itself, ahead = np.arange(36)[:, None], switch.before.copy()
    ahead[:5] = itself[:5]
    ahead[20:22, 1] = SMALL.neighbours(0, 3)[20:22]  # on the other side of the Earth
    with pytest.raises(jp.ScenarioError) as raised:
        jp.link_switch(SMALL, before=ahead)
    told = raised.value.faults
    assert len(told) == 4
    own = [fault for fault in told if "the satellite itself as its target; so it is with 4 other" in fault]
    assert [fault.split(",")[2].split(" to ")[0] for fault in own] == [" fore", " aft", " cross"]
    (low,) = (fault for fault in told if "comes down to" in fault)
    assert low.startswith("satellite 20 (plane 3, slot 2), aft to satellite 23 before the switch: ")
    assert low.endswith("; so it is with 1 other satellite")


def test_shells_that_have_no_such_links_are_refused():
    with pytest.raises(ValueError, match="planes = 5: must be even"):
        jp.link_switch(ODD)
    with pytest.raises(ValueError, match="has 2 terminals"):
        jp.link_switch(
            SMALL, spacecraft=replace(relay_spacecraft(), terminals=relay_spacecraft().terminals[:2])
        )
    with pytest.raises(ValueError, match=r"lowest_altitude = 80: must be below the shell's, 60 km"):
        jp.link_switch(jp.walker("53:1584/72/39", 60.0))
    four = (*relay_spacecraft().terminals, replace(relay_spacecraft().terminals[2], name="west", mount=-1.5))
    with pytest.raises(ValueError, match="outer planes"):
        jp.link_switch(STAR, spacecraft=replace(relay_spacecraft(), terminals=four))


def test_terminals_that_cannot_see_all_links_at_once_are_named():
    craft = relay_spacecraft()
    narrow = tuple(replace(terminal, pitch_limit=np.deg2rad(5.0)) for terminal in craft.terminals)
    with pytest.raises(ValueError, match=r"satellite 0: no attitude .* at best \w+ pitch is .* deg beyond"):
        jp.link_switch(SMALL, spacecraft=replace(craft, terminals=narrow))


@pytest.mark.parametrize("satellites", [[], [0, 0], [36], [-1], [1.0], [True]])
def test_satellites_that_there_are_not_are_refused(switch, satellites):
    with pytest.raises(jp.ScenarioError, match="satellites"):
        jp.plan_constellation(switch, satellites=satellites)


# the figure


def test_the_figure_shows_every_satellite_in_front_and_the_shares_of_all(planned):
    globe, histogram = jp.plot.constellation(planned, Figure(), view=(0.0, 90.0))
    position = planned.shell.positions() / R
    hidden = (position[:, 2] < 0) & (np.hypot(position[:, 0], position[:, 1]) < 1)
    colours = [marks.get_array() for marks in globe.collections]
    shown = np.concatenate([values for values in colours if values is not None and len(values)])
    np.testing.assert_allclose(np.sort(shown), np.sort(planned.duration[~hidden]))
    assert sum(bar.get_height() for bar in histogram.patches) == pytest.approx(100)
    assert "36 of 36" in histogram.get_title(loc="left")
    with pytest.raises(ValueError, match="2 panels"):
        jp.plot.constellation(planned, globe)


@pytest.mark.parametrize(
    ("satellites", "duration", "text"),
    [([0], 120.0, "120 s: 1 satellite,"), ([0, 7], 120.0, "120 s: 2 satellites,"), ([0, 7], 20.0, None)],
)
def test_the_histogram_shows_equal_times_and_none_of_failed_plans(switch, satellites, duration, text):
    settings = {"trajectory.duration_s": duration}
    result = jp.plan_constellation(switch, satellites=satellites, settings=settings, progress=False)
    np.testing.assert_array_equal(result.duration, duration)  # failed plans have one, too
    np.testing.assert_array_equal(result.certified, text is not None)
    _, histogram = jp.plot.constellation(result, Figure())
    told = [one.get_text() for one in histogram.get_legend().get_texts()]
    bars = [bar for bar in histogram.patches if bar.get_height() > 0]
    if text is None:
        assert not bars
        assert told == ["no certified plan"]
        return
    assert told[0].startswith(text)
    (bar,) = bars
    assert bar.get_height() == pytest.approx(100)
    assert bar.get_x() <= duration <= bar.get_x() + bar.get_width()
    low, high = histogram.get_xlim()
    assert bar.get_width() > 0.01 * (high - low)


@pytest.mark.parametrize("highest", [7.0, 40.0])
def test_what_is_told_of_longer_times_stands_above_the_bars_below_it(highest):
    axes = Figure(layout="constrained").subplots()
    shares = np.concatenate([np.full(20, 44.0), np.full(10, highest)])
    axes.bar(np.arange(30), shares, width=1.0, align="edge")
    constellation_figure._write_longer_times(axes, "2 longer,\nup to 113 s", [shares[:20] / 9, shares])
    axes.figure.draw_without_rendering()
    (text,) = (one.get_window_extent() for one in axes.texts)
    assert not any(text.overlaps(bar.get_window_extent()) for bar in axes.patches)
    assert text.y1 <= axes.get_window_extent().y1

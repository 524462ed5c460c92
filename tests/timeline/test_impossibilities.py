"""What is certain to be impossible in a timeline is told before it is planned, and nothing else is."""

from dataclasses import replace

import impossible_places
import impossible_times
import numpy as np
import pytest
from impossible import AHEAD, SITE, START, antenna_zone, holding, images, talks, telescope_zone, tracking
from passing import SUN, deg, links
from reference import unit

import jaxplan as jp
from jaxplan.cases import case_path
from jaxplan.model.hidden_spans import Hidden
from jaxplan.timeline.impossibilities import _has_visible_span, foreseen

CASES = impossible_places.CASES | impossible_times.CASES


def spans_of(*ends):
    return tuple(Hidden(target="star", by="the Earth", start=a, end=b) for a, b in ends)


def hidden(path, *ends):
    return replace(path, hidden=spans_of(*ends))


def test_a_state_that_is_held_keeps_ranges_and_zones_that_stand_still():
    turned = START.rotation_vector
    assert foreseen(images(holding(turned))) == ()
    (told,) = foreseen(images(holding(turned, joints=deg(0.0, 95.0, 0.0))))
    assert told.startswith("asked: antenna pitch is ")
    assert "beyond its" in told
    zone = telescope_zone("glare", AHEAD, 20.0)
    (told,) = foreseen(images(holding(turned), keep_out=(zone,)))
    assert told == "asked: telescope is 20 deg inside keep-out zone glare"
    axes = np.array([unit(AHEAD + np.array([0, k, 0])) for k in (0.0, 1e-4, 2e-4)])
    moving = jp.DirectionPath.through(np.array([0.0, 50.0, 100.0]), axes)
    assert foreseen(images(holding(turned), keep_out=(replace(zone, direction=moving),))) == ()
    others = (replace(zone, any_of="one"), antenna_zone("other", moving, 1.0))
    others = (others[0], replace(others[1], any_of="one"))
    assert foreseen(images(holding(turned), keep_out=others)) == ()


def test_a_target_that_stands_still_in_a_zone_of_its_device_is_told():
    zone = telescope_zone("glare", SUN, 20.0)
    asked = tracking({"telescope": SUN}, duration=5.0)
    (told,) = foreseen(images(asked, keep_out=(zone,)))
    assert told.startswith("asked: telescope is 20 deg inside keep-out zone glare at every attitude")
    assert foreseen(images(asked, keep_out=(antenna_zone("glare", SUN, 20.0),))) == ()


@pytest.mark.parametrize(
    ("spans", "words"),
    [
        (
            [(-1.0, 101.0)],
            "is not seen for 10 s within its time, from 20 s to 60 s: it is hidden by the Earth",
        ),
        ([(-1.0, 25.0), (34.0, 101.0)], "is not seen for 10 s within its time, from 20 s to 60 s"),
        ([(-1.0, 25.0), (36.0, 101.0)], None),
        ([(-1.0, 50.0)], None),
        ([(-1.0, 51.0)], "is not seen for 10 s"),
        ([], None),
    ],
)
def test_a_target_that_is_not_seen_for_long_enough_in_its_window_is_told(spans, words):
    path = hidden(SITE.path(), *spans)
    asked = jp.Activity(
        name="asked", track=jp.Targets.of({"telescope": path}), duration=10.0, earliest=20.0, latest=60.0
    )
    told = foreseen(images(asked))
    assert len(told) == (words is not None)
    assert not told or told[0].startswith(f"asked: {path.target}, the target of telescope, {words}")


def test_targets_that_are_never_seen_together_are_told_and_so_is_what_lasts_to_the_end():
    both = links("east", "west")
    names, (first, second) = both.devices[:2], both.paths[:2]
    each = {names[0]: hidden(first, (-1.0, 30.0)), names[1]: hidden(second, (30.0, 61.0))}
    asked = jp.Activity(name="asked", track=jp.Targets.of(each), duration=5.0, latest=50.0)
    (told,) = foreseen(talks(asked))
    assert told == "asked: its targets are not all seen together for 5 s within its time, from 0 s to 50 s"
    (told,) = foreseen(talks(replace(asked, duration=None)))
    assert "is not seen up to the end of its time, from 0 s to 50 s" in told
    assert foreseen(talks(replace(asked, track=jp.Targets.of(dict([next(iter(each.items()))]))))) == ()


def test_seen_agrees_with_a_look_at_every_instant():
    chance = np.random.default_rng(3)
    grid = np.arange(0.0, 40.0, 0.5)
    seen = 0
    for _ in range(300):
        starts = chance.integers(0, 20, 4)
        spans = spans_of(
            *((float(a), float(a + b)) for a, b in zip(starts, chance.integers(1, 15, 4), strict=True))
        )
        lasts, latest = float(chance.integers(0, 8)), float(chance.integers(8, 20))
        free = np.array([not any(span.at(time) for span in spans) for time in grid])
        steps = round(2 * lasts)
        possible = any(
            np.all(free[k : k + max(steps, 1)]) for k in range(len(grid)) if grid[k] + lasts <= latest
        )
        assert _has_visible_span(spans, 0.0, lasts, latest) == possible
        seen += possible
    assert 50 < seen < 250


def test_what_can_be_planned_is_never_told_and_of_what_cannot_only_what_is_refused_so():
    for name in ("case-day", "case-imaging"):
        assert foreseen(jp.load_timeline(case_path(name))) == ()
    told = {name: phrases for name, case in CASES.items() if (phrases := foreseen(case.make()))}
    assert len(told) >= 5
    statuses = {CASES[name].status for name in told}
    assert statuses <= {jp.Status.INVALID_GOAL, jp.Status.GOAL_UNREACHABLE, jp.Status.OUT_OF_WINDOW}
    for name, phrases in told.items():
        assert all(phrase.startswith("asked: ") for phrase in phrases), name

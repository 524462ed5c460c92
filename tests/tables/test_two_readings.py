"""Tables that readers of one format fly in two ways: zones must hold in both, rates in the usual one."""

from dataclasses import replace

import numpy as np
import pytest
from exports import EPOCH
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.exporting import table_proof
from jaxplan.tables.table import HERMITE, SLERP

TURN, STEP = np.deg2rad(40.0), 40.0  # about y from row to row, and s between


def bulging(side: float) -> jp.AttitudeTable:
    """Two rows with rates that would lead a cubic off the shortest turn, by `side` of the turn's own rate."""
    rates = np.array([[side, TURN / STEP, 0.0], [-side, TURN / STEP, 0.0]])
    return jp.AttitudeTable(
        times=np.array([0.0, STEP]),
        quaternions=Rotation.from_rotvec([[0, 0, 0], [0, TURN, 0]]).as_quat(scalar_first=True),
        angular_velocity=rates,
        interpolation=SLERP,
        alternative=HERMITE,
    )


def scene(half_deg: float) -> jp.Scenario:
    """A camera along z, and a zone beside the way that it takes from z to x."""
    craft = jp.Spacecraft(
        terminals=(),
        rate_limit=np.deg2rad(3.0),
        acceleration_limit=np.deg2rad(0.5),
        instruments=(jp.Instrument(name="camera", boresight=np.array([0.0, 0.0, 1.0])),),
    )
    middle = Rotation.from_rotvec([0.0, TURN / 2, 0.0]).apply([0.0, -np.sin(0.5), np.cos(0.5)])
    zone = jp.KeepOut(name="sun", direction=middle, half_angle=np.deg2rad(half_deg), devices=("camera",))
    start = jp.GivenState(rotation_vector=np.zeros(3), joints=np.zeros(0))
    return jp.Scenario(name="two ways", spacecraft=craft, start=start, goal=start, keep_out=(zone,))


def test_margins_are_the_lesser_and_rates_those_of_the_usual_reading():
    table, place = bulging(np.deg2rad(0.4)), scene(10.0)
    both = jp.certify_table(table, None, place)
    usual, other = (jp.certify_table(table, how, place) for how in (SLERP, HERMITE))
    assert other.min_margin < usual.min_margin - np.deg2rad(1)
    assert both.min_margin == other.min_margin
    assert (both.worst_device, both.worst_time) == (other.worst_device, other.worst_time)
    assert both.peaks["angular_velocity"] == usual.peaks["angular_velocity"]
    assert (both.interpolation, both.alternative, usual.alternative) == (SLERP, HERMITE, None)
    assert "zones with hermite, too" in dict(both.rows())["certified"]
    assert both.summary()["alternative"] == HERMITE
    # turned the other way the cubic keeps away from the zone
    away = jp.certify_table(bulging(-np.deg2rad(0.4)), None, place)
    assert away.min_margin == pytest.approx(usual.min_margin, abs=1e-9)


def test_a_zone_that_one_of_them_enters_is_told_with_the_reading():
    place = scene(26.0)
    assert jp.certify_table(bulging(np.deg2rad(0.4)), SLERP, place).certified
    found = jp.certify_table(bulging(np.deg2rad(0.4)), None, place)
    assert not found.certified
    assert found.faults[0].startswith("with hermite between rows: ")
    forgiving = jp.certify_table(bulging(np.deg2rad(0.4)), None, place, forgive_deg=1.0)
    assert forgiving.certified is bool(found.min_margin >= -np.deg2rad(1.0))


def test_a_margin_that_is_no_number_is_never_lost(monkeypatch):
    from jaxplan.certificate import Certificate
    from jaxplan.tables.joined_certificates import with_margins

    good = Certificate(certified=True, faults=(), min_margin=0.1, worst_time=1.0)
    lost = replace(good, min_margin=np.nan)
    for one, other in ((good, lost), (lost, good)):
        assert np.isnan(with_margins(one, other, HERMITE).min_margin)
    assert with_margins(good, replace(good, min_margin=None), HERMITE).min_margin == 0.1
    assert with_margins(replace(good, min_margin=None), good, HERMITE).min_margin == 0.1


def test_messages_with_rates_are_read_in_both_ways_and_exported_for_both(tmp_path, monkeypatch):
    place, seen = scene(10.0), []
    goal = replace(place.start, rotation_vector=np.array([0.0, TURN, 0.0]))
    plan = jp.plan(replace(place, goal=goal))
    proved = table_proof.certify_rows

    def noted(*given, **more):
        seen.append(more["other"])
        return proved(*given, **more)

    monkeypatch.setattr(table_proof, "certify_rows", noted)
    path = jp.export(plan, tmp_path / "a.aem", format="aem", epoch=EPOCH)
    assert set(seen) == {HERMITE}
    table = jp.load_attitude(path)
    assert table.alternative == HERMITE
    found = jp.certify_table(path, None, plan.scenario)
    assert found.certified
    assert found.min_margin <= jp.certify_table(path, SLERP, plan.scenario).min_margin
    seen.clear()
    jp.export(plan, tmp_path / "a.csv", format="csv", epoch=EPOCH)
    assert set(seen) == {None}


def test_an_unknown_reading_is_refused():
    with pytest.raises(ValueError, match="alternative = 'cubic': must be None or one of slerp"):
        replace(bulging(0.0), alternative="cubic")


def test_a_zone_that_moves_must_be_known_to_the_end_of_the_table():
    place = scene(10.0)
    times = np.linspace(0.0, 30.0, 7)
    path = jp.DirectionPath.through(times, np.tile(place.keep_out[0].direction, (7, 1)))
    short = replace(place, keep_out=(replace(place.keep_out[0], direction=path),))
    with pytest.raises(ValueError, match=r"ends 40 s after .* zone sun moves and is known until 30 s"):
        jp.certify_table(bulging(0.0), None, short)

"""One rule of what is forgiven of tables, in exports and checks, told and settable."""

import json
from dataclasses import replace

import numpy as np
import pytest
from builders import make_scenario, make_spacecraft
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.certificate import Certificate
from jaxplan.cli import main
from jaxplan.tables.joined_certificates import joined_proof
from jaxplan.tables.tolerances import Forgiven

RATE = np.deg2rad(1.0)


def held(short_deg: float, over_percent: float) -> tuple[jp.AttitudeTable, jp.Scenario]:
    """A turn about z at 1 deg/s, and a scene of which it breaks a zone and the limit of rate by so much."""
    times = np.arange(0.0, 10.5, 0.5)
    turned = Rotation.from_rotvec(np.outer(RATE * times, [0, 0, 1.0])).as_quat(scalar_first=True)
    craft = replace(make_spacecraft(0, 1), rate_limit=RATE / (1 + over_percent / 100))
    craft = replace(craft, instruments=(jp.Instrument(name="eye", boresight=np.array([1.0, 0.0, 0.0])),))
    half = np.deg2rad(20.0)
    axis = Rotation.from_rotvec([0, 0, RATE * 10 + half - np.deg2rad(short_deg)]).apply([1.0, 0, 0])
    zone = jp.KeepOut(name="lamp", direction=axis, half_angle=half, devices=("eye",))
    scene = replace(make_scenario(0, 1), spacecraft=craft, keep_out=(zone,), keep_in=())
    start = replace(scene.start, rotation_vector=np.zeros(3))
    return jp.AttitudeTable(times=times, quaternions=turned), replace(scene, start=start, goal=start)


@pytest.mark.parametrize(
    ("short", "over", "forgives", "certified"),
    [
        (-1.0, -1.0, {}, True),
        (-1.0, -1.0, {"forgive_deg": 0, "forgive_percent": 0}, True),
        (0.0009, -1.0, {}, True),
        (0.0011, -1.0, {}, False),
        (0.0009, -1.0, {"forgive_deg": 0.0}, False),
        (-1.0, 0.49, {}, True),
        (-1.0, 0.51, {}, False),
        (-1.0, 0.49, {"forgive_percent": 0}, False),
        (0.5, 3.0, {"forgive_deg": 0.51, "forgive_percent": 3.1}, True),
        (0.5, 3.0, {"forgive_deg": 0.51}, False),
    ],
)
def test_what_is_forgiven_is_told_and_nothing_more_is(short, over, forgives, certified):
    table, scene = held(short, over)
    proof = jp.certify_table(table, None, scene, **forgives)
    broken = short > 0 or over > 0
    assert proof.certified == certified
    assert bool(proof.forgiven) == (certified and broken)
    assert bool(proof.faults) == (not certified)
    assert np.rad2deg(proof.min_margin) == pytest.approx(-short, abs=2e-4)  # as it is, whatever is forgiven
    assert proof.peaks["angular_velocity"] == pytest.approx(1 + over / 100, abs=1e-3)
    text = str(proof)
    if certified and broken:
        assert "within what is forgiven, at every instant with slerp between 21 rows" in text
        assert "forgiven: " in text
    strict = proof.forgives == Forgiven(0, 0)
    assert ("none was needed" in text) == (certified and not broken and not strict)
    told = proof.summary()
    assert told["forgives_deg"] == forgives.get("forgive_deg", 1e-3)
    assert told["forgives_percent"] == forgives.get("forgive_percent", 0.5)
    assert len(told["forgiven"]) == len(proof.forgiven)


def test_jumps_and_what_cannot_be_evaluated_are_never_forgiven():
    rule = Forgiven(1.0, 10.0)
    short = Certificate(certified=False, peaks={"joint_rates": 0.5}, min_margin=-0.01, faults=("short",))
    assert rule.covers(short, 0)
    assert rule.covers(replace(short, jumps={"angular_velocity": 0.1}), 0)
    for broken, continuous in (
        (replace(short, jumps={"angular_velocity": 0.1}), 1),
        (replace(short, jumps={"attitude": 1e-3}), 0),
        (replace(short, min_margin=np.nan), 0),
        (replace(short, peaks={"joint_rates": np.nan}), 0),
        (replace(short, peaks={}), 0),
    ):
        assert not rule.covers(broken, continuous)


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(
    "changes", [{"min_margin": np.nan}, {"peaks": {}}, {"peaks": {"joint_rates": np.nan}}]
)
def test_a_part_that_cannot_be_evaluated_is_not_forgiven_for_the_others(changes, first):
    good = Certificate(
        certified=True,
        peaks={"joint_rates": 0.5},
        min_margin=0.1,
        worst_time=1.0,
        worst_device="camera",
        worst_zone="sun",
        faults=(),
    )
    broken = replace(good, certified=False, faults=("cannot be evaluated",), **changes)
    parts = [(0.0, good), (5.0, good)]
    parts.insert(first, (2.0, broken))
    joined = joined_proof(parts)
    assert not joined.certified
    assert not Forgiven(1.0, 10.0).covers(joined, 0)


def test_only_small_numbers_may_be_forgiven():
    table, scene = held(-1.0, -1.0)
    for given, words in (
        ({"forgive_deg": -0.1}, r"forgive_deg = -0.1: must lie in \[0, 1\]"),
        ({"forgive_deg": np.nan}, r"forgive_deg = nan: must lie in \[0, 1\]"),
        ({"forgive_percent": 11}, r"forgive_percent = 11: must lie in \[0, 10\]"),
        ({"forgive_percent": "much"}, r"forgive_percent = .much.: must be a number in \[0, 10\]"),
    ):
        with pytest.raises(ValueError, match=words):
            jp.certify_table(table, None, scene, **given)


@pytest.mark.slow
def test_a_table_just_written_is_held_to_be_good_by_the_check(tmp_path, capsys):
    scene, file, table = tmp_path / "scene.toml", tmp_path / "plan.json", tmp_path / "slew.csv"
    case = jp.paper_case(2)
    quick = jp.plan(replace(case, trajectory=replace(case.trajectory, duration="minimum", method="global")))
    quick.save(file)  # which touches its limits
    jp.save_scenario(quick.scenario, scene)
    export = ["export", str(file), "--format", "csv", "--step", "0.5", "-o", str(table), "--force"]
    assert main(export) == 0
    capsys.readouterr()
    check = ["check", str(table), "--scenario", str(scene), "--json"]
    assert main(check) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["certified"]
    assert "of its limit" in found["forgiven"][0]
    assert main([*check, "--forgive-deg", "0", "--forgive-percent", "0"]) == 3
    strict = json.loads(capsys.readouterr().out)
    assert (strict["forgiven"], strict["faults"]) == ([], found["forgiven"])
    assert main([*export, "--forgive-deg", "0", "--forgive-percent", "0"]) == 3
    assert "Forgiven is nothing" in capsys.readouterr().err
    assert main(["check", str(file), "--forgive-deg", "0.1"]) == 2
    assert "--forgive-deg: is of a table" in capsys.readouterr().err
    assert main([*export, "--forgive-percent", "20"]) == 2
    assert "forgive_percent = 20.0: must lie in [0, 10]" in capsys.readouterr().err

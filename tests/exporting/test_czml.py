"""CZML as its own models and CesiumJS read it, against the motion by scipy and the Earth turned by pyerfa."""

import json
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from builders import make_scenario
from exports import EPOCH, flown_day, flown_plan, truth
from scipy.spatial.transform import Rotation, Slerp

import jaxplan as jp
from jaxplan import sky
from jaxplan.schema import load_observer

czml3 = pytest.importorskip("czml3", reason="czml3 is not installed")
erfa = pytest.importorskip("erfa", reason="pyerfa is not installed")

ORBIT = sky.CircularOrbit(altitude=600.0, inclination=1.7, node=0.3, latitude=0.2)
READER = Path(__file__).parents[2] / "bench" / "czml_read.mjs"


def earth_turning(times: np.ndarray) -> np.ndarray:
    """(k, 3, 3) GCRS to fixed, by pyerfa's own chain of everything."""
    utc1, utc2 = erfa.dtf2d("UTC", 2026, 3, 1, 6, 30, 15.25)
    tai1, tai2 = erfa.utctai(utc1, utc2)
    tt1, tt2 = erfa.taitt(tai1, tai2 + times / 86400)
    return erfa.c2t06a(tt1, tt2, utc1, utc2 + times / 86400, 0.0, 0.0)


@pytest.fixture(scope="module")
def plan() -> jp.Plan:
    return flown_plan()


@pytest.fixture(scope="module")
def file(plan, tmp_path_factory) -> Path:
    place = tmp_path_factory.mktemp("czml") / "slew.czml"
    return jp.export(plan, place, format="czml", epoch=EPOCH, observer=ORBIT)


def packets(path: Path) -> dict[str, dict]:
    """Packets by id, each taken by czml3's model."""
    read = json.loads(path.read_text())
    document = czml3.Document(packets=[czml3.Packet(**packet) for packet in read])
    assert [packet.id for packet in document.packets] == [packet["id"] for packet in read]
    return {packet["id"]: packet for packet in read}


def attitudes(packet: dict) -> tuple[np.ndarray, Rotation]:
    """Times and attitudes, to axes fixed to the Earth, of the packet of the spacecraft."""
    rows = np.reshape(packet["orientation"]["unitQuaternion"], (-1, 5))
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert np.all(np.sum(rows[1:, 1:] * rows[:-1, 1:], axis=1) > 0.9)
    return rows[:, 0], Rotation.from_quat(rows[:, 1:])


def off(found: Rotation, plan: object, times: np.ndarray) -> float:
    """Largest angle, rad, of attitudes from the motion."""
    expected = Rotation.from_matrix(earth_turning(times) @ truth(plan, times).attitude)
    return float(np.max((found * expected.inv()).magnitude()))


def test_attitudes_hold_between_samples_too(plan, file):
    packet = packets(file)["spacecraft"]
    times, samples = attitudes(packet)
    assert (packet["orientation"]["interpolationAlgorithm"], times[0]) == ("LINEAR", 0)
    assert off(samples, plan, times) < 1e-8
    between = np.random.default_rng(1).uniform(0, times[-1], 5000)
    assert off(Slerp(times, samples)(between), plan, between) < 1e-6


def test_a_day_keeps_its_tolerance_while_the_earth_turns(tmp_path):
    day = flown_day()
    path = jp.export(day, tmp_path / "day.czml", format="czml")
    times, samples = attitudes(packets(path)["spacecraft"])
    assert times[-1] == day.trajectory.duration
    between = np.random.default_rng(2).uniform(0, times[-1], 5000)
    assert off(Slerp(times, samples)(between), day, between) < 1e-6


def test_boresights_end_where_devices_look(plan, file):
    read = packets(file)
    names = plan.scenario.spacecraft.device_names
    for number, name in enumerate(names):
        line = read[f"device-{number}"]
        assert line["name"] == name
        assert line["polyline"]["positions"]["references"][0] == "spacecraft#position"
        rows = np.reshape(read[f"device-{number}/boresight-end"]["position"]["cartesian"], (-1, 4))
        times = rows[:, 0]
        turning = earth_turning(times)
        here = 1e3 * sky.positions(ORBIT, epoch=EPOCH, times=times)
        expected = here + 1e6 * truth(plan, times).boresights[:, number]
        np.testing.assert_allclose(rows[:, 1:], np.einsum("kij,kj->ki", turning, expected), atol=0.1)


def test_zones_and_fields_of_view_are_closed_lines_at_their_angles(plan, tmp_path):
    craft = plan.scenario.spacecraft
    camera = jp.Instrument(name="camera", boresight=[0, 0, 1], up=[1, 0, 0], field_of_view=[0.2, 0.1])
    path = sky.path("sun", epoch=EPOCH, observer=ORBIT, duration_s=30.0)
    zones = (
        jp.KeepOut(name="sun", direction=path, half_angle=0.01, devices=("camera",)),
        jp.KeepOut(name="mast", axis_body=[0, 1, 0], half_angle=0.01, devices=("camera",)),
    )
    scene = replace(
        plan.scenario, spacecraft=replace(craft, instruments=(camera,)), keep_out=zones, keep_in=()
    )
    found = replace(plan, scenario=scene, goal=replace(plan.goal, time=plan.trajectory.duration))
    read = packets(jp.export(found, tmp_path / "zones", format="czml", epoch=EPOCH, observer=ORBIT))
    assert "zone-1" not in read  # an axis of the body
    number = craft.gimbals.count
    ring = read["zone-0"]["polyline"]["positions"]["references"]
    assert ring[0] == ring[24]
    field = read[f"device-{number}/field"]["polyline"]["positions"]["references"]
    assert field[0] == field[4]

    def seen(key: str) -> tuple[np.ndarray, np.ndarray]:
        rows = np.reshape(read[key.removesuffix("#position")]["position"]["cartesian"], (-1, 4))
        turning, here = earth_turning(rows[:, 0]), sky.positions(ORBIT, epoch=EPOCH, times=rows[:, 0])
        return np.einsum("kji,kj->ki", turning, rows[:, 1:]) / 1e6 - here / 1e3, rows[:, 0]

    for key in ring[:24]:
        along, times = seen(key)
        np.testing.assert_allclose(np.sum(along * path.at(times), axis=1), np.cos(0.01), atol=1e-6)
    for key in field[:4]:
        along, times = seen(key)
        body = np.einsum("kji,kj->ki", truth(plan, times).attitude, along)
        ratios = np.abs(body[:, :2] / body[:, 2:])  # up is x
        np.testing.assert_allclose(ratios, np.tile(np.tan([0.05, 0.1]), (len(times), 1)), atol=1e-6)


def test_a_spacecraft_without_orbit_stands_still_and_says_so(plan, tmp_path):
    craft = packets(jp.export(plan, tmp_path / "still", format="czml", epoch=EPOCH))["spacecraft"]
    rows = np.reshape(craft["position"]["cartesian"], (-1, 4))
    assert np.all(rows[:, 1:] == [7e6, 0, 0])
    assert "No orbit was given" in craft["description"]


def test_a_manoeuvre_that_takes_no_time_is_a_second_at_rest(tmp_path):
    scenario = make_scenario(2, 1)
    resting = jp.plan(replace(scenario, goal=scenario.start))
    path = jp.export(resting, tmp_path / "still", format="czml", epoch=EPOCH, observer=ORBIT)
    times, samples = attitudes(packets(path)["spacecraft"])
    assert (times[0], times[-1]) == (0, 1)
    expected = earth_turning(times) @ resting.goal.attitude
    np.testing.assert_allclose(samples.as_matrix(), expected, atol=1e-9)


def test_the_orbit_of_a_scene_file_is_its_observer(tmp_path):
    text = (
        "[sky]\nobserver = { altitude_km = 600, inclination_deg = 60, ascending_node_deg = 30, "
        "argument_of_latitude_deg = 9 }\n"
    )
    (tmp_path / "scene.toml").write_text(text)
    found = load_observer(tmp_path / "scene.toml")
    assert (found.altitude, round(np.rad2deg(found.inclination))) == (600, 60)
    for wrong, words in (("[sky]\n", "sky.observer: missing"), (text.replace("600", "-1"), "altitude_km")):
        (tmp_path / "scene.toml").write_text(wrong)
        with pytest.raises(jp.ScenarioError, match=words):
            load_observer(tmp_path / "scene.toml")


def test_an_orbit_is_refused_where_it_has_no_place(plan, tmp_path):
    with pytest.raises(ValueError, match="format csv does not say where the spacecraft is"):
        jp.export(plan, tmp_path / "a", format="csv", observer=ORBIT)
    with pytest.raises(TypeError, match="observer must be an orbit"):
        jp.export(plan, tmp_path / "a", format="czml", epoch=EPOCH, observer="ISS")
    with pytest.raises(ValueError, match="format czml needs the UTC of the start"):
        jp.export(plan, tmp_path / "a", format="czml")
    short = sky.Ephemeris.through([0, 10], [[7000, 0, 0], [7000, 75, 0]], [[0, 7.5, 0]] * 2)
    with pytest.raises(ValueError, match=r"is known in \[0, 10\] s"):
        jp.export(plan, tmp_path / "a", format="czml", epoch=EPOCH, observer=short)
    assert not (tmp_path / "a").exists()


@pytest.mark.skipif(
    shutil.which("node") is None or "CESIUM_FOLDER" not in os.environ,
    reason="needs node, and CESIUM_FOLDER, in which `npm i cesium` was run",
)
def test_cesium_has_the_samples_and_takes_small_turns_between_them_for_none(plan, file, tmp_path):
    samples, _ = attitudes(packets(file)["spacecraft"])
    times = np.concatenate([samples, np.random.default_rng(3).uniform(0, 30, 500)])
    (tmp_path / "times.json").write_text(json.dumps(times.tolist()))
    command = ["node", str(READER), os.environ["CESIUM_FOLDER"], str(file), str(tmp_path / "times.json")]
    found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    turned = Rotation.from_quat([row["attitude"] for row in found["rows"]])
    assert off(turned[: len(samples)], plan, samples) < 1e-7
    assert off(turned[len(samples) :], plan, times[len(samples) :]) < 2 * np.arccos(1 - 1e-6) + 1e-6
    here = np.einsum("kij,kj->ki", earth_turning(times), sky.positions(ORBIT, epoch=EPOCH, times=times))
    np.testing.assert_allclose([row["position"] for row in found["rows"]], 1e3 * here, atol=0.01)
    assert found["span"] == pytest.approx(30)
    names = plan.scenario.spacecraft.device_names
    assert [line["name"] for line in found["lines"]] == [*names]

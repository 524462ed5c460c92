"""Kernels of a day as CSPICE reads them: one file without gaps, with numbers and names of the user's."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exports import EPOCH, LEAP_SECONDS, FlownDay, flown_day, flown_plan, load, truth
from reference import assert_each
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.exporting import sampled
from jaxplan.exporting.ck import ticks
from jaxplan.model.epochs import ephemeris_time

spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
pytest.importorskip("erfa", reason="pyerfa is not installed")

NAMES = jp.ExportNames(object_name="EO-1", frame_name="EO1_BUS", naif_id=-2000)
FRAMES = {"EO1_BUS": -2000000, "EO1_TERMINAL_0": -2000001, "EO1_TERMINAL_1": -2000002}
WITHIN = 1e-6  # rad


@pytest.fixture(autouse=True)
def _empty_pool() -> Iterator[None]:
    """SPICE keeps one pool of kernels for the whole process."""
    spice.kclear()
    yield
    spice.kclear()


@pytest.fixture(scope="module")
def day() -> FlownDay:
    return flown_day()


@pytest.fixture(scope="module")
def kernels(day, tmp_path_factory) -> Path:
    """The day, of which each frame has many segments of SPICE."""
    place = tmp_path_factory.mktemp("days") / "day.ck"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sampled, "ROWS", 1000)
        return jp.export(day, place, format="ck", names=NAMES, tolerance_deg=np.rad2deg(0.9 * WITHIN))


def asked_times(day: FlownDay, kernels: Path) -> np.ndarray:
    """Times anywhere in the day, and some microseconds about the ends of its segments and of SPICE's."""
    rng = np.random.default_rng(1)
    duration = day.trajectory.duration
    ends = np.array([part.end for part in day.segments[:-1]])
    spots = np.concatenate([ends, ends - 2e-6, ends + 2e-6, seams(kernels) - load(kernels)])
    return np.unique(
        np.concatenate([rng.uniform(0, duration, 3000), spots[(spots > 0) & (spots < duration)]])
    )


def seams(kernels: Path) -> np.ndarray:
    """Times of TDB at which SPICE's segments of the bus end."""
    load(kernels)
    found = spice.ckcov(
        str(kernels / "attitude.bc"), -2000000, True, "SEGMENT", 0.0, "TDB", spice.cell_double(2000)
    )
    handle, count = spice.dafopr(str(kernels / "attitude.bc")), 0
    spice.dafbfs(handle)
    while spice.daffna():
        count += 1
    spice.dafcls(handle)
    assert count > 3 * 10
    return np.array(list(found))


def test_the_coverage_of_each_frame_is_one_interval(day, kernels):
    start = load(kernels)
    for number in FRAMES.values():
        for level in ("INTERVAL", "SEGMENT"):
            window = spice.ckcov(
                str(kernels / "attitude.bc"), number, True, level, 0.0, "TDB", spice.cell_double(100)
            )
            np.testing.assert_allclose(list(window), [start, start + day.trajectory.duration], atol=3e-6)


def test_attitudes_at_any_instant_are_those_of_the_day(day, kernels):
    times = asked_times(day, kernels)
    start = load(kernels)
    expected = truth(day, times)
    moments = ephemeris_time(np.datetime64(EPOCH, "ns"), times)
    assert abs(moments[0] - times[0] - start) < 1e-6
    matrices = np.stack([spice.pxform("EO1_BUS", "J2000", moment) for moment in moments])
    off = Rotation.from_matrix(np.swapaxes(matrices, 1, 2) @ expected.attitude).magnitude()
    assert_each(off, "<", WITHIN)
    for device, name in enumerate(list(FRAMES)[1:]):
        boresights = np.stack([spice.pxform(name, "J2000", moment)[:, 2] for moment in moments])
        sines = np.linalg.norm(np.cross(boresights, expected.boresights[:, device]), axis=1)
        assert_each(np.sum(boresights * expected.boresights[:, device], axis=1), ">", 0.9)
        assert_each(sines, "<", 2 * WITHIN)  # of the bus and of the device on it
    clock = ticks(moments)
    for moment, tick, attitude, rate in list(
        zip(moments, clock, expected.attitude, expected.rate, strict=True)
    )[::50]:
        assert abs(spice.sce2c(-2000, moment) - tick) <= 1
        found, rates, _ = spice.ckgpav(-2000000, tick, 0.0, "J2000")
        assert Rotation.from_matrix(found @ attitude).magnitude() < WITHIN
        np.testing.assert_allclose(attitude.T @ rates, rate, rtol=0, atol=2e-4)


def test_the_spacecraft_has_its_name_and_the_segments_stand_in_the_comments(day, kernels):
    load(kernels)
    assert spice.bodn2c("EO-1") == -2000
    assert spice.namfrm("EO1_TERMINAL_1") == -2000002
    handle = spice.dafopr(str(kernels / "attitude.bc"))
    _, lines, _ = spice.dafec(handle, 20, 200)
    spice.dafcls(handle)
    text = "\n".join(lines)
    for part in day.segments:
        assert f"  {part.kind}: {part.shown}" in text
    assert "2026-03-01T06:30:45.250000000  2026-03-01T06:45:45.250000000  track: track 1, ?" in text


def test_times_of_a_whole_day_are_those_of_spice():
    lines = LEAP_SECONDS.split("\n")[1:-1]
    spice.lmpool(lines)
    for start, elapsed, date in (
        ("2026-03-01T06:00:00", 86400.0, "2026-03-02T06:00:00"),
        ("2016-12-31T12:00:00", 43200.5, "2016-12-31T23:59:60.5"),
        ("2016-12-31T12:00:00", 86401.0, "2017-01-01T12:00:00"),
    ):
        found = ephemeris_time(np.datetime64(start, "ns"), elapsed)
        assert abs(found - spice.str2et(date)) < 5e-7


def test_a_day_across_a_leap_second_is_found_by_its_utc(tmp_path):
    day = flown_day((30.0, 25.0), epoch="2016-12-31T23:59:40")
    place = jp.export(day, tmp_path / "day.ck", format="ck", step_s=0.1)
    load(place)
    for date, time in (
        ("2016-12-31T23:59:50", 10.0),
        ("2016-12-31T23:59:60.5", 20.5),
        ("2017-01-01T00:00:14", 35.0),
    ):
        found = spice.pxform("JAXPLAN_BUS", "J2000", spice.str2et(date))
        np.testing.assert_allclose(found, truth(day, np.array([time])).attitude[0], rtol=0, atol=1e-6)


def test_kernels_of_two_spacecraft_can_be_loaded_at_once(tmp_path):
    plans = [flown_plan(3), flown_plan(4)]
    for number, plan in enumerate(plans):
        names = jp.ExportNames(
            frame_name=f"SAT{number}_BUS", naif_id=-100 - number, object_name=f"SAT {number}"
        )
        load(jp.export(plan, tmp_path / f"{number}", format="ck", epoch=EPOCH, names=names))
    moment = ephemeris_time(np.datetime64(EPOCH, "ns"), 12.0)
    for number, plan in enumerate(plans):
        found = spice.pxform(f"SAT{number}_BUS", "J2000", moment)
        np.testing.assert_allclose(found, truth(plan, np.array([12.0])).attitude[0], rtol=0, atol=1e-6)
        assert spice.bodn2c(f"SAT {number}") == -100 - number
    assert spice.ktotal("CK") == 2


def test_the_pool_keeps_the_names_of_bodies_that_it_had(tmp_path):
    spice.pcpool("NAIF_BODY_NAME", ["MINE"])
    spice.pdpool("NAIF_BODY_CODE", [-5.0])
    jp.export(flown_plan(), tmp_path / "slew", format="ck", epoch=EPOCH, names=NAMES)
    assert list(spice.gcpool("NAIF_BODY_NAME", 0, 5)) == ["MINE"]
    assert spice.gdpool("NAIF_BODY_CODE", 0, 5).tolist() == [-5.0]


def test_a_folder_with_fields_of_view_may_be_replaced(tmp_path):
    plan = flown_plan()
    craft = plan.scenario.spacecraft
    terminals = tuple(replace(one, field_of_view=np.deg2rad([8.0, 5.0])) for one in craft.terminals)
    seeing = replace(plan, scenario=replace(plan.scenario, spacecraft=replace(craft, terminals=terminals)))
    for _ in range(2):
        place = jp.export(seeing, tmp_path / "slew", format="ck", epoch=EPOCH, overwrite=True)
    assert (place / "instruments.ti").exists()

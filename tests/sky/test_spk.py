"""Ephemeris kernels against CSPICE's own reader, and against the orbits that they were made of."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from exports import LEAP_SECONDS

from jaxplan import schema as sc
from jaxplan import sky
from jaxplan.model.epochs import ephemeris_time

spice = pytest.importorskip("spiceypy", reason="spiceypy is not installed")
pytest.importorskip("erfa", reason="pyerfa is not installed")

EPOCH = "2016-12-31T23:40:00"  # a leap second comes twenty minutes later
TIMES = np.linspace(0.0, 3600.0, 241)
CRAFT, OTHER, ROVER, SUN, EARTH, BARYCENTER = -999, -998, 499, 10, 399, 3
ORBIT = sky.KeplerOrbit(
    semi_major_axis=6978.0, eccentricity=0.01, inclination=1.1, node=0.3, perigee=0.2, anomaly=-0.5
)
FAR = sky.KeplerOrbit(
    semi_major_axis=42164.0, eccentricity=0.2, inclination=0.4, node=1.3, perigee=0.2, anomaly=1.5
)


@pytest.fixture(autouse=True)
def _empty_pool() -> Iterator[None]:
    """SPICE keeps one pool of kernels for the whole process."""
    spice.kclear()
    yield
    spice.kclear()


@pytest.fixture(scope="module")
def start() -> float:
    """The epoch in ephemeris time, as SPICE finds it with the leap seconds of its own kernel."""
    return float(moments([0.0])[0])


def moments(times) -> np.ndarray:
    """Ephemeris times of seconds after the epoch, as SPICE finds them."""
    spice.lmpool(LEAP_SECONDS.splitlines())
    uniform = spice.unitim(spice.str2et(EPOCH), "ET", "TDT")
    found = np.array([spice.unitim(uniform + time, "TDT", "ET") for time in times])
    spice.kclear()
    return found


def states(thing, times) -> np.ndarray:
    """(n, 6) km and km/s."""
    found = (of(thing, epoch=EPOCH, times=times) for of in (sky.positions, sky.velocities))
    return np.concatenate([*found], axis=-1)


def circle(radius: float, period: float, times: np.ndarray, tilt: float = 0.2) -> np.ndarray:
    """(n, 6) km and km/s of a circle."""
    rate = 2 * np.pi / period
    cos, sin = np.cos(rate * times), np.sin(rate * times)
    place = radius * np.stack([cos, sin * np.cos(tilt), sin * np.sin(tilt)], axis=1)
    speed = radius * rate * np.stack([-sin, cos * np.cos(tilt), cos * np.sin(tilt)], axis=1)
    return np.concatenate([place, speed], axis=1)


@pytest.fixture(scope="module")
def kernels(tmp_path_factory, start) -> dict[str, Path]:
    """A kernel of two satellites of the Earth, and one of the Sun's family, along the ecliptic, with gaps."""
    folder = tmp_path_factory.mktemp("kernels")
    files = {name: folder / f"{name}.bsp" for name in ("craft", "planets", "correction")}
    close, wide = np.arange(-300.0, 3901.0, 60.0), np.arange(-86400.0, 90001.0, 3600.0)
    begin, end = start, start + 3600.001
    handle = spice.spkopn(str(files["craft"]), "test", 0)
    own, far = states(ORBIT, close), states(FAR, close)
    spice.spkw13(handle, CRAFT, EARTH, "J2000", begin, end, "hermite", 7, len(close), own, moments(close))
    for span in ((begin, start + 1000.0), (start + 1200.0, end)):  # with a gap
        spice.spkw09(handle, OTHER, EARTH, "J2000", *span, "lagrange", 7, len(close), far, moments(close))
    spice.spkcls(handle)
    handle = spice.spkopn(str(files["planets"]), "test", 0)
    for body, center, frame, motion in (
        (SUN, 0, "J2000", circle(7e5, 4e8, wide)),
        (BARYCENTER, 0, "ECLIPJ2000", circle(1.496e8, 3.156e7, wide)),
        (EARTH, BARYCENTER, "J2000", circle(4700.0, 2.36e6, wide)),
        (4, 0, "ECLIPJ2000", circle(2.28e8, 5.94e7, wide, 0.03)),
        (ROVER, 4, "J2000", circle(1e4, 1e5, wide)),
    ):
        ends = start + wide[[0, -1]]
        spice.spkw13(handle, body, center, frame, *ends, "hermite", 7, len(wide), motion, start + wide)
    spice.spkcls(handle)
    handle = spice.spkopn(str(files["correction"]), "test", 0)
    moved = own + np.eye(6)[0] * 5.0
    late = start + 1800.0
    spice.spkw13(handle, CRAFT, EARTH, "J2000", late, end, "moved", 7, len(close), moved, moments(close))
    spice.spkcls(handle)
    return files


def test_positions_are_those_of_spice_through_all_centres_and_axes(kernels):
    paths = [kernels[name] for name in ("planets", "craft")]
    asked = ephemeris_time(np.datetime64(EPOCH, "ns"), TIMES)
    np.testing.assert_allclose(asked, moments(TIMES), rtol=0, atol=2e-7)  # each rounded to 6e-8 s
    for body in (CRAFT, SUN, ROVER):
        found = states(sky.read_spk(paths, body), TIMES)
        spice.furnsh([str(path) for path in paths])
        expected = np.array([spice.spkgeo(body, moment, "J2000", EARTH)[0] for moment in asked])
        spice.kclear()
        size = np.abs(expected).max(axis=0)
        assert np.all(np.abs(found - expected).max(axis=0) <= 1e-14 * size + 1e-9), body
    one = sky.read_spk(str(kernels["craft"]), CRAFT)  # which is known from the Earth without the others
    assert sky.positions(one, epoch=EPOCH, times=40.0).shape == (3,)
    assert sky.velocities(one, epoch=EPOCH, times=[0.0, 1.0]).shape == (2, 3)


def test_times_and_axes_are_those_of_the_orbit_that_was_written(kernels):
    off = states(sky.read_spk(kernels["craft"], CRAFT), TIMES) - states(ORBIT, TIMES)
    assert np.linalg.norm(off[:, :3], axis=1).max() < 2e-6  # km, over a leap second
    assert np.linalg.norm(off[:, 3:], axis=1).max() < 1e-7


def test_of_two_kernels_the_later_one_counts(kernels):
    one, other = kernels["craft"], kernels["correction"]
    plain = states(sky.read_spk(one, CRAFT), TIMES)
    late = TIMES > 1800.0 + 1e-3
    moved = states(sky.read_spk([one, other], CRAFT), TIMES) - plain
    np.testing.assert_allclose(moved[late, 0], 5.0, atol=1e-9)
    np.testing.assert_allclose(moved[TIMES < 1800.0 - 1e-3], 0.0, atol=1e-12)
    np.testing.assert_allclose(states(sky.read_spk([other, one], CRAFT), TIMES), plain, atol=1e-12)


def test_what_a_user_has_loaded_neither_counts_nor_changes(kernels, start):
    spice.furnsh(str(kernels["correction"]))
    plain = states(sky.read_spk(kernels["craft"], CRAFT), [3000.0])
    own = spice.spkgeo(CRAFT, start + 3000.0, "J2000", EARTH)[0]
    assert np.isclose(own[0] - plain[0, 0], 5.0)
    again = sky.read_spk(kernels["correction"], CRAFT)  # the very file that is loaded
    assert np.allclose(states(again, [3000.0])[0], own, atol=1e-9)
    assert spice.ktotal("ALL") == 1
    assert np.array_equal(spice.spkgeo(CRAFT, start + 3000.0, "J2000", EARTH)[0], own)


def test_nothing_is_told_beyond_what_kernels_know(kernels):
    craft, other = (sky.read_spk(kernels["craft"], number) for number in (CRAFT, OTHER))
    for thing, asked in ((craft, -1e-5), (craft, [1.0, 3600.01]), (other, 1100.0)):
        with pytest.raises(sky.EphemerisError, match=r"asked for 20.*, is known in \[20") as raised:
            sky.positions(thing, epoch=EPOCH, times=asked)
        told, *ends = re.findall(r"2\d{3}-[^], ]*", str(raised.value))
        spans = zip(ends[::2], ends[1::2], strict=True)
        assert not any(
            np.datetime64(first) <= np.datetime64(told) <= np.datetime64(last) for first, last in spans
        )
    with pytest.raises(sky.EphemerisError, match=r"08\.\d+, 2016-12-31T23:57:48\.\d+\] and \[2017-01-01"):
        sky.positions(other, epoch=EPOCH, times=1100.0)
    assert sky.positions(other, epoch=EPOCH, times=[999.0, 1201.0]).shape == (2, 3)
    before = sky.positions(craft, epoch=EPOCH, times=[1e-6, -4e-7])  # times are rounded, so it gives way
    assert np.linalg.norm(np.diff(before, axis=0)) < 1e-5


def test_kernels_that_do_not_do_are_refused(kernels, tmp_path, start):
    paper = tmp_path / "paper.bsp"
    paper.write_text("no kernel\n" * 200)
    wheel = tmp_path / "ck.bsp"
    handle = spice.ckopn(str(wheel), "test", 0)
    spice.ckw03(
        handle,
        0.0,
        1.0,
        -1,
        "J2000",
        False,
        "x",
        2,
        [0.0, 1.0],
        np.eye(4)[[0, 0]],
        np.zeros((2, 3)),
        1,
        [0.0],
    )
    spice.ckcls(handle)
    turning = tmp_path / "turning.bsp"
    handle = spice.spkopn(str(turning), "test", 0)
    times = np.arange(0.0, 700.0, 60.0)
    arguments = (start, start + 600.0, "hermite", 7, len(times), circle(7000.0, 6000.0, times), start + times)
    spice.spkw13(handle, CRAFT, EARTH, "ITRF93", *arguments)
    spice.spkw13(handle, OTHER, EARTH, "J2000", *arguments[:5], arguments[5] * 0.5, arguments[6])
    spice.spkcls(handle)
    for paths, number, words in (
        (kernels["craft"], -987, r"craft.bsp: have no body -987 \(-987\), but -999, -998"),
        (kernels["planets"], EARTH, "number = 399: is the Earth"),
        (kernels["planets"], "MARS", "number = 'MARS': must be a whole number"),
        ([], CRAFT, "paths: must name a kernel"),
        (paper, CRAFT, "paper.bsp: no SPK kernel$"),
        (wheel, CRAFT, "ck.bsp: no SPK kernel but DAF CK"),
        (turning, CRAFT, "axes number 13000 of -999 are not known to be inertial"),
    ):
        with pytest.raises(sky.EphemerisError, match=words):
            sky.read_spk(paths, number)
    with pytest.raises(FileNotFoundError):
        sky.read_spk(tmp_path / "absent.bsp", CRAFT)
    with pytest.raises(sky.EphemerisError, match="is 3500 km from the Earth's centre, inside it, 1 s after"):
        sky.positions(sky.read_spk(turning, OTHER), epoch=EPOCH, times=1.0)
    alone = tmp_path / "alone.bsp"
    handle = spice.spkopn(str(alone), "test", 0)
    spice.spkw13(handle, CRAFT, SUN, "J2000", *arguments)
    spice.spkcls(handle)
    with pytest.raises(
        sky.EphemerisError, match=r"from \[10\] and not from the Earth \(399\): give a planetary"
    ):
        sky.read_spk(alone, CRAFT)


SCENE = """
schema_version = 1
name = "kernels"
[spacecraft]
rate_limit_deg_s = 1.0
acceleration_limit_deg_s2 = 0.5
[[spacecraft.instrument]]
name = "camera"
boresight = [0, 0, 1]
[start]
attitude = [0, 0, 0]
[goal]
targets = { camera = "mars" }
[sky]
epoch_utc = 2016-12-31T23:40:00
for_duration_s = 600
observer = { spk = "craft.bsp", naif_id = -999 }
[[sky.satellite]]
name = "mars"
orbit = { spk = ["planets.bsp", "craft.bsp"], naif_id = 499 }
[[keep_out]]
name = "down"
direction = "nadir"
half_angle_deg = 20
"""


def test_a_scene_may_have_its_observer_and_targets_from_kernels(kernels):
    folder = kernels["craft"].parent
    scene = sc.parse_scenario(SCENE, folder=folder)
    times = np.linspace(0.0, 600.0, 61)
    here, there = states(ORBIT, times)[:, :3], states(sky.read_spk(kernels["planets"], ROVER), times)[:, :3]
    line = there - here
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    np.testing.assert_allclose(scene.goal.directions[0].at(times), line, atol=2e-9)
    down = -here / np.linalg.norm(here, axis=1, keepdims=True)
    np.testing.assert_allclose(scene.keep_out[0].direction.at(times), down, atol=2e-9)
    for old, new, said in (
        ('"craft.bsp", naif', '"gone.bsp", naif', "sky.observer.spk: .*gone.bsp: cannot be read: No"),
        ("naif_id = -999 }", "naif_id = -987 }", "sky.observer.spk: .*have no body -987"),
        ("naif_id = -999 }", "naif_id = 1.5 }", "naif_id = 1.5: must be an integer in"),
        (", naif_id = -999 }", " }", "sky.observer.naif_id: missing, must be an integer"),
        ("-999 }", "-999, tle = [] }", "spk and naif_id stand beside what says all of the orbit, tle"),
        ('spk = "craft.bsp"', "spk = 3", "sky.observer.spk = 3: must be the path of an SPK kernel"),
        ("for_duration_s = 600", "for_duration_s = 4000", "sky.observer: .*asked for .*, is known in"),
    ):  # fmt: skip
        assert old in SCENE, old
        with pytest.raises(sc.ScenarioError, match=said):
            sc.parse_scenario(SCENE.replace(old, new, 1), folder=folder)

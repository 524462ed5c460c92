"""Ephemerides: samples against Keplerian truth between them, and messages of CCSDS in all time systems."""

import dataclasses

import numpy as np
import pytest

from jaxplan import sky
from jaxplan.sky import frames

EPOCH = "2026-06-20T09:30:00"
CIRCLE = sky.KeplerOrbit(
    semi_major_axis=6878.0, eccentricity=0.0, inclination=1.7, node=0.3, perigee=0.2, anomaly=-0.5
)
ELLIPSE = sky.KeplerOrbit(
    semi_major_axis=26600.0, eccentricity=0.7, inclination=1.1, node=0.3, perigee=0.2, anomaly=-0.5
)
NEAR = sky.KeplerOrbit(
    semi_major_axis=6978.0, eccentricity=0.01, inclination=1.1, node=0.3, perigee=0.2, anomaly=-0.5
)


def states(orbit, times):
    return tuple(of(orbit, epoch=EPOCH, times=times) for of in (sky.positions, sky.velocities))


def errors(orbit, step, with_velocities, count=30):
    """Times, and by how much positions (km) and velocities (km/s) between samples are off."""
    times = np.arange(count) * step
    position, velocity = states(orbit, times)
    found = sky.Ephemeris.through(times, position, velocity if with_velocities else None)
    dense = np.linspace(0, times[-1], 97 * count)
    off = [
        np.linalg.norm(one - other, axis=1)
        for one, other in zip(states(found, dense), states(orbit, dense), strict=True)
    ]
    return dense, *off


@pytest.mark.parametrize("step", [60.0, 180.0, 300.0, 420.0])
def test_between_samples_the_error_is_what_the_module_says(step):
    phi8 = 6878.0 * (np.sqrt(398600.4418 / 6878.0**3) * step) ** 8
    dense, off, off_rate = errors(CIRCLE, step, True)
    assert off.max() <= 3e-5 * phi8 + 1e-10
    assert off_rate.max() <= 3e-3 * phi8 / step + 1e-11
    dense, off, _ = errors(CIRCLE, step, False)
    inner = (dense > 3 * step) & (dense < 26 * step)
    assert off[inner].max() <= 1.2e-3 * phi8 + 1e-10
    assert off.max() <= 0.02 * phi8 + 1e-10
    assert off.max() > 0.005 * phi8  # nothing but the samples is known to it


@pytest.mark.parametrize(("orbit", "factor"), [(NEAR, 2.2), (ELLIPSE, 120)])
def test_on_an_eccentric_orbit_the_error_is_larger_by_what_the_module_says(orbit, factor):
    a, e = orbit.semi_major_axis, orbit.eccentricity
    at_perigee = np.sqrt(398600.4418 / a**3) * np.sqrt(1 - e * e) / (1 - e) ** 2
    for step in (60.0, 180.0, 300.0):
        phi8 = a * (1 - e) * (at_perigee * step) ** 8
        assert errors(orbit, step, True)[1].max() <= 3e-5 * factor * phi8 + 1e-10
        assert errors(orbit, step, False)[1].max() <= 0.02 * factor * phi8 + 1e-10


def test_samples_are_passed_and_few_of_them_do_with_a_lower_degree():
    times = np.array([0.0, 40.0, 75.0, 130.0, 200.0])
    position, velocity = states(CIRCLE, times)
    for count in (2, 3, 5):
        found = sky.Ephemeris.through(times[:count], position[:count], velocity[:count])
        for own, given in zip(states(found, times[:count]), (position, velocity), strict=True):
            np.testing.assert_allclose(own, given[:count], rtol=1e-13, atol=1e-12)
        between = np.linspace(0, times[count - 1], 50)
        assert np.linalg.norm(states(found, between)[0] - states(CIRCLE, between)[0], axis=1).max() < 1e-3
    assert sky.positions(found, epoch=EPOCH, times=40.0).shape == (3,)


def test_nothing_is_extrapolated():
    times = np.linspace(0, 600, 11)
    found = sky.Ephemeris.through(times, *states(CIRCLE, times), name="one")
    for asked in (-0.1, [3.0, 600.1]):
        with pytest.raises(
            sky.EphemerisError, match=r"of one: asked for .* s after the epoch, is known in \[0, 600\] s"
        ):
            sky.positions(found, epoch=EPOCH, times=asked)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"times": [0, 1, 1, 3, 4]}, r"times\[2\] = 1: must be later than the one before, 1"),
        ({"times": [0, 1, 2]}, r"must be \(n,\), \(n, 3\) and \(n, 3\) or None, n at least 4, not \(3,\)"),
        (
            {"times": [0, 1], "positions": 7e3 * np.ones((2, 3))},
            "must be at 4 times or more, or 2 with velocities, not 2",
        ),
        ({"times": [0, 1, np.nan, 3, 4]}, r"times\[2\] = nan: must be finite"),
        (
            {"positions": np.full((5, 3), 100.0)},
            r"positions\[0\] = .*: is 173.205 km from the Earth's centre",
        ),
        ({"positions": 7e3 * np.eye(3)[[0, 1, 2, 0, 1]]}, r"positions\[1\]: is 90 deg from the one before"),
        ({"velocities": np.ones((4, 3))}, r"n at least 2, not \(5,\), \(5, 3\) and \(4, 3\)"),
        ({"velocities": "fast"}, "velocities"),
        ({"epoch": "soon"}, "epoch = 'soon'"),
    ],
)
def test_samples_that_are_no_motion_are_refused(change, words):
    times = np.arange(5.0)
    given = {"times": times, "positions": states(CIRCLE, times)[0]} | change
    with pytest.raises((ValueError, TypeError), match=words):
        sky.Ephemeris.through(**given)


@pytest.mark.parametrize("orbit", [CIRCLE, NEAR, ELLIPSE])
def test_velocities_agree_with_positions_at_all_steps_that_are_allowed(orbit):
    # two revolutions, by steps of 40 deg seen from the Earth's centre
    anomalies = np.deg2rad(np.arange(-360, 361, 40.0))
    half = np.arctan(np.sqrt((1 - orbit.eccentricity) / (1 + orbit.eccentricity)) * np.tan(anomalies / 2))
    eccentric = 2 * (half + np.pi * np.round(anomalies / (2 * np.pi)))
    motion = np.sqrt(398600.4418 / orbit.semi_major_axis**3)
    times = (eccentric - orbit.eccentricity * np.sin(eccentric)) / motion
    at_perigee = dataclasses.replace(orbit, anomaly=0.0)
    sky.Ephemeris.through(times, *states(at_perigee, times))
    close = np.sort(np.concatenate([times, times + 1.0]))
    sky.Ephemeris.through(close, *states(at_perigee, close))


@pytest.mark.parametrize("step", [1.0, 60.0, 400.0])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, v: (p, -v), r"positions\[0\] and \[1\]: are \[.*\] km apart, but in .* s the velocities"),
        (lambda p, v: (p, 1e3 * v), "give velocities in km/s"),
        (lambda p, v: (p, 0 * v), r"lead \[0, -?0, 0\] km"),
        (lambda p, v: (p, np.roll(v, 1, axis=1)), "along the same axes"),
        (
            lambda p, v: (1e3 * p, 1e3 * v),
            r"positions\[0\] = .*: must lie in \[-3000000, 3000000\], it is in km",
        ),
    ],
)
def test_samples_in_other_units_or_with_velocities_of_another_motion_are_refused(step, change, words):
    times = np.arange(5) * step
    with pytest.raises(sky.EphemerisError, match=words):
        sky.Ephemeris.through(times, *change(*states(CIRCLE, times)))


def test_rounded_samples_one_second_apart_are_taken():
    times = np.arange(30.0)
    position, velocity = states(CIRCLE, times)
    sky.Ephemeris.through(times, np.round(position, 1), np.round(velocity, 2))


# What a message has, beside the states; its times are those of UTC unless told.
HEAD = "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-06-20T00:00:00\nORIGINATOR = TEST\n"
META = {
    "OBJECT_NAME": "EO-1",
    "OBJECT_ID": "2026-001A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "EME2000",
    "TIME_SYSTEM": "UTC",
}


def segment(dates, orbit, times, **meta):
    """The text of a segment with the states of an orbit at times after the epoch."""
    own = META | {"START_TIME": dates[0], "STOP_TIME": dates[-1]} | meta
    keys = "\n".join(f"{key} = {value}" for key, value in own.items() if value)
    rows = [
        f"{date} {' '.join(f'{number:.15g}' for number in (*position, *velocity))}"
        for date, position, velocity in zip(dates, *states(orbit, times), strict=True)
    ]
    return f"META_START\n{keys}\nMETA_STOP\n" + "\n".join(rows) + "\n"


def dates_of(times, since="2026-06-20T09:30:00", ahead=0.0):
    stamps = np.datetime64(since, "us") + np.round((np.asarray(times) + ahead) * 1e6).astype(
        "timedelta64[us]"
    )
    return [str(stamp) for stamp in stamps]


TIMES = np.arange(0, 1801, 60.0)
needs_reader = pytest.mark.usefixtures("reader")


@pytest.fixture(name="reader")
def fixture_reader():
    pytest.importorskip("erfa", reason="pyerfa is not installed")
    return pytest.importorskip("ccsds_ndm", reason="ccsds-ndm-py is not installed")


def written(folder, text):
    path = folder / "orbit.oem"
    path.write_text(text)
    return path


@needs_reader
@pytest.mark.parametrize(
    ("system", "ahead"),  # of UTC in 2026
    [("UTC", 0.0), ("TAI", 37.0), ("TT", 69.184), ("TDB", 69.184), ("GPS", 18.0)],
)
def test_a_message_is_read_in_every_time_system(tmp_path, system, ahead):
    text = HEAD + segment(dates_of(TIMES, ahead=ahead), NEAR, TIMES, TIME_SYSTEM=system)
    found = sky.read_oem(written(tmp_path, text))
    asked = np.linspace(0, 1800, 401)
    assert found.name == "EO-1"
    for own, true in zip(states(found, asked), states(NEAR, asked), strict=True):
        np.testing.assert_allclose(own, true, atol=1e-5)  # a microsecond of its way


@needs_reader
def test_a_message_in_xml_and_days_of_the_year_is_the_same(tmp_path, reader):
    plain = HEAD + segment(dates_of(TIMES), NEAR, TIMES)
    by_days = plain.replace("2026-06-20T09", "2026-171T09").replace("2026-06-20T10", "2026-171T10")
    xml = reader.Oem.from_str(plain).to_str("xml")
    expected = states(sky.read_oem(written(tmp_path, plain)), TIMES + 0.0)
    for text in (by_days, xml):
        found = states(sky.read_oem(written(tmp_path, text)), TIMES)
        np.testing.assert_allclose(found, expected, rtol=1e-14, atol=1e-9)


@needs_reader
def test_leap_seconds_are_counted(tmp_path):
    times = np.arange(0, 601, 50.0)
    dates = [*dates_of(times[:6], "2016-12-31T23:55:00"), "2016-12-31T23:59:60.000"]
    dates += dates_of(times[7:], "2016-12-31T23:55:00", ahead=-1.0)
    found = sky.read_oem(written(tmp_path, HEAD + segment(dates, CIRCLE, times)))
    at = sky.positions(found, epoch="2016-12-31T23:55:00", times=[10.0, 290.0, 330.0, 580.0])
    np.testing.assert_allclose(at, states(CIRCLE, [10.0, 290.0, 330.0, 580.0])[0], atol=1e-5)


@needs_reader
def test_segments_are_interpolated_each_by_itself_within_its_useable_times(tmp_path):
    # a burn at 900 s: another orbit from there on, and samples of both beyond it
    useable = dates_of([900.0])[0]
    first = segment(dates_of(TIMES[:19]), NEAR, TIMES[:19], USEABLE_STOP_TIME=useable)
    second = segment(dates_of(TIMES[12:]), CIRCLE, TIMES[12:], USEABLE_START_TIME=useable)
    found = sky.read_oem(written(tmp_path, HEAD + first + second))
    for asked, orbit in ((np.linspace(0, 899.9, 200), NEAR), (np.linspace(900, 1800, 200), CIRCLE)):
        np.testing.assert_allclose(states(found, asked)[0], states(orbit, asked)[0], atol=1e-7)


@needs_reader
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("CENTER_NAME = EARTH", "CENTER_NAME = MARS", "segment 0, CENTER_NAME = MARS: must be EARTH"),
        ("EME2000", "ITRF2000", "segment 0, REF_FRAME = ITRF2000: must be GCRS or "),
        ("= UTC", "= MET", "segment 0, TIME_SYSTEM = MET: must be UTC or TAI"),
        (
            "CENTER_NAME = EARTH\n",
            "",
            r"orbit.oem: no Orbit Ephemeris Message \(Missing required field: CENTER",
        ),
        ("CCSDS_OEM_VERS", "CCSDS_OPM_VERS", "no Orbit Ephemeris Message"),
        ("2026-06-20T09:35:00 ", "2026-06-20T09:34:00 ", "must be later than the one before"),
        ("2026-06-20T09:35:00 ", "2026-06-20T9:35 ", "no Orbit Ephemeris Message"),
        ("2026-06-20T09:35:00 ", "2026-366T09:35:00 ", "'2026-366T09:35:00': the year 2026 has no day 366"),
        ("2026-06-20", "1960-06-20", "must lie in the years 1972 to 2099"),
        (
            "2026-06-20T09:35:00 ",
            "2026-06-20T09:35:40 ",
            r"orbit.oem: segment 0, positions\[4\] and \[5\]: are",
        ),
        ("META_STOP", "USEABLE_STOP_TIME = 2026-06-21T00:00:00\nMETA_STOP", "useable times"),
    ],
)
def test_a_message_that_cannot_be_used_says_why(tmp_path, old, new, words):
    text = HEAD + segment([date[:19] for date in dates_of(TIMES)], NEAR, TIMES)
    assert old in text
    with pytest.raises(sky.EphemerisError, match=words):
        sky.read_oem(written(tmp_path, text.replace(old, new)))


def test_a_missing_reader_is_named(monkeypatch, tmp_path):
    def absent(name):
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(frames, "import_module", absent)
    with pytest.raises(ImportError, match=r"ccsds-ndm-py is missing: pip install 'jaxplan\[oem\]'"):
        sky.read_oem(written(tmp_path, HEAD))

"""Two-line elements: SGP4's published verification, and everything that may be wrong with the lines."""

import pickle
from pathlib import Path

import numpy as np
import pytest
from heavens import teme_to_j2000
from hypothesis import given
from hypothesis import strategies as st
from reference import assert_each

from jaxplan import sky
from jaxplan.sky import frames, orbits
from jaxplan.sky.two_line_elements import check_sum, tle_state_teme

api = pytest.importorskip("sgp4.api", reason="sgp4 is not installed")
PUBLISHED = Path(api.__file__).parent
pytest.importorskip("erfa", reason="pyerfa is not installed")

ISS = """\
ISS (ZARYA)
1 25544U 98067A   24079.07757601  .00016717  00000-0  30270-3 0  9992
2 25544  51.6400 208.9163 0006317  69.9862  25.2906 15.49560532444998
"""
NAME, ONE, TWO = ISS.splitlines()


def signed(line):
    """The line with the check sum that it should have."""
    return line[:68] + str(check_sum(line))


def put(line, column, text):
    """The line with other characters from a column on, counted from one, and a right check sum."""
    return signed(line[: column - 1] + text + line[column - 1 + len(text) :])


def vectors():
    """The published answers by catalogue number: minutes, then position and velocity in TEME."""
    found, rows = {}, []
    for line in (PUBLISHED / "tcppver.out").read_text().splitlines():
        if line.endswith("xx"):
            rows = found.setdefault(line.split()[0], [])
        else:
            rows.append([float(word) for word in line.split()[:7]])
    return {number: np.array(rows) for number, rows in found.items()}


def published():
    """The pairs of lines of the published set, by catalogue number, without what stands behind column 69."""
    text = (PUBLISHED / "SGP4-VER.TLE").read_text()
    lines = [line[:69] for line in text.splitlines() if line[:2] in ("1 ", "2 ")]
    return {
        one[2:7].strip().lstrip("0"): f"{one}\n{two}"
        for one, two in zip(lines[::2], lines[1::2], strict=True)
    }


ANSWERS, LINES = vectors(), published()
REFUSED = ("33333", "33334", "33335")  # made up by changing others, so that their check sums are wrong
FLOWN = [number for number in ANSWERS if number not in REFUSED]


def test_the_published_set_is_large():
    assert len(FLOWN) > 25


@pytest.mark.parametrize("number", FLOWN)
def test_published_positions_are_met(number):
    rows = ANSWERS[number]
    rows = rows[np.abs(rows[:, 0]) < 7 * 1440]
    tle = sky.parse_tle(LINES[number])
    position, velocity = tle_state_teme(tle, 60 * rows[:, 0])
    np.testing.assert_allclose(position, rows[:, 1:4], rtol=0, atol=1e-8)  # the last printed digit
    np.testing.assert_allclose(velocity, rows[:, 4:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("number", REFUSED)
def test_broken_lines_of_the_published_set_are_refused(number):
    with pytest.raises(sky.TleError, match=r"line [12]"):
        sky.parse_tle(LINES[number])


def test_names_epochs_and_numbers_are_read():
    tle = sky.parse_tle(f"\n0 {NAME}  \r\n{ONE}\r\n{TWO}   \n\n")
    assert tle == sky.parse_tle(ISS)
    assert tle.name == "ISS (ZARYA)"
    assert tle.epoch == np.datetime64("2024-03-19T01:51:42.567264000", "ns")  # 0.07757601 of a day
    assert sky.parse_tle(f"{ONE}\n{TWO}").name == "25544"
    old = sky.parse_tle(f"{put(ONE, 19, '99365.00000000')}\n{TWO}")
    assert old.epoch == np.datetime64("1999-12-31", "ns")
    alpha = sky.parse_tle(f"{put(ONE, 3, 'T0001')}\n{put(TWO, 3, 'T0001')}")
    assert alpha.name == "T0001"


@pytest.mark.parametrize(
    ("one", "two", "fault"),
    [
        (ONE[:-1] + "3", TWO, "line 1, column 69 (check sum) = 3: the line adds up to 2"),
        (ONE[:-1] + "x", TWO, "line 1, column 69 (check sum) = 'x': must be a digit"),
        (ONE[:-1], TWO, "line 1 has 68 characters, must have 69"),
        (ONE, TWO + "1", "line 2 has 70 characters, must have 69"),
        (TWO, TWO, "line 1 = '2 25544  51.'...: must begin with '1 '"),
        (ONE, "3" + TWO[1:], "line 2 = '3 25544  51.'...: must begin with '2 '"),
        (ONE, put(TWO, 3, "25545"), "line 2 is of satellite '25545', line 1 of '25544'"),
        (
            ONE,
            put(TWO, 9, " 51.64oo"),
            "line 2, columns 9 to 16 (inclination) = ' 51.64oo': must be written as in",
        ),
        (ONE, put(TWO, 9, "     nan"), "(inclination) = '     nan': must be written as in ' 51.6400'"),
        (
            ONE,
            put(TWO, 9, "181.0000"),
            "line 2, columns 9 to 16 (inclination) = '181.0000': must lie in [0, 180]",
        ),
        (ONE, put(TWO, 9, "51.6400 "), "(inclination) = '51.6400 '"),
        (
            ONE,
            put(TWO, 18, "360.0001"),
            "(right ascension of the ascending node) = '360.0001': must lie in [0, 360]",
        ),
        (ONE, put(TWO, 27, "0.00631"), "(eccentricity after the decimal point) = '0.00631'"),
        (ONE, put(TWO, 35, "-69.9862"), "(argument of perigee) = '-69.9862'"),
        (ONE, put(TWO, 44, "400.0000"), "(mean anomaly) = '400.0000': must lie in [0, 360]"),
        (ONE, put(TWO, 53, " 0.00000000"), "(mean motion) = ' 0.00000000': must lie in [0.001, 18]"),
        (ONE, put(TWO, 17, "7"), "line 2, column 17 = '7': must be blank"),
        (put(ONE, 9, "x"), TWO, "line 1, column 9 = 'x': must be blank"),
        (
            put(ONE, 21, "367.00000000"),
            TWO,
            "(day of the epoch) = '367.00000000': must lie in [1, 366.99999999]",
        ),
        (
            put(ONE, 19, "26366.00000000"),
            TWO,
            "(day of the epoch) = '366.00000000': must be below 366, since 2026 has 365 days",
        ),
        (put(ONE, 21, "079,07757601"), TWO, "columns 21 to 32 (day of the epoch) = '079,07757601'"),
        (put(ONE, 19, "7a"), TWO, "columns 19 to 20 (year of the epoch) = '7a'"),
        (put(ONE, 19, "71"), TWO, "(year of the epoch) = '71': before 1972"),
        (put(ONE, 54, " 3027e-3"), TWO, "(drag term B*) = ' 3027e-3'"),
        (put(ONE, 10, "\u00e9"), TWO, "line 1, column 10 = '\u00e9': must be ASCII"),
        (ONE, put(TWO, 12, "\u0661"), "line 2, column 12"),  # a digit, but not of these
        ("", TWO, "must be two lines, or three with a name first, not 1"),
    ],
)
def test_a_bad_line_is_the_one_fault_with_columns_and_value(one, two, fault):
    with pytest.raises(sky.TleError) as caught:
        sky.parse_tle(f"{one}\n{two}")
    assert len(caught.value.faults) == 1
    assert fault in str(caught.value)


def test_every_wrong_digit_is_found():
    """A check sum finds each, whatever column it is in."""
    for number, line in enumerate((ONE, TWO)):
        for place, character in enumerate(line):
            if character.isdigit():
                changed = line[:place] + str((int(character) + 1) % 10) + line[place + 1 :]
                pair = [ONE, TWO]
                pair[number] = changed
                with pytest.raises(sky.TleError):
                    sky.parse_tle("\n".join(pair))


@given(st.data())
def test_lines_with_any_other_characters_are_refused_or_fly(data):
    pair = [ONE, TWO]
    for _ in range(data.draw(st.integers(1, 3))):
        number, place = data.draw(st.integers(0, 1)), data.draw(st.integers(1, 68))
        pair[number] = put(pair[number], place, data.draw(st.sampled_from("0123456789 .-+A\u0664")))
    try:
        tle = sky.parse_tle("\n".join(pair))
        position = sky.positions(tle, epoch=tle.epoch, times=[0.0, 80.0])
    except sky.TleError:
        return
    assert_each(np.linalg.norm(position, axis=-1), ">", 6300)


@given(st.text(max_size=200))
def test_other_texts_are_refused(text):
    with pytest.raises(sky.TleError):
        sky.parse_tle(text)


def test_all_faults_come_at_once_and_survive_pickling():
    with pytest.raises(sky.TleError, match=r"with 3 faults:\n  line 1.*\n  line 2.*\n  line 2") as caught:
        sky.parse_tle(f"{ONE[:-1]}\n{put(put(TWO, 9, '999.0000'), 44, 'abc.defg')}")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_passes_of_old_elements_warn_once_with_their_greatest_age():
    lisbon = sky.GroundPoint(latitude=0.676, longitude=-0.159)
    with pytest.warns(sky.StaleTleWarning) as told:
        sky.passes(lisbon, epoch="2024-03-29T12:00:00", observer=sky.parse_tle(ISS), duration_s=86400.0)
    (warning,) = told
    assert "11.4 days" in str(warning.message)


def test_old_elements_warn_and_very_old_ones_are_refused():
    tle = sky.parse_tle(ISS)
    sky.positions(tle, epoch="2024-03-26T01:00:00", times=[0.0, 80.0])
    with pytest.warns(sky.StaleTleWarning, match=r"7\.5 days from the elements' epoch 2024-03-19"):
        sky.positions(tle, epoch="2024-03-26T13:00:00")
    with pytest.warns(sky.StaleTleWarning, match=r"-12\.1 days"):
        sky.positions(tle, epoch="2024-03-07T00:00:00")
    with pytest.raises(
        sky.TleError, match=r"653\.4 days from the elements' epoch .* must lie in \[-30, 30\]"
    ):
        sky.positions(tle, epoch="2026-01-01T12:00:00")
    with pytest.raises(sky.TleError, match=r"31\.\d days"):
        sky.positions(tle, epoch="2024-03-19T02:00:00", times=[0.0, 31.5 * 86400])


def test_a_decayed_satellite_is_an_error_with_its_time():
    decaying = sky.parse_tle(LINES["28872"])  # lost within 50 minutes
    sky.positions(decaying, epoch=decaying.epoch, times=[0.0, 1200.0])
    with pytest.raises(
        sky.TleError, match=r"28872: the satellite has decayed, 0\.03\d+ days from the elements' epoch"
    ):
        sky.positions(decaying, epoch=decaying.epoch, times=[0.0, 3300.0])
    one, two = LINES["33333"].splitlines()  # the published case of error 4
    broken = sky.parse_tle(f"{signed(one)}\n{signed(two)}")
    with pytest.raises(sky.TleError, match=r"33333: the semi-latus rectum is negative, 0\.104167 days"):
        sky.positions(broken, epoch=broken.epoch, times=9000.0)


def test_positions_are_those_of_sgp4_turned_by_the_handbooks_frames():
    tle = sky.parse_tle(ISS)
    utc = "2024-03-20T12:00:00"
    record = api.Satrec.twoline2rv(ONE, TWO)
    code, position, velocity = record.sgp4(*api.jday(2024, 3, 20, 12, 0, 0))
    assert code == 0
    turned = teme_to_j2000(utc) @ np.array([position, velocity]).T
    np.testing.assert_allclose(sky.positions(tle, epoch=utc), turned[:, 0], atol=0.05)
    np.testing.assert_allclose(sky.velocities(tle, epoch=utc), turned[:, 1], atol=6e-5)


def test_velocity_is_the_derivative_of_position():
    tle = sky.parse_tle(ISS)
    around = sky.positions(tle, epoch=tle.epoch, times=[99.5, 100.5])
    # SGP4's own velocity is off by what its theory leaves out
    np.testing.assert_allclose(
        sky.velocities(tle, epoch=tle.epoch, times=100.0), np.diff(around, axis=0)[0], atol=2e-3
    )


def test_a_circular_orbit_is_met_to_the_size_of_the_earths_oblateness():
    two = put(put(put(TWO, 27, "0000001"), 35, "  0.0000"), 44, " 40.0000")
    tle = sky.parse_tle(f"{put(ONE, 54, ' 00000-0')}\n{two}")
    rate = 15.49560532 * 2 * np.pi / 86400
    altitude = (frames.EARTH_MU / rate**2) ** (1 / 3) - frames.EARTH_RADIUS
    times = np.arange(0.0, 601.0, 100.0)
    kepler = orbits.position(altitude, *np.deg2rad([51.64, 208.9163, 40.0]), times)
    turned = kepler @ teme_to_j2000("2024-03-19T01:51:42.567").T
    apart = np.linalg.norm(sky.positions(tle, epoch=tle.epoch, times=times) - turned, axis=1)
    oblateness = 1.0826e-3 * frames.EARTH_RADIUS  # 6.9 km
    assert 0.1 * oblateness < apart.max() < 3 * oblateness


def test_satellites_of_elements_and_of_kepler_see_each_other():
    tle = sky.parse_tle(ISS)
    other = sky.CircularOrbit(
        altitude=500.0, inclination=0.9, node=3.6, latitude=1.2, epoch="2024-03-19T02:00:00"
    )
    times = np.linspace(0, 80, 5)
    there = sky.directions(tle, epoch=tle.epoch, observer=other, times=times)
    back = sky.directions(other, epoch=tle.epoch, observer=tle, times=times)
    np.testing.assert_array_equal(there, -back)
    np.testing.assert_allclose(np.linalg.norm(there, axis=1), 1, rtol=1e-15)
    zone = sky.keep_out("earth", epoch=tle.epoch, observer=tle, exclusion_deg=5.0, for_duration_s=80.0)
    assert 70 < np.rad2deg(zone.half_angle) < 80

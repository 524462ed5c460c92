"""The day of the case `case-day` as CSPICE finds it, from its C-kernel and from orbits of our own.

The day is planned and exported as a C-kernel. Positions are written as SPICE kernels without jaxplan: circles
for the satellites, and pyerfa for Sun and Moon. All that is then told comes from CSPICE: each second how far
each terminal that has a target is from it, by `spkpos` in the terminal's frame; by `gfoclt` when the Earth
hides the Sun; by `gftfov` when Sun and Moon are in a cone about a terminal, of the zone and of the zone with
what counts as near. The last two stand beside the events of the plan.

    pip install -e '.[orbit,spice]'
    python bench/day_by_spice.py [--step 1]
"""

import argparse
import tempfile
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _machine import print_machine
from _options import positive

import jaxplan as jp
from jaxplan import cases
from jaxplan.model.epochs import ephemeris_time
from jaxplan.timeline.events import NEAR, Event, events

try:
    import erfa
    import spiceypy as spice
except ImportError as error:
    raise SystemExit(f"{error.name} is not installed: pip install -e '.[orbit,spice]'") from error

MU, RADIUS, AU = 398600.4418, 6378.137, 149597870.7  # km^3/s^2, km, km
US, BARYCENTRE, EARTH, SUN, MOON = -9001, 0, 399, 10, 301  # numbers of SPICE
FIRST_SATELLITE, FIRST_FIELD = -9100, -9001800
STEP, DEGREE = 60.0, 11  # s between states, and degree of the polynomial through them
SEARCH_STEP = 0.5  # s; CSPICE may miss what begins and ends within it
ASIDE = 1.0  # s from the ends of the C-kernel, beyond which CSPICE looks when it takes differences
LEAP_SECONDS = [
    "DELTET/DELTA_T_A = 32.184",
    "DELTET/K = 1.657D-3",
    "DELTET/EB = 1.671D-2",
    "DELTET/M = ( 6.239996D0 1.99096871D-7 )",
    "DELTET/DELTA_AT = ( 37, @2017-JAN-1 )",
]
# A sphere, as the events have it; how it turns does not matter, but CSPICE asks.
THE_EARTH = {
    "BODY399_RADII": [RADIUS] * 3,
    "BODY399_POLE_RA": [0.0, 0.0, 0.0],
    "BODY399_POLE_DEC": [90.0, 0.0, 0.0],
    "BODY399_PM": [190.0, 360.9856235, 0.0],
}


class Change(NamedTuple):
    """Something that begins or ends: its kind as of the events, what it happens to, and when, s."""

    kind: str
    what: str
    time: float


def circle(orbit: dict[str, float], times: np.ndarray) -> np.ndarray:
    """States (k, 6) km and km/s on a circular orbit, told as in files, at times (k,) s from its epoch on."""
    radius = RADIUS + orbit["altitude_km"]
    rate = np.sqrt(MU / radius**3)
    along = np.deg2rad(orbit["argument_of_latitude_deg"]) + rate * times
    node, tilt = np.deg2rad([orbit["ascending_node_deg"], orbit["inclination_deg"]])
    first = np.array([np.cos(node), np.sin(node), 0.0])
    second = np.array([-np.sin(node) * np.cos(tilt), np.cos(node) * np.cos(tilt), np.sin(tilt)])
    position = radius * (np.outer(np.cos(along), first) + np.outer(np.sin(along), second))
    velocity = radius * rate * (np.outer(np.cos(along), second) - np.outer(np.sin(along), first))
    return np.concatenate([position, velocity], axis=1)


def in_km(found: np.ndarray) -> np.ndarray:
    """States (k, 6) km and km/s of what pyerfa tells in astronomical units and days."""
    return np.concatenate([AU * found["p"], AU / 86400 * found["v"]], axis=-1)


def write_positions(file: Path, sky: dict[str, Any], start: float, seconds: float) -> dict[str, int]:
    """Write a kernel of positions about the Earth; returns the number of each satellite by its name.

    Args:
        file: to be written.
        sky: the table of the timeline's file, with circular orbits.
        start: s of TDB, of its epoch.
        seconds: that are wanted.
    """
    numbers = {one["name"]: FIRST_SATELLITE - place for place, one in enumerate(sky["satellite"])}
    times = np.arange(-DEGREE, seconds / STEP + DEGREE) * STEP
    days = (start + times) / 86400
    from_sun, from_barycentre = erfa.epv00(erfa.DJ00, days)
    states = {
        SUN: -in_km(from_sun),
        MOON: in_km(erfa.moon98(erfa.DJ00, days)),
        US: circle(sky["observer"], times),
    }
    states |= {numbers[one["name"]]: circle(one["orbit"], times) for one in sky["satellite"]}
    centres = dict.fromkeys(states, EARTH) | {EARTH: BARYCENTRE}  # by which CSPICE relates everything
    states[EARTH] = in_km(from_barycentre)
    moments = start + times
    handle = spice.spkopn(str(file), "positions", 0)
    for number, centre in centres.items():
        whose = number, centre, "J2000", *moments[[0, -1]], str(number)
        spice.spkw13(handle, *whose, DEGREE, len(times), states[number], moments)
    spice.spkcls(handle)
    return numbers


def pointing_errors(
    plan: jp.TimelinePlan, asked: dict[str, Any], numbers: dict[str, int], start: float, step: float
) -> np.ndarray:
    """Angles (k,) rad of each terminal that has a target from that, at multiples of `step` s.

    Args:
        plan: tells when each activity is done.
        asked: the tables of activities in the timeline's file, by name.
        numbers: of the satellites.
        start: s of TDB.
        step: s.
    """
    found = []
    for done in plan.activities:
        times = np.arange(np.ceil(done.start / step), done.end / step) * step
        for device, name in asked[done.name]["track"].items():
            for time in times.tolist():
                frame = f"DAY_{device.upper()}"
                toward, _ = spice.spkpos(str(numbers[name]), start + time, frame, "NONE", str(US))
                found.append(np.arctan2(np.hypot(toward[0], toward[1]), toward[2]))
    return np.array(found)


def seen_within(frame: str, number: int, half_angle: float, body: str, span: tuple[float, float]) -> list:
    """Intervals of TDB, s, in which a body is within an angle (rad) of the z axis of a frame."""
    for key, value in (
        ("FOV_FRAME", [frame]),
        ("FOV_SHAPE", ["CIRCLE"]),
        ("FOV_CLASS_SPEC", ["ANGLES"]),
        ("FOV_ANGLE_UNITS", ["RADIANS"]),
    ):
        spice.pcpool(f"INS{number}_{key}", value)
    for key, numbers in (
        ("BORESIGHT", [0.0, 0.0, 1.0]),
        ("FOV_REF_VECTOR", [1.0, 0.0, 0.0]),
        ("FOV_REF_ANGLE", [half_angle]),
    ):
        spice.pdpool(f"INS{number}_{key}", numbers)
    window, found = spice.cell_double(2), spice.cell_double(2000)
    spice.wninsd(span[0] + ASIDE, span[1] - ASIDE, window)
    spice.gftfov(str(number), body, "POINT", "", "NONE", str(US), SEARCH_STEP, window, found)
    return [spice.wnfetd(found, place) for place in range(spice.wncard(found))]


def near_zones(plan: jp.TimelinePlan, span: tuple[float, float]) -> tuple[list[Change], list[str]]:
    """When terminals come near to Sun and Moon and leave them, and a line for each zone that is broken."""
    changes, broken, number = [], [], FIRST_FIELD
    for zone in plan.timeline.scene.keep_out:
        if zone.name not in ("sun", "moon"):
            continue
        radius = float(zone.half_angle)
        inside: list[tuple[float, float]] = []
        for device in plan.timeline.scene.spacecraft.device_names:
            frame = f"DAY_{device.upper()}"
            number -= 2
            for begin, end in seen_within(frame, number, radius, zone.name.upper(), span):
                broken.append(f"{device} is in {zone.name} at {begin - span[0]:.1f} to {end - span[0]:.1f} s")
            inside += seen_within(frame, number - 1, radius + NEAR, zone.name.upper(), span)
        for begin, end in inside:
            changes += [Change("zone_near", zone.name, begin - span[0])] if begin > span[0] + ASIDE else []
            changes += [Change("zone_left", zone.name, end - span[0])] if end < span[1] - ASIDE else []
    return changes, broken


def eclipses(span: tuple[float, float]) -> list[Change]:
    """When the Sun's centre goes behind the Earth and comes out."""
    window, found = spice.cell_double(2), spice.cell_double(2000)
    spice.wninsd(*span, window)
    spice.gfoclt(
        "ANY", "EARTH", "ELLIPSOID", "IAU_EARTH", "SUN", "POINT", "", "NONE", str(US), 60.0, window, found
    )
    changes = []
    for place in range(spice.wncard(found)):
        begin, end = spice.wnfetd(found, place)
        changes += [Change("eclipse_begins", "sun", begin - span[0])] if begin > span[0] else []
        changes += [Change("eclipse_ends", "sun", end - span[0])] if end < span[1] else []
    return changes


def compare(told: list[Event], found: list[Change]) -> None:
    """Print how many changes of each kind both have, and how far they are apart."""
    print(f"{'':<16}{'CSPICE':>8}{'plan':>8}{'most apart, s':>15}")
    for kind in ("eclipse_begins", "eclipse_ends", "zone_near", "zone_left"):
        theirs = sorted((one.what, one.time) for one in found if one.kind == kind)
        ours = sorted((one.what, one.time) for one in told if one.kind == kind)
        apart = "-"
        if [what for what, _ in ours] == [what for what, _ in theirs]:
            apart = f"{max(abs(a - b) for (_, a), (_, b) in zip(ours, theirs, strict=True)):.4f}"
        print(f"{kind.replace('_', ' '):<16}{len(theirs):>8}{len(ours):>8}{apart:>15}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--step", type=positive, default=1, help="s between looks at targets (%(default)s)")
    step = parser.parse_args().step
    print_machine("spiceypy", "pyerfa")
    told = tomllib.loads((Path(cases.__file__).parent / "case-day.toml").read_text(encoding="utf-8"))
    plan = jp.plan_timeline(jp.example_timeline("case-day"), progress=False)
    duration = plan.trajectory.duration
    names = jp.ExportNames(object_name="DAY", frame_name="DAY_BUS", naif_id=US)
    with tempfile.TemporaryDirectory() as folder:
        kernels = jp.export(plan, Path(folder) / "day", format="ck", names=names)
        spice.lmpool(LEAP_SECONDS)
        start = ephemeris_time(np.datetime64(told["sky"]["epoch_utc"], "ns"), np.zeros(1))[0]
        numbers = write_positions(Path(folder) / "positions.bsp", told["sky"], start, duration)
        for file in [*sorted(kernels.iterdir()), Path(folder) / "positions.bsp"]:
            spice.furnsh(str(file))
        for key, values in THE_EARTH.items():
            spice.pdpool(key, values)
        asked = {one["name"]: one for one in told["activity"]}
        size = sum(file.stat().st_size for file in kernels.iterdir()) / 1e6
        off = np.rad2deg(pointing_errors(plan, asked, numbers, start, step))
        print(f"C-kernel of {size:.1f} MB; {len(off)} looks at targets, one each {step:g} s of each terminal")
        print(f"off by at most {off.max():.2e} deg, {np.median(off):.2e} in the median")
        claimed = max(np.rad2deg(one.pointing_error) for one in plan.activities)
        print(f"the certificate says {claimed:.2e} deg at most\n")
        span = start, start + duration
        hidden = eclipses(span)
        near, broken = near_zones(plan, span)
        compare(list(events(plan)), [*hidden, *near])
        print("\n" + ("\n".join(broken) if broken else "no terminal looks into the zone of Sun or Moon"))
        spice.kclear()


if __name__ == "__main__":
    main()

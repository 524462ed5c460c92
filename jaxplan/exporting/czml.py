"""Writer of CZML for CesiumJS and other viewers, by means of czml3.

Positions and attitudes are given relative to Earth-fixed axes, with the Earth's rotation of IAU 2006 from
pyerfa and UTC in place of UT1. So nothing depends on the viewer's own model of the Earth's rotation, except
the stars that it draws. Positions follow the polynomial of degree 7 through the eight nearest samples, and
attitudes turn about one axis between two samples (``LINEAR`` of quaternions). Lines end at points that have
samples of their own, since CesiumJS has no points that move along with an attitude.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan import sky, so3
from jaxplan.exporting.sampled import Sampling, continued, device_frames, field_in_own_axes, instrument_frames
from jaxplan.model.epochs import utc_texts
from jaxplan.runtime.display import COLOURS, KEEP_IN, KEEP_OUT
from jaxplan.sky.frames import EARTH_RATE, gcrs_to_earth

LENGTH = 1e6
"""m: of lines, from the spacecraft on."""
STANDS = np.array([7e6, 0.0, 0.0])
"""m: where a spacecraft of no known orbit is drawn, along axes that are fixed to the Earth."""
_POSITION_STEP = 60.0  # s, largest between samples of the position, and of what depends on it and time alone
_POSITION_DEGREE = 7
_LINE_END_STEP = 5.0  # s, largest between samples of ends of lines: a low orbit bends by 30 m in between
_EARTH_SHARE = 0.1  # fraction of the tolerance that the Earth's rotation may add between two samples
_RIM_POINTS = 24  # points on the rim of a cone
_SPACECRAFT_ID = "spacecraft"


def write_czml(sampling: Sampling, path: Path) -> None:
    """Write the spacecraft, its boresights and fields of view, and the cones of zones, as CZML 1.0.

    Args:
        sampling: the motion's sampling, with a start, and an observer where the orbit is known.
        path: the file, in UTF-8.
    """
    from czml3 import CZML_VERSION, Document, Packet
    from czml3.enums import ClockRanges
    from czml3.properties import Clock
    from czml3.types import IntervalValue, TimeInterval

    sampling = _refine_for_earth_rotation(sampling)
    duration = float(sampling.times[-1])
    begin, end = (text[:26] + "Z" for text in utc_texts(_start_epoch(sampling), np.array([0.0, duration])))
    clock = IntervalValue(
        start=begin,
        end=end,
        value=Clock(currentTime=begin, multiplier=max(1.0, duration / 60), range=ClockRanges.LOOP_STOP),
    )
    name = sampling.names.object_name or sampling.flight.name
    packets = [
        Packet(id="document", name=name, version=CZML_VERSION, clock=clock),
        _spacecraft_packet(sampling, name, begin, TimeInterval(start=begin, end=end)),
        *_device_packets(sampling, begin),
        *_cone_packets(sampling, begin),
    ]
    path.write_text(Document(packets=packets).dumps(), encoding="utf-8")


def _start_epoch(sampling: Sampling) -> np.datetime64:
    """Return UTC of time zero."""
    assert sampling.start is not None
    return sampling.start


def _refine_for_earth_rotation(sampling: Sampling) -> Sampling:
    """Return the sampling with as many more instants as the Earth's rotation needs.

    Between two attitudes an angle ``b`` apart, while the Earth turns by ``a``, one turn about one axis
    differs from the product of both turns by at most ``|a x b| / 8``, to second order (Baker, Campbell,
    Hausdorff). Unchanged where no tolerance is given.
    """
    if sampling.tolerance is None:
        return sampling
    times, steps = sampling.times, np.diff(sampling.times)
    attitude = sampling.flight.trajectory.sample(times).attitude
    turned = np.asarray(so3.distance(attitude[:-1], attitude[1:]))
    off = EARTH_RATE * steps * turned / 8
    parts = np.maximum(1, np.ceil(np.sqrt(off / (_EARTH_SHARE * sampling.tolerance)))).astype(int)
    place = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = np.repeat(times[:-1], parts) + place * np.repeat(steps / parts, parts)
    return replace(sampling, times=np.append(inner, times[-1]))


def _earth_fixed_positions(sampling: Sampling, times: np.ndarray) -> np.ndarray:
    """Return positions (k, 3) m of the spacecraft along Earth-fixed axes at times (k,) s from the start."""
    if sampling.observer is None:
        return np.tile(STANDS, (len(times), 1))
    epoch = _start_epoch(sampling)
    there = sky.positions(sampling.observer, epoch=epoch, times=times)
    return np.asarray(1e3 * np.einsum("kij,kj->ki", gcrs_to_earth(epoch, times), there))


def _position_times(duration: float) -> np.ndarray:
    """Return times (k,) s in equal steps for polynomials of `_POSITION_DEGREE`; only zero for no duration."""
    count = max(_POSITION_DEGREE, int(np.ceil(duration / _POSITION_STEP))) + 1
    return np.unique(np.linspace(0.0, duration, count))


def _position_property(times: np.ndarray, places: np.ndarray, epoch: str, degree: int) -> Any:
    """Return a CZML position from samples at times (k,) s and places (k, 3) m, interpolated with a degree."""
    from czml3.enums import InterpolationAlgorithms
    from czml3.properties import Position

    return Position(
        epoch=epoch,
        referenceFrame="FIXED",
        cartesian=np.column_stack([times, np.round(places, 4)]).ravel().tolist(),
        interpolationAlgorithm=InterpolationAlgorithms("LINEAR" if degree == 1 else "LAGRANGE"),
        interpolationDegree=max(1, min(degree, len(times) - 1)),
    )


def _spacecraft_packet(sampling: Sampling, name: str, epoch: str, span: Any) -> Any:
    """Return the packet of the spacecraft: position, attitude, name and trail."""
    from czml3 import Packet
    from czml3.enums import InterpolationAlgorithms
    from czml3.properties import Label, Orientation, Point
    from czml3.properties import Path as Trail

    rows, before = [], None
    for block in sampling.blocks():
        to_earth = gcrs_to_earth(_start_epoch(sampling), block.times)
        quaternions = continued(to_earth @ block.values.attitude, before)
        before = quaternions[-1]
        rows.append(np.column_stack([block.times, np.roll(quaternions, -1, axis=1)]))
    known = sampling.observer is not None
    grid = _position_times(float(sampling.times[-1]))
    stands = (
        "No orbit was given: it is drawn where it is not, standing still 7000 km from the Earth's centre."
    )
    return Packet(
        id=_SPACECRAFT_ID,
        name=name,
        description="Attitude by jaxplan, certified." + f" {stands}" * (not known),
        availability=span,
        position=_position_property(grid, _earth_fixed_positions(sampling, grid), epoch, _POSITION_DEGREE),
        orientation=Orientation(
            epoch=epoch,
            unitQuaternion=np.concatenate(rows).ravel().tolist(),
            interpolationAlgorithm=InterpolationAlgorithms.LINEAR,
            interpolationDegree=1,
        ),
        point=Point(pixelSize=8, color=_rgba("#FFFFFF")),
        label=Label(text=name, font="12pt sans-serif"),
        path=Trail(width=1.0, material=_material("#FFFFFF")) if known else None,
    )


def _device_packets(sampling: Sampling, epoch: str) -> Iterator[Any]:
    """Yield the packets of devices: ends of lines, boresights, and fields of view where there are any."""
    duration = float(sampling.times[-1])
    steps = np.linspace(0.0, duration, int(np.ceil(duration / _LINE_END_STEP)) + 1)
    ends = replace(sampling, times=np.union1d(sampling.times, steps))
    craft = sampling.spacecraft
    moving = craft.gimbals.count
    fixed = instrument_frames(craft.fixed_boresights)
    own = [[np.array([[0.0, 0.0, 1.0]])] for _ in craft.devices]
    for number, device in enumerate(craft.devices):
        corners = field_in_own_axes(device, None if number < moving else fixed[number - moving])
        if corners is not None:
            own[number].append(corners)
    points = [np.concatenate(each) for each in own]
    found: list[list[np.ndarray]] = [[] for _ in craft.devices]
    for block in ends.blocks():
        to_earth = gcrs_to_earth(_start_epoch(sampling), block.times) @ block.values.attitude
        here = _earth_fixed_positions(sampling, block.times)
        for number, each in enumerate(points):
            frame = (
                device_frames(craft, block.values.joints, number)
                if number < moving
                else fixed[number - moving]
            )
            along = np.einsum("kij,pj->kpi", to_earth @ frame, each)
            found[number].append(here[:, None] + LENGTH * along)
    for number, name in enumerate(craft.device_names):
        places, colour = np.concatenate(found[number]), COLOURS[number % len(COLOURS)]
        key = f"device-{number}"
        names = [f"{key}/boresight-end", *(f"{key}/corner-{i}" for i in range(places.shape[1] - 1))]
        for own_name, place in zip(names, np.swapaxes(places, 0, 1), strict=True):
            yield _end_packet(own_name, _position_property(ends.times, place, epoch, 1))
        yield _line_packet(key, name, [_SPACECRAFT_ID, names[0]], colour)
        if len(names) > 1:
            first, *others = corners_of = names[1:]
            spokes = [one for corner in others for one in (_SPACECRAFT_ID, corner)]
            yield _line_packet(
                f"{key}/field", f"{name}, field of view", [*corners_of, first, *spokes], colour
            )


def _cone_packets(sampling: Sampling, epoch: str) -> Iterator[Any]:
    """Yield the packets of zones about inertial axes, still or moving: each cone's rim, and spokes to it."""
    around = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    for number, zone in enumerate(sampling.flight.cones):
        path = zone.path
        if path is None:  # about an axis of the body or a device
            continue
        duration = float(sampling.times[-1])
        times = _position_times(min(duration, float(path.times[-1])) if path.moves else duration)
        axis = np.asarray(path.at(times))
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis[0]))])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        ring = (
            np.cos(around)[:, None] * across[:, None]
            + np.sin(around)[:, None] * np.cross(axis, across)[:, None]
        )
        half = float(zone.half_angle)
        rim = np.cos(half) * axis[:, None] + np.sin(half) * ring
        turned = np.einsum("kij,kpj->kpi", gcrs_to_earth(_start_epoch(sampling), times), rim)
        places = _earth_fixed_positions(sampling, times)[:, None] + LENGTH * turned
        key = f"zone-{number}"
        names = [f"{key}/rim-{i}" for i in range(_RIM_POINTS)]
        for own_name, place in zip(names, np.swapaxes(places, 0, 1), strict=True):
            yield _end_packet(own_name, _position_property(times, place, epoch, _POSITION_DEGREE))
        spokes = [
            one for i in (0, _RIM_POINTS // 3, 2 * _RIM_POINTS // 3) for one in (_SPACECRAFT_ID, names[i])
        ]
        words = "keep out of" if zone.side > 0 else "keep in"
        told = f"{words} {zone.name}, {np.rad2deg(half):.3g} deg"
        told += " from fields of view" * bool(zone.of_field)
        yield _line_packet(key, told, [*names, names[0], *spokes], KEEP_OUT if zone.side > 0 else KEEP_IN)


def _end_packet(key: str, position: Any) -> Any:
    """Return the packet of a point at which lines end."""
    from czml3 import Packet

    return Packet(id=key, parent=_SPACECRAFT_ID, position=position)


def _line_packet(key: str, name: str, ends: list[str], colour: str) -> Any:
    """Return the packet of a straight polyline through the positions of other packets."""
    from czml3 import Packet
    from czml3.enums import ArcTypes
    from czml3.properties import Polyline, PositionList

    return Packet(
        id=key,
        name=name,
        parent=_SPACECRAFT_ID,
        polyline=Polyline(
            positions=PositionList(references=[f"{end}#position" for end in ends]),
            arcType=ArcTypes.NONE,
            width=2.0,
            material=_material(colour),
        ),
    )


def _material(colour: str) -> Any:
    """Return the CZML material of a plain colour ``#RRGGBB``."""
    from czml3.properties import PolylineMaterial, SolidColorMaterial

    return PolylineMaterial(solidColor=SolidColorMaterial(color=_rgba(colour)))


def _rgba(colour: str) -> Any:
    """Return a colour ``#RRGGBB`` as a CZML colour, opaque."""
    from czml3.properties import Color

    return Color(rgba=[*bytes.fromhex(colour[1:]), 255])

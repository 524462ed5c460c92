"""The table ``[sky]`` of a file read by itself: who looks, and what can be looked at."""

import os
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from jaxplan import sky
from jaxplan.runtime.display import shown
from jaxplan.schema import text as texts
from jaxplan.schema.faults import Place, Reading, ScenarioError
from jaxplan.schema.orbits import Orbit
from jaxplan.schema.reading import read_file
from jaxplan.schema.sky import SKY, Lasting, View, known

_DAY = 86400.0  # s


@shown("epoch", "observer", "things", "duration s")
@dataclass(frozen=True, kw_only=True, eq=False)
class Sky:
    """The observer's view of the sky: who looks, and what can be looked at.

    Attributes:
        epoch: UTC, from which times count.
        observer: the satellite that looks.
        things: satellites and points of the ground, by name.
        occulters: spheres other than the Earth that hide them.
        atmosphere: km, height of air that counts as part of the Earth.
        duration: s, for how long the file follows them; a day where it does not say.
    """

    epoch: np.datetime64
    observer: sky.Satellite
    things: dict[str, sky.Satellite | sky.GroundPoint]
    occulters: tuple[sky.Occulter, ...]
    atmosphere: float
    duration: float

    @property
    def known(self) -> str:
        """Text for messages that lists the names of `things`."""
        if not self.things:
            return "[sky] has neither satellites nor points of the ground"
        return f"must be one of {', '.join(self.things)}"

    def passes(self, name: str, *, duration_s: float | None = None) -> tuple[sky.Pass, ...]:
        """Find when one of the things can be seen, see `jaxplan.sky.passes`.

        Args:
            name: name of the thing.
            duration_s: s from the epoch, for how long, in (0, 31 * 86400]; None for `duration`.

        Raises:
            KeyError: if there is no such thing.
            ValueError: as for `jaxplan.sky.passes`.
        """
        if name not in self.things:
            raise KeyError(f"{name}: {self.known}")
        return sky.passes(
            self.things[name],
            epoch=self.epoch,
            observer=self.observer,
            duration_s=self.duration if duration_s is None else duration_s,
            name=name,
            atmosphere_km=self.atmosphere,
            occulters=self.occulters,
        )


def load_sky(path: str | os.PathLike[str]) -> Sky:
    """Read the table ``[sky]`` of a file; the rest of the file is ignored.

    Args:
        path: path of a TOML file in UTF-8, of a scenario or a timeline.

    Raises:
        ScenarioError: if the file cannot be read, or has no such table; the message lists every fault.

    Example:
        >>> [(one.start, one.end) for one in jp.load_sky("day.toml").passes("lisbon")]
    """
    return read_file(path, _parse_sky, texts.LARGEST_TIMELINE)


def _parse_sky(text: str, *, folder: str | os.PathLike[str] = "") -> Sky:
    """Read ``[sky]`` from the text of a file; `folder` is that of the file."""
    root = _root_place(folder)
    given, place = texts.parse(text, texts.LARGEST_TIMELINE).get("sky"), root["sky"]
    if given is None:
        place.fault("missing, must say epoch_utc and observer, and what is looked at")
    view: Any = SKY.read(given, place) if given is not None else None
    found = None
    if isinstance(view, View):
        found = known(view, Lasting(_DAY if view.for_duration is None else None, "for_duration_s"), place)
    if root.reading.faults or found is None:
        raise ScenarioError(root.reading.faults)
    return Sky(
        epoch=view.epoch,
        observer=view.observer,
        things=dict(found.things),
        occulters=found.occulters,
        atmosphere=view.atmosphere,
        duration=found.view.for_duration or _DAY,
    )


def load_observer(path: str | os.PathLike[str]) -> sky.Satellite:
    """Read the orbit of the observer in a file's ``[sky]``; the rest of the file is ignored.

    Args:
        path: path of a TOML file in UTF-8, of a scenario or a timeline.

    Raises:
        ScenarioError: if the file cannot be read, or has no observer; the message lists every fault.

    Example:
        >>> jp.plot.ground_track(plan, observer=jp.load_observer("scene.toml"))
    """
    return read_file(path, partial(_parse_observer, needed=True), texts.LARGEST_TIMELINE)


def find_observer(path: str | os.PathLike[str]) -> sky.Satellite | None:
    """Read the orbit of the observer as `load_observer` does; None if the file has no observer."""
    return read_file(path, partial(_parse_observer, needed=False), texts.LARGEST_TIMELINE)


def _parse_observer(text: str, *, folder: str | os.PathLike[str] = "", needed: bool) -> Any:
    """Read the observer from the text of a file.

    Args:
        text: text of the file.
        folder: folder of the file.
        needed: whether to raise a `ScenarioError` if there is none; otherwise the result is None then.
    """
    if not needed and "observer" not in text:
        return None
    root = _root_place(folder)
    table = texts.parse(text, texts.LARGEST_TIMELINE).get("sky")
    given, place = table.get("observer") if isinstance(table, dict) else None, root["sky"]["observer"]
    if given is None and not needed:
        return None
    observer = place.fault("missing, must say the orbit") if given is None else Orbit().read(given, place)
    if root.reading.faults:
        raise ScenarioError(root.reading.faults)
    return observer


def _root_place(folder: str | os.PathLike[str]) -> Place:
    """Return the place of a whole file that lies in a folder."""
    root = Place(Reading())
    root.reading.folder = folder
    return root

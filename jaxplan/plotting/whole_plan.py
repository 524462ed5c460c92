"""All figures of a plan: several in one, one by one, and as data for pages that embed their pictures."""

import base64
import io
import os
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, get_args

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from jaxplan.planner import Plan
from jaxplan.plotting import margin_panels
from jaxplan.plotting.ground_track import GROUND_SIZE, ground_track, has_tracks
from jaxplan.plotting.joint_map import joint_map, joint_map_size
from jaxplan.plotting.margin_panels import margins
from jaxplan.plotting.mounting import SIZE as SPACECRAFT_SIZE
from jaxplan.plotting.mounting import spacecraft
from jaxplan.plotting.orbital import attitude, attitude_size
from jaxplan.plotting.sky import DISCS_SIZE, GLOBE_SIZE, SPHERE_SIZE, globe, sphere
from jaxplan.plotting.spectrum import spectrum
from jaxplan.plotting.style import TEXT, WIDTH, expect_plan, legend_beside, motion, new_figure, time_axis
from jaxplan.plotting.time_panels import (
    accelerations,
    angles,
    draw_platform_rate,
    joint_kinds,
    limited_loads,
    rates,
    size,
    torque,
)
from jaxplan.plotting.timeline import timeline, timeline_size
from jaxplan.runtime.arguments import expect_any
from jaxplan.sky import Satellite
from jaxplan.timeline.record import TimelinePlan
from jaxplan.trajectory.spectrum import expect_frequencies

_SPHERE_HEIGHT, _ROW_HEIGHT = 4.1, 1.6  # inches of an overview: heights of the sphere and of each panel below
FIGURE_NAMES = (
    "timeline",
    "overview",
    "spacecraft",
    "sphere",
    "orbital_sphere",
    "attitude",
    "ground_track",
    "angles",
    "rates",
    "accelerations",
    "torque",
    "margins",
    "joint_map",
    "spectrum",
)
"""Names of all figures that a plan may have."""

_PAGE_DPI = 200  # dots per inch of PNG pictures in a page
_SCREEN_DPI = 150  # dots per inch of pictures in files of their own
_PNG_COMPRESSION = 3  # of zlib (0 to 9): files a twentieth larger than at 6, in three quarters of the time


def overview(plan: Plan, ax: Figure | SubFigure | None = None) -> list[Axes]:
    """Draw the unfolded sphere, and below it joint angles, margins and the platform's angular velocity.

    Args:
        plan: a plan with a trajectory.
        ax: a figure to fill, or None for a new one.

    Returns:
        The axes of the sphere, of yaws, pitches and drives' angles as far as there are any, of margins, and
        of angular velocity, in this order. Their ``figure`` is the whole one, which can be saved.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory.
    """
    moves, craft = motion(plan), plan.scenario.spacecraft
    kinds = len(joint_kinds(craft))
    figure = new_figure(_overview_size(kinds)) if ax is None else ax
    halves = figure.add_gridspec(2, 1, height_ratios=(_SPHERE_HEIGHT, _ROW_HEIGHT * (kinds + 2)))
    top = sphere(plan, ax=figure.add_subplot(halves[0]))
    below = list(np.ravel(np.asarray(halves[1].subgridspec(kinds + 2, 1).subplots(sharex=True))))
    joints, others = below[:kinds], below[kinds:]
    if joints:
        angles(plan, ax=joints, legend=False)
    named, lines = margin_panels.draw(others[0], plan, moves)
    further = [entry for entry in named if entry[1] not in craft.device_names]  # the sphere names devices
    others[0].set_ylabel("margin to\nzones (deg)", fontsize=TEXT)
    legend_beside(others[0], [*further, *lines])
    legend_beside(others[1], draw_platform_rate(others[1], moves, craft))
    time_axis(below, moves)
    return [top, *joints, *others]


def _overview_size(kinds: int) -> tuple[float, float]:
    """Return width and height of an overview, inches, for a spacecraft with `kinds` kinds of joints."""
    return WIDTH, _SPHERE_HEIGHT + _ROW_HEIGHT * (kinds + 2)


def figures(
    plan: Plan | TimelinePlan, frequencies: Sequence[float] = (), observer: Satellite | None = None
) -> Iterator[tuple[str, Figure]]:
    """Draw every figure that a plan has, one after the other; none of them belongs to pyplot.

    Without a trajectory only spacecraft and sphere are drawn. There is no spacecraft without devices and
    wheels, no angles without joints, no margins without zones, no joint map without masks, and torque only if
    torque, momentum or jerk has a limit. Only a timeline's plan has the figure "timeline".

    Args:
        plan: a plan of any status, also one of a timeline.
        frequencies: Hz, for a spectrum with a line at each; without any there is no spectrum.
        observer: the spacecraft's orbit, one of `jaxplan.sky`, for the sphere and the attitude in the local
            orbital frame and for the ground track; these need a trajectory, an epoch of the plan and the
            extra ``orbit``. None for none of them.

    Yields:
        The figure's name (one of `FIGURE_NAMES`), fit for a file, and the figure.

    Raises:
        TypeError: if it is no plan, or the observer no orbit.
        ValueError: if a frequency is not positive, or the orbit is not known for the time of the plan.
    """
    for name, make in drawings(plan, frequencies, observer):
        yield name, make()


def drawings(
    plan: Plan | TimelinePlan, frequencies: Sequence[float] = (), observer: Satellite | None = None
) -> list[tuple[str, Callable[[], Figure]]]:
    """Return the names of all figures that a plan has, each with a function that draws it and returns it.

    So a progress bar knows how many there are before the first is drawn. Arguments and errors are those of
    `figures`, but an orbit that is not known for the time of the plan raises only when its figure is drawn.
    """
    day = plan if isinstance(plan, TimelinePlan) else None
    plan = expect_plan(plan)
    asked = expect_frequencies(frequencies, zero=False)
    if observer is not None:
        expect_any("observer", observer, get_args(Satellite), "an orbit, as those of jp.sky")
    orbits = has_tracks(plan, observer)
    moves, craft = plan.trajectory is not None, plan.scenario.spacecraft
    loads = len(limited_loads(craft))
    kinds = len(joint_kinds(craft))
    known: dict[str, tuple[Callable[..., Any], tuple[float, float], bool]] = {
        "overview": (overview, _overview_size(kinds), moves),
        "spacecraft": (_draw_at_start, SPACECRAFT_SIZE, bool(craft.device_names or craft.wheels)),
        "sphere": (sphere, SPHERE_SIZE, True),
        "orbital_sphere": (partial(sphere, frame="orbital", observer=observer), DISCS_SIZE, orbits),
        "attitude": (
            partial(attitude, observer=observer),
            attitude_size(1 + bool(craft.device_names)),
            orbits,
        ),
        "ground_track": (partial(ground_track, observer=observer), GROUND_SIZE, orbits),
        "angles": (angles, size(kinds), moves and kinds > 0),
        "rates": (rates, size(kinds + 1), moves),
        "accelerations": (accelerations, size(kinds + 1), moves),
        "torque": (torque, size(loads), moves and loads > 0),
        "margins": (margins, margin_panels.SIZE, moves and bool(plan.scenario.zones)),
        "joint_map": (
            joint_map,
            joint_map_size(len(craft.terminals)),
            moves and any(one.mask for one in craft.terminals),
        ),
        "spectrum": (
            partial(spectrum, frequencies=asked),
            size(1 + bool(craft.wheels)),
            moves and len(asked) > 0,
        ),
    }
    found: list[tuple[str, Callable[[], Figure]]] = []
    for name in FIGURE_NAMES:
        draw, inches, there = known.get(name, (timeline, SPHERE_SIZE, False))
        if name == "timeline" and day is not None:
            found.append((name, partial(_draw_figure, timeline, timeline_size(day), day)))
        elif there:
            shown = day if name == "ground_track" and day is not None else plan
            found.append((name, partial(_draw_figure, draw, inches, shown)))
    return found


def _draw_figure(draw: Callable[..., Any], inches: tuple[float, float], plan: Plan | TimelinePlan) -> Figure:
    """Make a figure of a size in inches, without pyplot, and draw a plan on it."""
    figure = Figure(figsize=inches, layout="constrained")
    draw(plan, ax=figure)
    return figure


def _draw_at_start(plan: Plan, ax: Figure) -> None:
    """Draw the spacecraft with boresights at the joint angles of the start, on a figure."""
    spacecraft(plan.scenario.spacecraft, joints=plan.scenario.start.joints, ax=ax)


def inline_figures(
    plan: Plan | TimelinePlan,
    frequencies: Sequence[float] = (),
    names: Sequence[str] | None = None,
    observer: Satellite | None = None,
) -> Iterator[tuple[str, str]]:
    """Draw the globe and the figures of a plan as pictures for a page, without the overview.

    The overview would only repeat the others.

    Args:
        plan: a plan of any status; see `figures` for the figures that it has.
        frequencies: Hz, as of `figures`.
        names: of the figures that are wanted besides the globe, as far as the plan has them; None for all.
        observer: the spacecraft's orbit, as of `figures`.

    Yields:
        The figure's name and its picture as a ``data:`` address, the same for the same plan: SVG with text as
        shapes, or PNG if there are hatched areas or surfaces in space. The background is transparent.
    """
    ball = Figure(figsize=GLOBE_SIZE, layout="constrained")
    globe(plan, ax=ball)
    yield "globe", _to_data_url(ball)
    for name, figure in figures(plan, frequencies, observer):
        if name != "overview" and (names is None or name in names):
            yield name, _to_data_url(figure, hatched=name == "timeline")


def draw_png(figure: Figure, software: str) -> Callable[[str | os.PathLike[str]], None]:
    """Draw a figure once only, as ``savefig`` would not, and return the function that writes the picture.

    That function takes the name of the file. Another thread can call it while the next figure is drawn.

    Args:
        figure: with a background that is not transparent; its resolution is changed.
        software: entry "Software" in the file.
    """
    figure.set_dpi(_SCREEN_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    said = PngInfo()
    said.add_text("Software", software)
    dots, picture = (_SCREEN_DPI, _SCREEN_DPI), Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    return partial(picture.save, format="png", dpi=dots, pnginfo=said, compress_level=_PNG_COMPRESSION)


def _to_data_url(figure: Figure, *, hatched: bool = False) -> str:
    """Return a figure's picture as a ``data:`` address, SVG or PNG; `hatched` saves trying SVG first."""
    kind, content = "svg+xml", b"<pattern"
    if not hatched:
        content = _render_picture(figure, "svg", {"Date": None, "Creator": None})
    # hatches lose their transparency in SVG, so that zones print solid; many small surfaces are an image
    if b"<pattern" in content or b"<image" in content:
        kind, content = "png", _render_picture(figure, "png", {"Software": None})
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _render_picture(figure: Figure, kind: str, metadata: dict[str, None]) -> bytes:
    """Return the bytes of a figure's picture in a format of matplotlib, "svg" or "png"."""
    file = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "jaxplan"}):  # else the names inside are random
        figure.savefig(file, format=kind, metadata=metadata, transparent=True, dpi=_PAGE_DPI)
    return file.getvalue()

"""The spectrum of the torque on the platform: which frequencies a manoeuvre excites, and how strongly.

Drawn are amplitudes of the Fourier transform over the whole finite manoeuvre, with zero torque before and
after. So their unit is N m s, torque times time; they are no density. They are exact at every frequency
(`jaxplan.trajectory.spectrum`).
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from jaxplan.model.wheels import row_names
from jaxplan.planner import Plan
from jaxplan.plotting.style import (
    AXIS_STYLES,
    GREY,
    TEXT,
    Canvas,
    Entries,
    Look,
    device_entries,
    device_style,
    legend_beside,
    motion,
    panels,
    tidy,
)
from jaxplan.plotting.time_panels import AXIS_ENTRIES, size
from jaxplan.trajectory import measures
from jaxplan.trajectory.spectrum import expect_frequencies

_CURVE_POINTS = 800  # frequencies of a curve
_LOWEST_FREQUENCY, _HIGHEST_FREQUENCY = 0.1, 100.0  # of a curve, in units of 1 / duration
_MULTIPLE_OF_ASKED = 3.0  # the curve goes on to that multiple of the highest frequency that is asked for
_MAX_DECADES = 9  # most decades that are drawn below the highest amplitude
_ASKED_LINE: Look = {"color": GREY, "linewidth": 1.0}
_DASHES: Sequence[tuple[float, ...]] = ((4, 2), (1, 1.5), (6, 2, 1, 2), (2, 2))


def amplitudes(plan: Plan, frequencies: np.ndarray) -> dict[str, np.ndarray]:
    """Compute amplitudes at frequencies (f,), Hz, for each quantity; see `measures.torque_spectrum`.

    Returns:
        By name of the quantity (f, c): "torque" by body axis in N m s, without an inertia instead "angular
        acceleration" in deg/s, and with wheels "wheel torques", by wheel, in N m s.
    """
    craft, trajectory = plan.scenario.spacecraft, plan.trajectory
    assert trajectory is not None
    if craft.inertia is None:
        found = measures.torque_spectrum(trajectory, craft, frequencies)
        return {"angular acceleration": np.rad2deg(np.asarray(found))}
    names = {"torque": "torque"} | ({"wheel torques": "wheel_torques"} if craft.wheels else {})
    return {
        name: np.asarray(measures.torque_spectrum(trajectory, craft, frequencies, of))
        for name, of in names.items()
    }


def unit_of(name: str) -> str:
    """Return the unit of the amplitudes of a quantity, by its name in `amplitudes`."""
    return "deg/s" if name == "angular acceleration" else "N m s"


def spectrum(
    plan: Plan, frequencies: ArrayLike = (), ax: Canvas = None, *, legend: bool = True
) -> list[Axes]:
    """Draw the spectrum of the platform's torque, and of each wheel's torque, with lines at frequencies.

    It is the amplitude of the Fourier transform over the whole manoeuvre, ``|integral of tau exp(-2 pi i f t)
    dt|`` in N m s, by body axis and by wheel; without an inertia that of the angular acceleration, in deg/s.
    An undamped mode of frequency f, at rest before, swings after the manoeuvre with an amplitude of this
    value divided by 2 pi f, times the gain of the mode.

    Args:
        plan: a plan with a trajectory that takes time.
        frequencies: () or (f,) Hz, positive, with a line at each; the legend gives the length of the vector
            there or, for wheels, the largest value of a wheel.
        ax: one axes for the platform and, with wheels, another for them; a figure to put them in, or None for
            a new one.
        legend: whether to name curves and lines beside the panels.

    Returns:
        The axes.

    Raises:
        TypeError: if it is no plan.
        ValueError: if the plan has no trajectory, or one that takes no time, a frequency is not positive, or
            another number of axes is given.
    """
    asked: np.ndarray = expect_frequencies(frequencies, zero=False)  # the axis is logarithmic
    last = motion(plan).times[-1]
    if not last > 0:
        raise ValueError(f"the plan of {plan.scenario.name!r} takes no time, so it has no spectrum")
    highest = max(_HIGHEST_FREQUENCY / last, _MULTIPLE_OF_ASKED * np.max(asked, initial=0.0))
    across = np.geomspace(_LOWEST_FREQUENCY / last, highest, _CURVE_POINTS)
    drawn, at_asked = amplitudes(plan, across), amplitudes(plan, asked)
    grid = panels(ax, len(drawn), size(len(drawn)))
    craft = plan.scenario.spacecraft
    for axes, (name, curves) in zip(grid, drawn.items(), strict=True):
        of_wheels = name == "wheel torques"
        styles = [device_style(n) for n in range(curves.shape[1])] if of_wheels else AXIS_STYLES
        for values, style in zip(curves.T, styles, strict=True):
            axes.plot(across, values, **{"linewidth": 1.2, **style})
        entries = list(AXIS_ENTRIES)
        if of_wheels:
            entries = device_entries(row_names(craft.wheels, craft.allocation))
        entries += _mark_frequencies(axes, asked, at_asked[name], name)
        tidy(axes)
        axes.set(xscale="log", xlim=(across[0], across[-1]))
        top = float(np.max(curves, initial=0.0))
        if top > 0:
            axes.set_yscale("log")
            axes.set_ylim(max(np.min(curves[curves > 0]) / 2, top * 10.0**-_MAX_DECADES), 2 * top)
        else:  # the platform does not turn, and a logarithmic axis has no place for zero
            axes.set_ylim(0, 1)
        axes.set_ylabel(f"{name}\n({unit_of(name)})", fontsize=TEXT)
        if legend:
            legend_beside(axes, entries)
    grid[-1].set_xlabel("frequency (Hz)", fontsize=TEXT)
    return grid


def _mark_frequencies(axes: Axes, frequencies: np.ndarray, values: np.ndarray, name: str) -> Entries:
    """Draw a line at each frequency (f,), Hz; returns legend entries with the amplitudes (f, c) there.

    `name` is that of the quantity in `amplitudes`.
    """
    entries: Entries = []
    for number, (frequency, own) in enumerate(zip(frequencies, values, strict=True)):
        look = {**_ASKED_LINE, "linestyle": (0, _DASHES[number % len(_DASHES)])}
        axes.axvline(frequency, **look, zorder=1.5)
        of_wheels = name == "wheel torques"
        size, whose = (
            (np.max(own), "largest wheel") if of_wheels else (np.linalg.norm(own), "vector's length")
        )
        entries.append((Line2D([], [], **look), f"{frequency:g} Hz: {size:.3g} {unit_of(name)} ({whose})"))
    return entries

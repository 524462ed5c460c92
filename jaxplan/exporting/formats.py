"""Export to all formats: check the arguments, certify the motion, and write all or nothing."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import get_args

import numpy as np

from jaxplan.exporting.ck import write_spice
from jaxplan.exporting.czml import write_czml
from jaxplan.exporting.flight import (
    Day,
    Flight,
    UncertifiedError,
    ending,
    expect_motion,
    flight_of,
    held,
    proof_of,
    scene_of,
)
from jaxplan.exporting.flight_code import what_is_needed, write_code
from jaxplan.exporting.instants import chosen_instants, steady_instants, step_fault, tolerance_fault
from jaxplan.exporting.messages import write_aem, write_stk
from jaxplan.exporting.pieces import write_pieces
from jaxplan.exporting.sampled import Sampling
from jaxplan.exporting.table_proof import SPARSEST, SPARSEST_DEG, Readings, expect_held, sparsest
from jaxplan.exporting.tables import write_basilisk, write_csv, write_npz
from jaxplan.model.epochs import parse_epoch
from jaxplan.model.export_names import ExportNames
from jaxplan.planner import Plan
from jaxplan.runtime.arguments import expect, expect_any, file_path
from jaxplan.runtime.files import free_place, replacing_file, replacing_folder
from jaxplan.schema.faults import closest
from jaxplan.sky import Satellite
from jaxplan.tables.table import HERMITE, RODRIGUES, SLERP
from jaxplan.tables.tolerances import FORGIVE_DEG, FORGIVE_PERCENT, forgiven

STEP_S = 0.1
"""s: between samples of a plan, unless told."""
TOLERANCE_DEG = 1e-4
"""deg: below which interpolation between samples of a day is off, unless told."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of file, or of a folder with several files.

    Attributes:
        write: function that writes a motion to a path; for a folder, an empty one.
        suffix: suffix of default names.
        parts: suffixes of the files in a folder; empty for a single file.
        dated: whether it needs an epoch.
        needs: names of modules that must be installed beyond the required ones.
        extra: the extra of jaxplan that installs them.
        tolerance_deg: default tolerance of interpolation, deg, also for a single manoeuvre; None for the
            defaults that most formats have (`STEP_S` for plans, `TOLERANCE_DEG` for days).
        placed: whether it says where the spacecraft is.
        interpolation: what its readers do between samples, one of `jaxplan.tables.INTERPOLATIONS`.
        alternative: what some of them do instead, another of these; None where all do the same.
        exact: whether it holds the polynomials themselves instead of samples.
        needed: function that describes what using a motion in this format takes; None where that is obvious.
    """

    write: Callable[[Sampling, Path], None]
    suffix: str
    parts: tuple[str, ...] = ()
    dated: bool = False
    needs: tuple[str, ...] = ()
    extra: str = "spice"
    tolerance_deg: float | None = None
    placed: bool = False
    interpolation: str = SLERP
    alternative: str | None = None
    exact: bool = False
    needed: Callable[[Flight], str] | None = None


FORMATS = {
    "aem": Format(write=write_aem, suffix=".aem", dated=True, alternative=HERMITE),  # Orekit's
    "ck": Format(
        write=write_spice,
        suffix=".ck",
        parts=(".bc", ".tf", ".tsc", ".ti"),
        dated=True,
        needs=("spiceypy", "erfa"),
    ),
    "stk": Format(write=write_stk, suffix=".stk", parts=(".a", ".sp", ".int"), dated=True),
    "czml": Format(
        write=write_czml,
        suffix=".czml",
        dated=True,
        needs=("czml3", "erfa"),
        extra="czml",
        tolerance_deg=5e-5,
        placed=True,
    ),
    "basilisk": Format(write=write_basilisk, suffix=".basilisk.csv", interpolation=RODRIGUES),
    "csv": Format(write=write_csv, suffix=".csv"),
    "npz": Format(write=write_npz, suffix=".npz"),
    "c": Format(write=write_code, suffix=".c99", parts=(".c", ".h"), exact=True, needed=what_is_needed),
    "json": Format(write=write_pieces, suffix=".pieces.json", exact=True),
}


def export(
    plan: Plan | Day,
    path: str | os.PathLike[str],
    *,
    format: str,
    epoch: str | None = None,
    step_s: float | str | None = None,
    tolerance_deg: float | None = None,
    names: ExportNames | None = None,
    observer: Satellite | None = None,
    forgive_deg: float = FORGIVE_DEG,
    forgive_percent: float = FORGIVE_PERCENT,
    overwrite: bool = False,
) -> Path:
    """Write a plan or a day as a file of another tool, or as a folder for ``"ck"``, ``"stk"`` and ``"c"``.

    The motion is certified anew first and not written if that fails. (Use ``plan.trajectory.sample`` to get
    numbers of an uncertified motion.) A day is one file without gaps, in which activities and slews are
    distinguished where the format can: as segments of ``"aem"``, columns of ``"csv"``, arrays of ``"npz"``, a
    list of intervals of ``"stk"``, and in the comments of ``"ck"``.

    Readers of a table interpolate between its rows. So zones, ranges and rates are also proved for the motion
    that readers of the format make of the table (`jaxplan.certify_table`, with joints linear there), and a
    table that breaks them by more than is forgiven is refused. A motion that takes no time is a table of a
    second at rest.

        >>> jp.export(plan, "slew.aem", format="aem", epoch="2026-01-01T00:00:00")
        >>> jp.export(day, "day.ck", format="ck", names=jp.ExportNames(naif_id=-2000, frame_name="EO1_BUS"))

    Args:
        plan: a certified plan, or a day, which has ``ok``, ``scene``, ``trajectory``, ``segments`` and
            ``certify()``.
        path: the file or folder. It is written completely or not at all.
        format: ``"aem"``, ``"ck"`` (extra ``spice``), ``"stk"``, ``"czml"`` (extra ``czml``), ``"basilisk"``,
            ``"csv"`` or ``"npz"``; or the polynomials themselves, as code in C99, ``"c"``, or as JSON,
            ``"json"``.
        epoch: UTC of the start in ISO 8601; None for that of the scene. The first four formats need one,
            tables note it, and Basilisk counts from the start of its simulation.
        step_s: s, time between samples; the end and the ends of segments are samples, too. ``"sparsest"``
            takes as few samples as `tolerance_deg` (then 0.05 deg by default) and the proof of the table
            allow. Not for ``"c"`` and ``"json"``.
        tolerance_deg: deg, instead of a step: samples are chosen so that linear interpolation of the
            attitude, of each device's frame and of joints is off by less. If neither is given, plans are
            sampled each 0.1 s and days to 1e-4 deg, and both to 5e-5 deg for ``"czml"``.
        names: how the files call the spacecraft and its frames; None for those of the day, or defaults.
        observer: orbit of the spacecraft, for ``"czml"`` alone: one of `jaxplan.sky`, as
            `jaxplan.sky.read_oem` and `jaxplan.sky.parse_tle` make them. If None, the spacecraft stands still
            over the equator.
        forgive_deg: deg in [0, 1], by which margins of a table may fall short of zero, as of `certify_table`.
        forgive_percent: percent in [0, 10] of a limit or range, by which a table may exceed it.
        overwrite: whether an existing file may be replaced, or a folder that holds only files of this format.
            Plans, and files of scenarios and timelines, are never replaced.

    Returns:
        The path.

    Raises:
        TypeError: if it is no plan, path or names.
        UncertifiedError: (a ValueError) if the plan is not certified, fails when certified anew, or its table
            breaks something when readers interpolate it.
        ValueError: if format, epoch, step or tolerance is invalid or the scene has another epoch, with all
            faults at once; if there would be too many samples; if an extra is missing.
        FileExistsError: if something exists at the path and `overwrite` is false; if what is there is no
            file (a device or pipe), or itself a plan or the file of a scenario or timeline.
    """
    expect_motion(plan)
    file_path("path", path)
    if names is not None:
        expect("names", names, ExportNames)
    forgives = forgiven(forgive_deg, forgive_percent)
    kind, start = _check_arguments(plan, format, epoch, step_s, tolerance_deg)
    absent = [module for module in kind.needs if find_spec(module) is None]
    if absent:
        extra = f"pip install 'jaxplan[{kind.extra}]'"
        raise ValueError(f"format {format} needs {' and '.join(absent)}: {extra}")
    if observer is not None:
        expect_any("observer", observer, get_args(Satellite), "an orbit, as those of jaxplan.sky")
        if not kind.placed:
            raise ValueError(f"observer: format {format} does not say where the spacecraft is, czml does")
    target = free_place(path, kind.parts, overwrite=overwrite)
    flight = flight_of(plan) if kind.exact else held(flight_of(plan))
    few = step_s == SPARSEST
    near = kind.tolerance_deg if tolerance_deg is None else tolerance_deg
    steady = flight.boundaries if kind.exact or few else _steady_times(flight, step_s, near)
    proof = proof_of(plan)
    if not proof.certified:
        reasons = "; ".join(proof.faults)
        raise UncertifiedError(f"the plan of {flight.name} fails its certificate, made anew: {reasons}")
    usual = SPARSEST_DEG if few else kind.tolerance_deg or TOLERANCE_DEG
    tolerance = float(np.deg2rad(usual if tolerance_deg is None else tolerance_deg))
    how = Readings(kind.interpolation, kind.alternative)
    rodrigues = how.usual == RODRIGUES
    sampling = Sampling(
        flight=flight,
        start=start,
        times=chosen_instants(flight, tolerance, rodrigues=rodrigues) if steady is None else steady,
        names=names or flight.names or ExportNames(),
        tolerance=tolerance if steady is None else None,
        observer=observer,
    )
    if few and not kind.exact:
        sampling = sparsest(plan, sampling, how, tolerance, forgives)
    elif not kind.exact:
        expect_held(plan, sampling, how, format, forgives)
    with (replacing_folder if kind.parts else replacing_file)(target) as fresh:
        kind.write(sampling, fresh)
    return target


def _check_arguments(
    plan: Plan | Day,
    format: str,
    epoch: str | None,
    step_s: float | str | None,
    tolerance_deg: float | None,
) -> tuple[Format, np.datetime64 | None]:
    """Check the arguments; return the format, and UTC of time zero (None where it is not known).

    Raises:
        UncertifiedError: if the only fault is that the plan is not certified.
        ValueError: with all faults.
    """
    kind, start = FORMATS.get(str(format)), None
    faults = [] if kind else [f"format = {format!r}: {_format_advice(str(format))}"]
    try:
        start = _resolve_start(plan, epoch, format)
    except ValueError as error:
        faults.append(str(error))
    if plan.trajectory is None or not plan.ok:
        faults.append(ending(plan))
    faults += _instant_faults(step_s, tolerance_deg)
    if kind is not None and kind.exact and (step_s is not None or tolerance_deg is not None):
        faults.append(
            f"step_s, tolerance_deg: format {format} holds polynomials and no samples, so it takes neither"
        )
    if faults == [ending(plan)]:
        raise UncertifiedError(*faults)
    if faults or kind is None:
        raise ValueError("\n  ".join([f"{len(faults)} faults:", *faults] if len(faults) > 1 else faults))
    return kind, start


def _steady_times(
    flight: Flight, step_s: float | str | None, tolerance_deg: float | None
) -> np.ndarray | None:
    """Return instants (k,) s in equal steps, for a given step or a plan's default; None if to be chosen."""
    if step_s is None and (tolerance_deg is not None or flight.segments):
        return None
    return steady_instants(flight.boundaries, STEP_S if step_s is None else float(step_s))


def _resolve_start(plan: Plan | Day, epoch: str | None, format: str) -> np.datetime64 | None:
    """Return UTC of time zero, from the argument or else the scene; None where neither has it.

    Raises:
        ValueError: if it is no time, differs from the scene's, or is absent though the format needs one.
    """
    own, kind = scene_of(plan).epoch, FORMATS.get(str(format))
    start = own if epoch is None else parse_epoch(epoch)
    if start is not None and own is not None and start != own:
        raise ValueError(
            f"epoch = {epoch!r}: the scene begins at {own}, and its zones and targets are of then"
        )
    if kind is not None and kind.dated and start is None:
        raise ValueError(f"epoch: format {format} needs the UTC of the start, such as 2026-01-01T00:00:00")
    return start


def _instant_faults(step_s: object, tolerance_deg: object) -> list[str]:
    """Return a sentence for each fault of step and tolerance, of which at most one may be given."""
    few = isinstance(step_s, str) and step_s == SPARSEST
    faults = [
        None if step_s is None or few else step_fault(step_s),
        None if tolerance_deg is None else tolerance_fault(tolerance_deg),
    ]
    if step_s is not None and not few and tolerance_deg is not None:
        faults.append("step_s, tolerance_deg: one of them is enough, since both say when samples are")
    return [fault for fault in faults if fault is not None]


def needed_by(plan: Plan | Day, format: str) -> str:
    """Describe what using a plan or day in a format takes, in space and time; "" where that is obvious."""
    needed = FORMATS[format].needed
    return "" if needed is None else needed(flight_of(plan))


def _format_advice(name: str) -> str:
    """Return advice on an unknown format: all that there are, and the one that may be meant."""
    known = f"the formats are {', '.join(FORMATS)}"
    close = closest(name, tuple(FORMATS))
    return known if close is None else f"perhaps {close} is meant; {known}"


def default_path(plan_file: str | os.PathLike[str], format: str) -> Path:
    """Return the path beside a plan file with its name and the format's suffix, such as ``plan.aem``."""
    kind = FORMATS.get(format)
    return Path(plan_file).with_suffix(f".{format}" if kind is None else kind.suffix)

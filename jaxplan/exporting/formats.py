"""The export to all formats: it checks the arguments, certifies the plan anew, and writes all or nothing."""

import errno
import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from jaxplan.exporting.sampled import Sampled, instants, sample
from jaxplan.exporting.spice import write_spice
from jaxplan.exporting.writers import write_aem, write_basilisk, write_csv, write_npz, write_stk
from jaxplan.model.epochs import parse_epoch
from jaxplan.planner import Plan, certify
from jaxplan.runtime.arguments import expect, file_path
from jaxplan.runtime.files import replacing_file, replacing_folder
from jaxplan.schema.faults import nearest


class UncertifiedError(ValueError):
    """A plan is not written, since its motion is not certified."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of file, or of folder with several files.

    Attributes:
        write: function that writes a sampled motion to a path; for a folder, an empty one.
        suffix: of a name where the user gives none.
        parts: suffixes of the files of a folder, empty for a single file.
        dated: whether it cannot do without an epoch.
        needs: modules to be installed beyond the required ones.
    """

    write: Callable[[Sampled, Path], None]
    suffix: str
    parts: tuple[str, ...] = ()
    dated: bool = False
    needs: tuple[str, ...] = ()


FORMATS = {
    "aem": Format(write=write_aem, suffix=".aem", dated=True),
    "ck": Format(
        write=write_spice,
        suffix=".ck",
        parts=(".bc", ".tf", ".tsc"),
        dated=True,
        needs=("spiceypy", "erfa"),
    ),
    "stk": Format(write=write_stk, suffix=".stk", parts=(".a", ".sp"), dated=True),
    "basilisk": Format(write=write_basilisk, suffix=".basilisk.csv"),
    "csv": Format(write=write_csv, suffix=".csv"),
    "npz": Format(write=write_npz, suffix=".npz"),
}


def export(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    format: str,
    epoch: str | None = None,
    step_s: float = 0.1,
    overwrite: bool = False,
) -> Path:
    """Write a plan as a file of another tool, or as a folder of them for ``"ck"`` and ``"stk"``.

    The plan is certified anew first; one that does not pass is not written. Numbers of an uncertified motion
    come from ``plan.trajectory.sample``.

    Args:
        plan: a certified one.
        path: the file or folder. It appears whole or not at all.
        format: ``"aem"``, ``"ck"`` (extra ``spice``), ``"stk"``, ``"basilisk"``, ``"csv"`` or ``"npz"``.
        epoch: UTC of the start in ISO 8601, that of the scene unless told. The first three need it, in the
            last two it is noted, Basilisk counts from the start of its simulation.
        step_s: between two samples, s; the end is one, too.
        overwrite: whether an old file may be replaced, or a folder that holds files of this format only.

    Returns:
        The path.

    Raises:
        TypeError: for what is no plan or path.
        UncertifiedError: (a ValueError) if the plan is not certified, or its certificate, made anew, fails.
        ValueError: if the format, epoch or step is no good or the scene has another epoch, all faults at
            once; if an extra is missing.
        FileExistsError: if there is something at the path.
    """
    expect("plan", plan, Plan, "jp.load_plan reads one from a file")
    file_path("path", path)
    faults = []
    own, start, times, kind = plan.scenario.epoch, None, np.zeros(0), FORMATS.get(str(format))
    if kind is None:
        faults.append(f"format = {format!r}: {nearest(str(format), tuple(FORMATS), 'formats')}")
    try:
        start = own if epoch is None else parse_epoch(epoch)
    except ValueError as error:
        faults.append(str(error))
    if start is not None and own is not None and start != own:
        faults.append(f"epoch = {epoch!r}: the scene begins at {own}, and its zones and targets are of then")
    if kind is not None and kind.dated and epoch is None and own is None:
        faults.append(f"epoch: format {format} needs the UTC of the start, such as 2026-01-01T00:00:00")
    if plan.trajectory is None or not plan.ok:
        faults.append(ending(plan))
    else:
        try:
            times = instants(plan.trajectory.duration, step_s)
        except ValueError as error:
            faults.append(str(error))
    if faults == [ending(plan)]:
        raise UncertifiedError(*faults)
    if faults or kind is None:
        raise ValueError("\n  ".join([f"{len(faults)} faults:", *faults] if len(faults) > 1 else faults))
    absent = [module for module in kind.needs if find_spec(module) is None]
    if absent:
        raise ValueError(f"format {format} needs {' and '.join(absent)}: pip install 'jaxplan[spice]'")
    target = free_place(path, kind.parts, overwrite=overwrite)
    report = certify(plan)
    if not report.certified:
        reasons = "; ".join(report.faults)
        raise UncertifiedError(
            f"the plan of {plan.scenario.name} fails its certificate, made anew: {reasons}"
        )
    sampled = sample(plan, start, times)
    with (replacing_folder if kind.parts else replacing_file)(target) as fresh:
        kind.write(sampled, fresh)
    return target


def default_path(plan_file: str | os.PathLike[str], format: str) -> Path:
    """Path beside a plan file that is named after it and the format, such as ``plan.aem``."""
    kind = FORMATS.get(format)
    return Path(plan_file).with_suffix(f".{format}" if kind is None else kind.suffix)


def ending(plan: Plan) -> str:
    """Message on what a plan that is not certified lacks, and how it ended."""
    lack = "has no trajectory" if plan.trajectory is None else "is not certified"
    ending = ": ".join(filter(None, [plan.status.name, plan.message]))
    return f"the plan of {plan.scenario.name} {lack}; it ended as {ending}"


def free_place(path: str | os.PathLike[str], parts: tuple[str, ...] = (), *, overwrite: bool) -> Path:
    """Check that a path may be written to, and return it.

    Args:
        path: of a file, or of a folder.
        parts: suffixes of the files of a folder, empty for a single file.
        overwrite: whether an old file may be replaced, or a folder that holds files of these suffixes only.

    Raises:
        FileExistsError: if something is there, and `overwrite` is false.
        ValueError: if the path is empty, or what is there is not such a file or folder.
    """
    if not os.fspath(path):
        raise ValueError("path is empty, it must name a file or folder to write")
    target = Path(path)
    if not parts and target.is_dir():
        raise ValueError(f"{target}: is a folder, and this format is a file")
    if not os.path.lexists(target):
        return target
    if not overwrite:
        hint = "is there already; overwrite=True (--force) replaces it"
        raise FileExistsError(errno.EEXIST, hint, os.fspath(path))
    if parts and (target.is_symlink() or not target.is_dir()):
        raise ValueError(f"{target}: is a file, and this format is a folder of files")
    foreign = sorted(
        p.name for p in (target.iterdir() if parts else ()) if p.suffix not in parts or not p.is_file()
    )
    if foreign:
        raise ValueError(
            f"{target}: holds {foreign[0]}, so it is not replaced; only {', '.join(parts)} may be there"
        )
    return target

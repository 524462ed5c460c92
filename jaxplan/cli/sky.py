"""The command ``passes``: when satellites and points of the ground in a file's ``[sky]`` can be seen."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from jaxplan.cases import TIMELINE_NAMES
from jaxplan.cli.common import DONE, print_result
from jaxplan.cli.timelines import file_of
from jaxplan.model.epochs import utc_stamps
from jaxplan.runtime.display import in_columns
from jaxplan.runtime.progress import progress_bar
from jaxplan.schema import Sky, load_sky
from jaxplan.schema.faults import nearest
from jaxplan.sky import Pass
from jaxplan.sky.passes import LONGEST

_HEAD = ("target", "from (UTC)", "until (UTC)", "lasts s", "best (UTC)", "up deg", "off nadir deg", "km")
_COLUMN_ALIGNMENT = "<<>>>>>>"


def passes(options: argparse.Namespace) -> int:
    """Print the passes of the targets in a file's [sky], in the order in which they begin.

    A pass is a time over which the spacecraft can see a target.
    """
    path = Path(file_of(options.scene))
    if not path.is_file():
        what = "is a folder, name a file in it" if path.is_dir() else "no such file"
        raise ValueError(
            f"{options.scene}: {what}; it must have [sky], as {' and '.join(TIMELINE_NAMES)} have"
        )
    seen = load_sky(path)
    names = list(dict.fromkeys(options.targets)) or list(seen.things)
    unknown = [name for name in names if name not in seen.things]
    if unknown or not names:
        told = [f"{name}: no such target, {nearest(name, list(seen.things), 'names')}" for name in unknown]
        raise ValueError(f"{options.scene}: {'; '.join(told) or seen.known}")
    if options.duration is not None and not 0 < options.duration <= LONGEST:
        raise ValueError(f"--for {options.duration:g}: must lie in (0, {LONGEST:.0f}] s, which is 31 days")
    found: list[Pass] = []
    with progress_bar("looking", "targets", total=len(names)) as bar:
        for name in names:
            found += seen.passes(name, duration_s=options.duration)
            bar.update()
    found.sort(key=lambda one: (one.start, one.target))
    duration = seen.duration if options.duration is None else options.duration
    never = [name for name in names if name not in {one.target for one in found}]
    if options.json:
        print_result({"epoch_utc": str(seen.epoch), "for_s": duration, "passes": _pass_records(found, seen)})
    else:
        notes = [f"never seen in {duration:g} s: {', '.join(never)}"] if never else []
        print_result("\n".join([*_table_lines(found, seen), *notes]))
    return DONE


def _pass_records(found: list[Pass], seen: Sky) -> list[dict[str, Any]]:
    """Passes as dicts in the units of files; instants in s from the epoch, and in UTC."""
    return [
        {
            "target": one.target,
            "from_s": one.start,
            "until_s": one.end,
            "best_s": one.best,
            **dict(zip(("from_utc", "until_utc", "best_utc"), _pass_stamps(one, seen), strict=True)),
            "elevation_deg": None if one.elevation is None else float(np.rad2deg(one.elevation)),
            "off_nadir_deg": float(np.rad2deg(one.off_nadir)),
            "distance_km": one.distance,
        }
        for one in found
    ]


def _pass_stamps(one: Pass, seen: Sky) -> list[str]:
    """UTC texts of the beginning, end and best instant of a pass, to the millisecond."""
    return utc_stamps(seen.epoch, [one.start, one.end, one.best])


def _table_lines(found: list[Pass], seen: Sky) -> list[str]:
    """Lines of a table of passes, the first with the titles of columns; an empty list without passes.

    Beginning and end are rounded to whole seconds within the pass, if it has any.
    """
    if not found:
        return []
    rows = [_HEAD]
    for one in found:
        # first and last whole second within the pass
        inside = [np.ceil(one.start), np.floor(one.end), one.best]
        if not inside[0] <= inside[1]:  # no whole second is within
            inside[:2] = one.start, one.end
        start, end, best = (text.replace("T", " ")[:19] for text in utc_stamps(seen.epoch, inside))
        high = "" if one.elevation is None else f"{np.rad2deg(one.elevation):.1f}"
        off = f"{np.rad2deg(one.off_nadir):.1f}"
        rows.append((one.target, start, end, f"{one.duration:.0f}", best, high, off, f"{one.distance:.0f}"))
    return in_columns(rows, _COLUMN_ALIGNMENT)

"""Studies as data frames and Parquet files, by pandas and pyarrow, which the extra ``study`` brings."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from jaxplan.runtime.files import replacing_file
from jaxplan.study.rows import COLUMNS, TIMES

if TYPE_CHECKING:
    import pandas as pd

    from jaxplan.study.result import Study

_TYPES = {int: "Int64", float: "Float64", bool: "boolean", str: "string"}  # those of pandas that have NA


def to_pandas(study: "Study") -> "pd.DataFrame":
    """See `Study.to_pandas`."""
    try:
        import pandas as pd
    except ImportError as error:
        raise _missing("pandas") from error
    times = {row["scene"]: row for row in study.timings}
    columns = {**COLUMNS, **TIMES}
    rows = [{**times.get(row["scene"], {}), **row} for row in study.table]
    return pd.DataFrame(
        {
            name: pd.array([row.get(name) for row in rows], dtype=_TYPES[kind])
            for name, kind in columns.items()
        }
    )


def to_parquet(study: "Study", path: str | os.PathLike[str]) -> None:
    """See `Study.to_parquet`."""
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise _missing("pyarrow") from error
    frame = to_pandas(study)
    with replacing_file(Path(path)) as temporary:
        frame.to_parquet(temporary, engine="pyarrow", index=False)


def _missing(package: str) -> ImportError:
    return ImportError(
        f"{package} is missing: install the extra that brings it, pip install 'jaxplan[study]'"
    )

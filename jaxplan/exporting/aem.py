"""CCSDS Attitude Ephemeris Message 2.0 (CCSDS 504.0-B-2) in its keyword form.

The frame A is EME2000, B the body. Quaternions turn A into B in the message's sense, which is ours of body to
inertial, with the scalar last; angular velocities are in degrees per second in body axes; times are UTC.
"""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from jaxplan.exporting.sampled import Sampled, plain, progress, table_lines
from jaxplan.model.epochs import utc_texts


def write_aem(sampled: Sampled, path: Path) -> None:
    """Write the message.

    Args:
        sampled: with a start.
        path: the file. Its CREATION_DATE is the one line that differs from one writing to the next.
    """
    assert sampled.start is not None
    stamps = utc_texts(sampled.start, sampled.times)
    body = "SC_BODY_1"
    header = {
        "CCSDS_AEM_VERS": "2.0",
        "CREATION_DATE": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S}",
        "ORIGINATOR": "JAXPLAN",
        "META_START": None,
        "OBJECT_NAME": plain(sampled.name),
        "OBJECT_ID": "UNKNOWN",
        "REF_FRAME_A": "EME2000",
        "REF_FRAME_B": body,
        "TIME_SYSTEM": "UTC",
        "START_TIME": stamps[0],
        "STOP_TIME": stamps[-1],
        "ATTITUDE_TYPE": "QUATERNION/ANGVEL",
        "ANGVEL_FRAME": body,
        "META_STOP": None,
        "DATA_START": None,
    }
    numbers = table_lines(
        [np.roll(sampled.quaternions, -1, axis=1), np.rad2deg(sampled.values.angular_velocity)]
    )
    with path.open("w", encoding="ascii") as file:
        file.writelines(
            f"{key}\n" if value is None else f"{key} = {value}\n" for key, value in header.items()
        )
        rows = (f"{stamp} {row}" for stamp, row in zip(stamps, numbers, strict=True))
        file.writelines(progress(rows, len(stamps)))
        file.write("DATA_STOP\n")

"""The file that Basilisk's ``fswAlgorithms.waypointReference`` flies, with ``attitudeType = 1``.

Columns, without a header: time (s, from the start of the simulation), quaternion (body to inertial in our
sense, scalar first: Basilisk's beta_RN), angular velocity (rad/s) and acceleration (rad/s^2), both in
inertial components, as ``useReferenceFrame = False`` has it.
"""

from pathlib import Path

import numpy as np

from jaxplan.exporting.sampled import Sampled, progress, table_lines


def write_basilisk(sampled: Sampled, path: Path) -> None:
    """Write the waypoints.

    Args:
        sampled: the manoeuvre. Of one that takes no time the waypoint stands twice, a second apart, since
            Basilisk takes the second of a single one for zeros.
        path: the file.
    """
    columns = [
        sampled.times,
        sampled.quaternions,
        sampled.inertial(sampled.values.angular_velocity),
        sampled.inertial(sampled.values.angular_acceleration),
    ]
    if len(sampled.times) == 1:
        columns = [np.repeat(column, 2, axis=0) for column in columns]
        columns[0][1] += 1.0
    with path.open("w", encoding="ascii") as file:
        file.writelines(progress(table_lines(columns, separator=","), len(columns[0])))

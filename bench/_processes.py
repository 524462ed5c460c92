"""What processes take, time and memory, and samples of what there is to plan."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

_TICKS = os.sysconf("SC_CLK_TCK")  # clock ticks a second


def evenly(total: int, count: int) -> list[int]:
    """Numbers of `count` satellites, evenly spread over all."""
    return np.unique(np.linspace(0, total - 1, min(count, total)).astype(int)).tolist()


def cpu_seconds(processes: Sequence[int]) -> float:
    """CPU time of processes, by their ids, so far, s."""
    fields = [Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split() for process in processes]
    return sum(int(each[11]) + int(each[12]) for each in fields) / _TICKS


def peak_memory(processes: Sequence[int]) -> float:
    """Peak of the resident memory of processes, by their ids, summed, MiB."""
    lines = [Path(f"/proc/{process}/status").read_text().splitlines() for process in processes]
    return sum(int(line.split()[1]) for each in lines for line in each if line.startswith("VmHWM")) / 1024

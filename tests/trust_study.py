"""Kill a study again and again, share it out in every way, and compare the tables byte for byte.

    python tests/trust_study.py [-n 500] [--kills 20] [--kind keep_in] [--planner mha] [--seed 0]

The study is planned once without a fault. Then it is killed at random moments, begun again each time with the
same arguments, and finished; and it is planned by two processes, of which some are killed, by Dask where that
is installed, and in chunks of several sizes. Exit code 0 if all tables are the same.
"""

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TextIO

import jaxplan as jp

PROGRAM = """
import sys, jaxplan as jp
if __name__ == "__main__":
    count, kind, planner, workers, folder = sys.argv[1:]
    jp.run_study(range(int(count)), kind, planner, workers=int(workers) or None, out=folder, progress=False)
"""


def main() -> int:
    chosen = options()
    with tempfile.TemporaryDirectory() as folder:
        ways = Trial(chosen, Path(folder)).run(sys.stdout)
    return int(False in ways.values())


def options(words: Sequence[str] | None = None) -> argparse.Namespace:
    """What the words of a command ask for; those of this process by default."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-n", "--scenes", type=int, default=500, help="of the study (%(default)s)")
    parser.add_argument("--kills", type=int, default=20, help="at random moments (%(default)s)")
    parser.add_argument("--kind", default="keep_in", help="of the scenes (%(default)s)")
    parser.add_argument("--planner", default="mha", help="(%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the random moments (%(default)s)")
    return parser.parse_args(words)


class Trial:
    """One study in many ways."""

    def __init__(self, options: argparse.Namespace, folder: Path) -> None:
        self.options, self.folder = options, folder
        self.chance = random.Random(options.seed)
        self.program = folder / "program.py"
        self.program.write_text(PROGRAM)
        # What is compiled is shared, so that those who begin again soon plan.
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder / "compiled"))
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
        os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")

    def run(self, said: TextIO) -> dict[str, bool | None]:
        """Compare all ways with the plain one: whether the table is the same, None where it was skipped."""
        began = time.monotonic()
        self.finish(self.begin("plain", 0))
        seconds = time.monotonic() - began
        expected = self.table("plain")
        fingerprint = hashlib.sha256(expected).hexdigest()[:16]
        print(f"{self.options.scenes} scenes, {fingerprint}, {seconds:.0f} s", file=said, flush=True)
        ways: dict[str, Callable[[str], object]] = {
            f"{self.options.kills} kills": self.killed,
            "2 processes": lambda name: self.finish(self.begin(name, 2)),
            "2 processes, a worker killed": self.worker_killed,
            "chunks of 1": lambda name: self.chunked(name, 1),
            "chunks of 17": lambda name: self.chunked(name, 17),
            "chunks of 256": lambda name: self.chunked(name, 256),
            "Dask, 2 workers": self.dask,
        }
        found: dict[str, bool | None] = {}
        for name, way in ways.items():
            began = time.monotonic()
            told = way(name)
            if told is not None:
                print(f"{name:30} {told}", file=said)
            same = self.table(name) == expected if (self.folder / name).exists() else None
            verdict = {None: "skipped", True: "the same, byte for byte", False: "DIFFERENT"}[same]
            print(f"{name:30} {verdict}, {time.monotonic() - began:.0f} s", file=said, flush=True)
            found[name] = same
        return found

    def begin(self, name: str, workers: int) -> subprocess.Popen[bytes]:
        """Begin the study, or go on with it."""
        options = self.options
        words = [options.scenes, options.kind, options.planner, workers, self.folder / name]
        quiet = {**os.environ, "PYTHONWARNINGS": "ignore"}  # semaphores of a killed process are cleaned up
        return subprocess.Popen([sys.executable, self.program, *map(str, words)], env=quiet)

    def finish(self, process: subprocess.Popen[bytes]) -> None:
        """Wait for its end."""
        if process.wait():
            raise SystemExit(f"the study ended with exit code {process.returncode}")

    def table(self, name: str) -> bytes:
        """The table of a study, which must be complete."""
        study = jp.load_study(self.folder / name)
        return "\n".join(map(json.dumps, study.table)).encode() if study.complete else b"incomplete"

    def killed(self, name: str) -> str:
        """Kill the study at random moments all through it, by turns with one process and with two."""
        scenes, done = self.options.scenes, []
        path = self.folder / name / "table.jsonl"
        for kill, aim in enumerate(sorted(self.chance.choices(range(scenes), k=self.options.kills))):
            process = self.begin(name, 2 * (kill % 2))
            while _lines(path) < aim and process.poll() is None:
                time.sleep(0.01)
            time.sleep(self.chance.uniform(0, 1))
            process.send_signal(signal.SIGKILL)
            if process.wait() == -signal.SIGKILL:
                done.append(_lines(path))
        self.finish(self.begin(name, 0))
        return f"{len(done)} hit, after {done} scenes"

    def worker_killed(self, name: str) -> str:
        """Kill workers of a study, not the study."""
        process = self.begin(name, 2)
        path, victims = self.folder / name / "table.jsonl", 0
        while process.poll() is None and victims < 2:
            before = _size(path)
            while _size(path) <= before and process.poll() is None:
                time.sleep(0.005)
            workers = _workers(process.pid)
            if workers:
                os.kill(self.chance.choice(workers), signal.SIGKILL)
                victims += 1
                time.sleep(1.0)
        self.finish(process)
        return f"{victims} killed"

    def chunked(self, name: str, chunk: int) -> None:
        """In chunks of one size, in this process."""
        options = self.options
        jp.run_study(
            range(options.scenes),
            options.kind,
            options.planner,
            out=self.folder / name,
            chunk=chunk,
            progress=False,
        )

    def dask(self, name: str) -> str | None:
        """By two workers of Dask."""
        try:
            from distributed import Client, LocalCluster
        except ImportError:
            return "is not installed: pip install 'jaxplan[dask]'"
        options = self.options
        with (
            LocalCluster(
                n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
            ) as cluster,
            Client(cluster) as client,
        ):
            jp.run_study(
                range(options.scenes),
                options.kind,
                options.planner,
                workers=client.get_executor(),
                out=self.folder / name,
                progress=False,
            )
        return None


def _lines(path: Path) -> int:
    return path.read_bytes().count(b"\n") if path.exists() else 0


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _workers(pid: int) -> list[int]:
    """Processes that plan for a study: its children, without the one that looks after semaphores."""
    found = []
    for entry in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in entry.read_text().split():
            try:
                command = Path(f"/proc/{child}/cmdline").read_bytes()
            except OSError:
                continue
            if b"spawn_main" in command:
                found.append(int(child))
    return found


if __name__ == "__main__":
    sys.exit(main())

"""What the command line is given that is no good, and the proof that it does no harm.

Each case is a folder with files in it and a command. It must end with exit code 2, or with 3 if a certificate
fails, and a message on stderr with the words that tell place, value and range, without a traceback, without
anything on stdout, and with every file as it was before.
"""

import contextlib
import io
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

from jaxplan.cli import main
from trust.bad_plans import exports, plans
from trust.bad_scenarios import scenarios
from trust.bad_studies import studies

Command = tuple[str, ...]
Make = Callable[[Path], Command]


@cache
def cases() -> dict[str, tuple[Make, str]]:
    """All of them: what makes the files and says the command, and words of the message."""
    return {**scenarios(), **plans(), **exports(), **studies()}


def content(folder: Path) -> dict[str, object]:
    """All that is in a folder."""
    return {
        str(file.relative_to(folder)): os.readlink(file)
        if file.is_symlink()
        else file.read_bytes()
        if file.is_file()
        else None
        for file in folder.rglob("*")
    }


def refuse(make: Make, words: str, folder: Path) -> None:
    """Run a command that is to be refused."""
    command = make(folder)
    before = content(folder)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(list(command))
    wanted = 3 if "certificate" in words else 2
    assert (code, out.getvalue()) == (wanted, ""), (code, out.getvalue()[:200], err.getvalue()[:500])
    assert words in err.getvalue(), err.getvalue()[:1000]
    assert "Traceback" not in err.getvalue()
    assert err.getvalue().count("\n") < 1100
    after = content(folder)
    changed = {name for name in before.keys() | after.keys() if before.get(name, 0) != after.get(name, 0)}
    assert not changed - {"out"}, f"changed: {sorted(changed)}"
    assert not any(name.startswith("out/") for name in after)


def attempt(name: str) -> str:
    """One case by its name; returns its group."""
    with tempfile.TemporaryDirectory() as folder:
        trap = Path(folder) / "trap"
        os.environ["JAXPLAN_TRAP"] = str(trap)
        (Path(folder) / "work").mkdir()
        refuse(*cases()[name], Path(folder) / "work")
        assert not trap.exists(), "a pickle was executed"
    return name.partition(":")[0]

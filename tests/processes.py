"""Processes of their own, whose user has another home."""

import json
import os
import subprocess
import sys


def fresh_python(code, home, **environment):
    """What the code prints as JSON, and what comes on stderr, in a process whose user's home is a folder."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("JAX_", "XDG_"))}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=inherited | {"JAX_PLATFORMS": "cpu", "HOME": str(home)} | environment,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1]), done.stderr

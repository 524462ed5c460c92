"""Attitude planning for spacecraft with several moving pointing devices: differentiable, certified, in JAX.

    >>> import jaxplan as jp
    >>> plan = jp.plan(jp.paper_case(2))
    >>> print(plan)

Planning a scenario takes four steps: goal, path, trajectory and certificate. The result is a `Plan`. A
scenario is built in Python from `Scenario` and its parts, or comes from `load_scenario`, `paper_case` or
`random_scenario`. Angles are in radians, times in seconds, and attitudes are rotations from body to inertial
axes; files name the unit in each key. Names are loaded when they are first used, so that importing the
package is quick.
"""

from typing import TYPE_CHECKING

from jaxplan.runtime.lazy_imports import late
from jaxplan.version import __version__ as __version__

if TYPE_CHECKING:
    from jaxplan import plotting as plot
    from jaxplan import sky
    from jaxplan.cases import example_timeline, paper_case, random_scenario
    from jaxplan.constellation import (
        Constellation,
        Fleet,
        LinkSchedule,
        link_schedule,
        link_switch,
        load_fleet,
        plan_constellation,
        plan_fleet,
        walker,
    )
    from jaxplan.derivatives import follow, hold, replan
    from jaxplan.exporting import export
    from jaxplan.goal.pointing_start import point
    from jaxplan.gradients import differentiable
    from jaxplan.model.activities import Activity, Segment, Timeline
    from jaxplan.model.devices import Drive, Instrument, Mount, Terminal
    from jaxplan.model.directions import DirectionPath
    from jaxplan.model.export_names import ExportNames
    from jaxplan.model.goals import GivenState, Targets, Wish
    from jaxplan.model.hidden_spans import Hidden
    from jaxplan.model.robust import Robust
    from jaxplan.model.scenario import Scenario, SearchSettings, TrajectorySettings
    from jaxplan.model.spacecraft import Spacecraft
    from jaxplan.model.status import Status
    from jaxplan.model.wheels import Wheel
    from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut
    from jaxplan.planner import Plan, PlanFileError, PlanningError, certify, load_plan, plan, plan_batch
    from jaxplan.report import report_html
    from jaxplan.runtime.cache import compilation_cache
    from jaxplan.schema import (
        ScenarioError,
        load_observer,
        load_scenario,
        load_sky,
        load_timeline,
        save_scenario,
        save_timeline,
    )
    from jaxplan.slew_matrix import SlewTimes, load_slew_times, slew_times
    from jaxplan.study import Study, StudyFolderError, compare_studies, load_study, run_study
    from jaxplan.tables import AttitudeTable, TableCertificate, certify_table, load_attitude
    from jaxplan.timeline import TimelineError, TimelinePlan, load_timeline_plan, plan_timeline
    from jaxplan.trajectory import Trajectory, measures
    from jaxplan.tuning import SearchTuning, Sensitivities, Tuning, sensitivities, tune, tune_search
    from jaxplan.viewing import View, view
    from jaxplan.warming import warm_up

_HOMES = {
    "Activity": "jaxplan.model.activities",
    "AttitudeTable": "jaxplan.tables",
    "Constellation": "jaxplan.constellation",
    "DirectionPath": "jaxplan.model.directions",
    "Drive": "jaxplan.model.devices",
    "ExportNames": "jaxplan.model.export_names",
    "FixedVector": "jaxplan.model.zones",
    "Fleet": "jaxplan.constellation",
    "GivenState": "jaxplan.model.goals",
    "Hidden": "jaxplan.model.hidden_spans",
    "Instrument": "jaxplan.model.devices",
    "JointBound": "jaxplan.model.zones",
    "KeepIn": "jaxplan.model.zones",
    "KeepOut": "jaxplan.model.zones",
    "LinkSchedule": "jaxplan.constellation",
    "Mount": "jaxplan.model.devices",
    "Plan": "jaxplan.planner",
    "PlanFileError": "jaxplan.planner",
    "PlanningError": "jaxplan.planner",
    "Robust": "jaxplan.model.robust",
    "Scenario": "jaxplan.model.scenario",
    "ScenarioError": "jaxplan.schema",
    "SearchSettings": "jaxplan.model.scenario",
    "SearchTuning": "jaxplan.tuning",
    "Segment": "jaxplan.model.activities",
    "Sensitivities": "jaxplan.tuning",
    "SlewTimes": "jaxplan.slew_matrix",
    "Spacecraft": "jaxplan.model.spacecraft",
    "Status": "jaxplan.model.status",
    "Study": "jaxplan.study",
    "StudyFolderError": "jaxplan.study",
    "TableCertificate": "jaxplan.tables",
    "Targets": "jaxplan.model.goals",
    "Terminal": "jaxplan.model.devices",
    "Timeline": "jaxplan.model.activities",
    "TimelineError": "jaxplan.timeline",
    "TimelinePlan": "jaxplan.timeline",
    "Trajectory": "jaxplan.trajectory",
    "TrajectorySettings": "jaxplan.model.scenario",
    "Tuning": "jaxplan.tuning",
    "View": "jaxplan.viewing",
    "Wheel": "jaxplan.model.wheels",
    "Wish": "jaxplan.model.goals",
    "certify": "jaxplan.planner",
    "certify_table": "jaxplan.tables",
    "compare_studies": "jaxplan.study",
    "compilation_cache": "jaxplan.runtime.cache",
    "differentiable": "jaxplan.gradients",
    "example_timeline": "jaxplan.cases",
    "export": "jaxplan.exporting",
    "follow": "jaxplan.derivatives",
    "hold": "jaxplan.derivatives",
    "link_schedule": "jaxplan.constellation",
    "link_switch": "jaxplan.constellation",
    "load_attitude": "jaxplan.tables",
    "load_fleet": "jaxplan.constellation",
    "load_observer": "jaxplan.schema",
    "load_plan": "jaxplan.planner",
    "load_scenario": "jaxplan.schema",
    "load_sky": "jaxplan.schema",
    "load_slew_times": "jaxplan.slew_matrix",
    "load_study": "jaxplan.study",
    "load_timeline": "jaxplan.schema",
    "load_timeline_plan": "jaxplan.timeline",
    "paper_case": "jaxplan.cases",
    "plan": "jaxplan.planner",
    "plan_batch": "jaxplan.planner",
    "plan_constellation": "jaxplan.constellation",
    "plan_fleet": "jaxplan.constellation",
    "plan_timeline": "jaxplan.timeline",
    "point": "jaxplan.goal.pointing_start",
    "random_scenario": "jaxplan.cases",
    "replan": "jaxplan.derivatives",
    "report_html": "jaxplan.report",
    "run_study": "jaxplan.study",
    "save_scenario": "jaxplan.schema",
    "save_timeline": "jaxplan.schema",
    "sensitivities": "jaxplan.tuning",
    "slew_times": "jaxplan.slew_matrix",
    "tune": "jaxplan.tuning",
    "tune_search": "jaxplan.tuning",
    "view": "jaxplan.viewing",
    "walker": "jaxplan.constellation",
    "warm_up": "jaxplan.warming",
}

__all__ = [
    "Activity",
    "AttitudeTable",
    "Constellation",
    "DirectionPath",
    "Drive",
    "ExportNames",
    "FixedVector",
    "Fleet",
    "GivenState",
    "Hidden",
    "Instrument",
    "JointBound",
    "KeepIn",
    "KeepOut",
    "LinkSchedule",
    "Mount",
    "Plan",
    "PlanFileError",
    "PlanningError",
    "Robust",
    "Scenario",
    "ScenarioError",
    "SearchSettings",
    "SearchTuning",
    "Segment",
    "Sensitivities",
    "SlewTimes",
    "Spacecraft",
    "Status",
    "Study",
    "StudyFolderError",
    "TableCertificate",
    "Targets",
    "Terminal",
    "Timeline",
    "TimelineError",
    "TimelinePlan",
    "Trajectory",
    "TrajectorySettings",
    "Tuning",
    "View",
    "Wheel",
    "Wish",
    "certify",
    "certify_table",
    "compare_studies",
    "compilation_cache",
    "differentiable",
    "example_timeline",
    "export",
    "follow",
    "hold",
    "link_schedule",
    "link_switch",
    "load_attitude",
    "load_fleet",
    "load_observer",
    "load_plan",
    "load_scenario",
    "load_sky",
    "load_slew_times",
    "load_study",
    "load_timeline",
    "load_timeline_plan",
    "measures",
    "paper_case",
    "plan",
    "plan_batch",
    "plan_constellation",
    "plan_fleet",
    "plan_timeline",
    "plot",
    "point",
    "random_scenario",
    "replan",
    "report_html",
    "run_study",
    "save_scenario",
    "save_timeline",
    "sensitivities",
    "sky",
    "slew_times",
    "tune",
    "tune_search",
    "view",
    "walker",
    "warm_up",
]


__getattr__ = late(
    __name__,
    {
        **{name: f"{home}:{name}" for name, home in _HOMES.items()},
        "measures": "jaxplan.trajectory.measures",
        "plot": "jaxplan.plotting",
        "schema": "jaxplan.schema",
        "sky": "jaxplan.sky",
    },
)


def __dir__() -> list[str]:
    return sorted(__all__)

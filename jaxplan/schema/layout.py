"""The layout of a scenario file: its tables and keys with their units and ranges, in the order of writing.

With `states`, this is the one place that says what a file may hold. Ranges are in the file's units; defaults
are those of the classes in `model`, `spacecraft` and `zones`. Ranges that nature does not give are wider than
any spacecraft needs, and narrow enough that nothing computed from the numbers overflows.
"""

import math
from functools import partial
from typing import Any

from jaxplan.model import scenario as model
from jaxplan.model.scenario import Scenario, SearchSettings, TrajectorySettings
from jaxplan.model.spacecraft import Instrument, Spacecraft, Terminal
from jaxplan.model.zones import FixedVector, JointBound, KeepIn, KeepOut
from jaxplan.schema.arrays import Direction, Inertia, PerAxis
from jaxplan.schema.bodies import SKY, DeviceList, DeviceName, Epoch, TerminalFactors, View
from jaxplan.schema.kinds import Choice, Integer, Interval, Number, Text, YesNo
from jaxplan.schema.states import ANGLE_DEG, PITCH_LIMIT, SAMPLES, STATE, TIMES, YAW_LIMIT, Goal, split_zone
from jaxplan.schema.tables import Field, Rows, Table
from jaxplan.sky import BODIES

SCHEMA_VERSION = 1

_required = partial(Field, required=True)
_resolved = partial(Field, resolved=True)
_always = partial(Field, always=True)

_rate_limit = Number(Interval("[1e-6, 1e6]"), degrees=True)
_acceleration_limit = Number(Interval("[1e-9, 1e9]"), degrees=True)
_jerk_limit = Number(Interval("[1e-12, 1e12]"), degrees=True)
_half_angle = Number(Interval("(0, 180)"), degrees=True)
_exclusion = Number(Interval("[0, 180)"), degrees=True)
_step = Number(Interval("[1e-3, 3.14]"))  # a longer turn has a shorter way round
_inflation = Number(Interval("[1, 1e6]"))

TERMINAL = Table(
    Terminal,
    (
        _required("name", Text(), "name", "unique among the devices"),
        _required("mount_deg", ANGLE_DEG, "mount", "turn of the mounting about the body's z axis"),
        _required("yaw_limit_deg", YAW_LIMIT, "yaw_limit", "range of the yaw to either side"),
        _required("pitch_limit_deg", PITCH_LIMIT, "pitch_limit", "range of the pitch to either side"),
        _required("rate_limit_deg_s", _rate_limit, "rate_limit", "of each joint"),
        _required("acceleration_limit_deg_s2", _acceleration_limit, "acceleration_limit", "of each joint"),
    ),
)

INSTRUMENT = Table(
    Instrument,
    (
        _required("name", Text(), "name", "unique among the devices"),
        _required("boresight", Direction(), "boresight", "where it looks, body axes"),
    ),
)

SPACECRAFT = Table(
    Spacecraft,
    (
        _required("rate_limit_deg_s", _rate_limit, "rate_limit", "of the platform, per body axis"),
        _required("acceleration_limit_deg_s2", _acceleration_limit, "acceleration_limit", "likewise"),
        Field("jerk_limit_deg_s3", _jerk_limit, "jerk_limit", "likewise"),
        Field("inertia_kg_m2", Inertia(), "inertia", "in body axes"),
        Field("torque_limit_nm", PerAxis(), "torque_limit", "per body axis; needs the inertia"),
        Field("wheel_momentum_limit_nms", PerAxis(), "wheel_momentum_limit", "likewise"),
        Field("terminal", Rows(TERMINAL), "terminals", "devices with a yaw and a pitch joint"),
        Field("instrument", Rows(INSTRUMENT), "instruments", "devices fixed to the body"),
    ),
)

VECTOR = Table(
    FixedVector,
    (
        _required(
            "along",
            Direction(),
            "along",
            "in body axes; of a terminal along its boresight, to the left of it and upward",
        ),
        Field(
            "to", DeviceName(with_joints=True), "to", "whose moving part it is fixed to; the body if absent"
        ),
    ),
)

_NAME = _required("name", Text(), "name", "unique among the zones")
_BOUND = (
    Field("devices", DeviceList(), "devices", "which it binds; all if neither these nor vectors are given"),
    Field("vector", Rows(VECTOR), "vectors", "further directions that it binds"),
)
_GROUP = (
    Field("any_of", Text(), "any_of", "name of a group, of which one entry must hold at every instant"),
    Field("entry", Text(), "entry", "of its group; zones of the same one must hold together"),
)
_CONE = (
    _NAME,
    _required("direction", Direction(), "direction", "axis of the cone, inertial"),
    Field("axis_body", Direction(), "axis_body", "axis fixed in the body", instead_of="direction"),
    Field("axis_device", DeviceName(), "axis_device", "whose boresight is the axis", instead_of="direction"),
    _required("half_angle_deg", _half_angle, "half_angle", "from the axis to the edge"),
)

_MOVING = (
    _resolved("satellite", Text(), "direction", "the axis follows it; a name of [sky]"),
    SAMPLES,
    TIMES,
)

KEEP_OUT = Table(
    KeepOut,
    (
        *_CONE,
        _resolved("body", Choice(BODIES), "direction", "the axis points to it, as [sky] has it"),
        Field("exclusion_deg", _exclusion, "half_angle", "from the body's limb to the edge"),
        _resolved(
            "moving",
            YesNo(),
            "moving",
            "whether the axis follows the body; if false or absent, a wider zone stands still for as long",
        ),
        *_MOVING,
        *_BOUND,
        *_GROUP,
    ),
    split=split_zone,
)

KEEP_IN = Table(
    KeepIn,
    (
        *_CONE,
        *_MOVING,
        Field("devices", DeviceList(), "devices", "which it binds, each by itself; these or vectors"),
        *_BOUND[1:],
        *_GROUP,
    ),
    split=split_zone,
)

JOINT_BOUND = Table(
    JointBound,
    (
        _NAME,
        _required("device", DeviceName(with_joints=True), "device", "whose joints it bounds"),
        _required("normal", Direction(2), "normal", "weights of yaw and pitch"),
        _required(
            "least_deg", Number(Interval("[-1000, 1000]"), degrees=True), "least", "of the weighted sum"
        ),
        *_GROUP,
    ),
)

SEARCH = Table(
    SearchSettings,
    (
        _always("method", Choice(model.SEARCH_METHODS), "method", "the planner"),
        Field(
            "attitude_step_rad",
            _step,
            "attitude_step",
            "turn of the platform in a step, delta_SO(3) of the paper",
        ),
        Field("joint_step_rad", _step, "joint_step", "change of a joint in a step, delta_h of the paper"),
        Field("terminal_step_scale", TerminalFactors(), "terminal_step_scale", "factors on the joint step"),
        Field("heuristic_weight", _inflation, "heuristic_weight", "w1 of the paper"),
        Field("anchor_weight", _inflation, "anchor_weight", "w2 of the paper"),
        Field("attitude_moves", Integer(Interval("[1, 256]")), "attitude_moves", "random turns an expansion"),
        Field(
            "clearance_deg",
            Number(Interval("[0, 90)"), degrees=True),
            "clearance",
            "wanted beyond zones, tapering to zero at both ends",
        ),
        Field(
            "max_expansions", Integer(Interval("[1, inf)")), "max_expansions", "a search gives up after them"
        ),
        Field(
            "time_limit_s",
            Number(Interval("(0, inf)"), words={"off": math.inf}),
            "time_limit",
            "what a plan may take, compiling aside",
        ),
        Field("max_goals", Integer(Interval("[1, 100]")), "max_goals", "goals of step 1 that may be tried"),
        Field("improvements", Integer(Interval("[0, 10000]")), "improvements", "searches for shorter paths"),
        Field("seed", Integer(Interval("[0, inf)")), "seed", "of every random choice"),
    ),
)

_DURATION = Number(Interval("[1e-3, 1e7]"), words={"stretched": model.STRETCHED, "minimum": model.MINIMUM})
_TUBE = Number(Interval("[0, 180]"), degrees=True, words={"inf": math.inf})

TRAJECTORY = Table(
    TrajectorySettings,
    (
        _always("method", Choice(model.TRAJECTORY_METHODS), "method", "the method"),
        Field("duration_s", _DURATION, "duration", "or as short as scaling the time, or any motion, allows"),
        Field(
            "segments",
            Integer(Interval("[1, 1000]")),
            "segments",
            "of paper, at least; if absent as few as the path allows",
        ),
        # Position, rate and acceleration at both ends take six coefficients; beyond degree 24 rounding shows.
        Field("order", Integer(Interval("[5, 24]")), "order", "of paper, degree of the polynomials"),
        Field("rate_weight", Number(Interval("[0, 1e6]")), "rate_weight", "lambda_1 of the paper"),
        Field(
            "acceleration_weight",
            Number(Interval("[1e-6, 1e6]")),
            "acceleration_weight",
            "lambda_2 of the paper",
        ),
        Field("jerk_weight", Number(Interval("[0, 1e6]")), "jerk_weight", "of global"),
        Field(
            "node_tube_deg",
            _TUBE,
            "node_tube",
            'of global, how far off a node may be passed; if absent 1, and for "minimum" inf',
        ),
        Field(
            "end_acceleration",
            Choice(model.END_ACCELERATIONS),
            "end_acceleration",
            "of global, at start and goal",
        ),
        Field(
            "optimal",
            YesNo(),
            "optimal",
            "of global, whether a fit goes on to the optimum, whose derivatives are known",
        ),
    ),
)


def _make_scenario(*, schema_version: int, sky: View | None = None, **parts: Any) -> Scenario:
    """The scenario; what the sky was asked for is in its zones and targets, and its epoch is kept."""
    return Scenario(**parts) if sky is None else Scenario(**{**parts, "epoch": sky.epoch})


def _split_scenario(scenario: Scenario) -> dict[str, Any]:
    return {"schema_version": SCHEMA_VERSION, **vars(scenario)}


SCENARIO = Table(
    Scenario,
    (
        _required("schema_version", Choice((SCHEMA_VERSION,)), "schema_version", "of this layout"),
        _required("name", Text(), "name", "for titles and tables"),
        Field(
            "epoch_utc", Epoch(), "epoch", "UTC of the start, for exports; that of [sky] where there is one"
        ),
        _required("spacecraft", SPACECRAFT, "spacecraft", "platform, terminals and instruments"),
        _required("start", STATE, "start", "the state the manoeuvre starts from"),
        _required("goal", Goal(), "goal", "directions to point at, or a given state"),
        _resolved(
            "sky", SKY, "sky", "whence and when bodies and satellites are seen; resolved, never written"
        ),
        Field("keep_out", Rows(KEEP_OUT), "keep_out", "cones to stay out of"),
        Field("keep_in", Rows(KEEP_IN), "keep_in", "cones to stay in"),
        Field("joint_bound", Rows(JOINT_BOUND), "joint_bounds", "half-planes of yaw and pitch to stay in"),
        _always("search", SEARCH, "search", "settings of step 2"),
        _always("trajectory", TRAJECTORY, "trajectory", "settings of step 3"),
    ),
    make=_make_scenario,
    split=_split_scenario,
)

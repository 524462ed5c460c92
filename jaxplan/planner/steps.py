"""What step 3 is asked for a scenario, and a plan with the trajectory and the certificate that it gets."""

from dataclasses import replace

from jaxplan.certificate import Certificate
from jaxplan.model.path import Goal, Path
from jaxplan.model.scenario import Scenario
from jaxplan.model.status import Status
from jaxplan.planner import messages
from jaxplan.planner.record import Plan, end_rates
from jaxplan.trajectory import Fit, FitQuery, fit_batch


def wanted_fit(scenario: Scenario, path: Path, goal: Goal) -> FitQuery:
    """Step 3 of a scenario along a path to a goal, by the method it asks for."""
    start, end = scenario.start, end_rates(scenario, goal)
    return FitQuery(
        path=path,
        spacecraft=scenario.spacecraft,
        settings=scenario.trajectory,
        cones=scenario.constraints,
        start_angular_velocity=start.angular_velocity,
        start_joint_rates=start.joint_rates,
        end_angular_velocity=end[0],
        end_joint_rates=end[1],
        horizon=goal.time,
    )


def fit(scenario: Scenario, path: Path, goal: Goal) -> Fit:
    """The trajectory of a scenario along a path to a goal, fitted by itself."""
    return fit_batch([wanted_fit(scenario, path, goal)])[0]


def fitted_plan(so_far: Plan, fitted: Fit) -> Plan:
    """The plan with what step 3 found, if anything, not yet certified."""
    message = fitted.note if fitted.status is Status.OK else fitted.message
    return replace(so_far, status=fitted.status, message=message, trajectory=fitted.trajectory)


def judged(so_far: Plan, certificate: Certificate) -> Plan:
    """The plan with a certificate on its trajectory, certified or not."""
    so_far = replace(so_far, certificate=certificate)
    if so_far.status in (Status.OK, Status.UNCERTIFIED) and not certificate.certified:
        return replace(so_far, status=Status.UNCERTIFIED, message=messages.uncertified(certificate))
    return so_far

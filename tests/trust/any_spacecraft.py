"""Random spacecraft: what is certified keeps all that is stated, and what fails says why.

A plan is looked at by scipy and numpy alone (`dense`, `reference`): every pair, mask and limit on a grid that
no part of the package has seen. Its scenario and its file are read back and written again.
"""

from dataclasses import replace

import numpy as np
from dense import breaches
from reference import least_margin

import jaxplan as jp
from jaxplan.model.scenario import MINIMUM, Scenario
from jaxplan.schema import dump_scenario, parse_scenario
from trust.long_run import kept_in_a_file

ROUNDING = 1e-9  # rad, the certificate's


def scene(seed: int) -> Scenario:
    """Every other one is to be flown as fast as may be."""
    found = jp.random_scenario(seed, "any_spacecraft")
    return replace(found, trajectory=replace(found.trajectory, duration=MINIMUM)) if seed % 2 else found


def examine(plan: jp.Plan) -> None:
    """Raise if a certified plan breaks something, or another does not name what is in its way."""
    if plan.ok:
        assert breaches(plan) == [], plan.scenario.name
        margin = plan.certificate.min_margin
        assert margin is None or least_margin(plan.scenario, plan.trajectory) >= margin - ROUNDING
    else:
        assert plan.status in (jp.Status.NO_PATH, jp.Status.NODE_LIMIT), plan.message
        names = {zone.any_of or zone.name for zone in plan.scenario.zones}
        assert any(name in plan.message for name in names), plan.message


def attempt(seed: int) -> str:
    """The status of one spacecraft's plan, which is as it should be."""
    scenario = scene(seed)
    assert parse_scenario(dump_scenario(scenario)) == scenario
    plan = jp.plan(scenario, throw=False, progress=False)
    examine(plan)
    kept_in_a_file(plan)
    if plan.ok:  # a certificate made anew is the same to rounding
        again = jp.certify(plan)
        assert again.certified
        kept = (plan.certificate.min_margin, again.min_margin)
        assert kept[0] is None or abs(np.subtract(*kept)) <= ROUNDING
    return plan.status.name

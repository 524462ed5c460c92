"""Random scenes of every kind of constraint, from file to figure: planned, sampled, kept and drawn."""

from dataclasses import replace

import jax
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.contour import ContourSet
from matplotlib.legend import Legend
from reference import least_margin, stated_margins

import jaxplan as jp
from jaxplan.cases import RANDOM_KINDS, SKY_KINDS
from jaxplan.model.scenario import MINIMUM
from jaxplan.planner.proving import check_margins
from jaxplan.plotting import margin_panels, style

pytestmark = pytest.mark.slow
NEW_KINDS = [kind for kind in RANDOM_KINDS if kind not in SKY_KINDS]
ROUNDING = 1e-9  # rad, the certificate's


def scene(kind, seed):
    """Those of odd seeds are to be flown as fast as may be."""
    found = jp.random_scenario(seed, kind)
    return replace(found, trajectory=replace(found.trajectory, duration=MINIMUM)) if seed % 2 else found


@pytest.fixture(scope="module")
def plans():
    """One of each kind, every other one as fast as may be."""
    scenes = [scene(kind, 3 - number % 2) for number, kind in enumerate(NEW_KINDS)]
    return jp.plan_batch(scenes, progress=False)


@pytest.fixture(scope="module")
def mixed(plans):
    return next(plan for plan in plans if plan.scenario.name == "mixed 3")


def test_every_scene_is_planned_and_no_sample_is_below_what_is_proved(plans):
    for plan in plans:
        assert plan.ok, f"{plan.scenario.name}: {plan.message}"
        least = least_margin(plan.scenario, plan.trajectory)
        assert least >= plan.certificate.min_margin >= -ROUNDING
        assert least <= plan.certificate.min_margin + np.deg2rad(0.05)


def test_each_constraint_by_itself_is_proved_below_its_samples(plans):
    for plan in plans:
        time = np.linspace(0, plan.trajectory.duration, 5003)
        sampled = {
            name: np.min(own) for name, own in stated_margins(plan.scenario, plan.trajectory, time).items()
        }
        proved = {}
        for margin in check_margins(plan):
            proved[margin.zone] = min(margin.bound, proved.get(margin.zone, np.inf))
        for name, bound in proved.items():
            group = next((zone.any_of for zone in plan.scenario.zones if zone.name == name), None) or name
            assert bound <= sampled[group] + ROUNDING, (plan.scenario.name, name)


def test_scenarios_and_plans_survive_their_files(plans, tmp_path):
    for plan in plans:
        jp.save_scenario(plan.scenario, tmp_path / "scene.toml")
        assert jp.load_scenario(tmp_path / "scene.toml") == plan.scenario
        plan.save(tmp_path / "plan.json")
        again = jp.load_plan(tmp_path / "plan.json")
        assert again.scenario == plan.scenario
        assert again.status is plan.status
        assert again.certificate.min_margin == plan.certificate.min_margin
        for one, other in zip(*(jax.tree.leaves(p.trajectory) for p in (plan, again)), strict=True):
            np.testing.assert_array_equal(one, other)
        assert jp.certify(again).certified


def test_the_sky_shows_what_has_a_place_on_it_and_margins_show_all(plans):
    for plan in plans:
        names = {zone.name for zone in plan.scenario.zones if zone.is_inertial}
        others = {zone.name for zone in plan.scenario.zones} - names
        axes = jp.plot.sphere(plan)
        written = "\n".join(text.get_text() for text in axes.texts)
        assert all(name in written for name in names)
        assert not any(name in written for name in others)
        axes = jp.plot.margins(plan)
        assert all(len(line.get_ydata()) > 0 for line in axes.lines)
        plt.close("all")


def test_margins_are_among_the_figures_of_every_kind_and_name_all_that_is_ever_bound(plans):
    for plan in plans:
        figures = dict(jp.plot.figures(plan))
        bound = {
            margin.device for margin in margin_panels.margins_over_time(plan.scenario, style.motion(plan))
        }
        names = plan.scenario.sight_names
        for name in ("margins", "overview"):
            legends = figures[name].findobj(Legend)
            # long names are broken
            told = {" ".join(text.get_text().split()) for legend in legends for text in legend.get_texts()}
            assert {names[number] for number in bound} <= told


def test_a_zone_for_vectors_alone_is_not_hatched_and_says_whose(mixed):
    axes = jp.plot.sphere(mixed)
    written = [text.get_text() for text in axes.texts]
    assert "tracker-1\nfor a vector\nof the body" in written
    assert "shade-2\nfor a vector\nof terminal-2" in written
    hatched = sum(any(area.hatches) for area in axes.findobj(ContourSet))
    assert hatched == 3  # sky-1, sky-2 and aside-3
    plt.close("all")


def test_a_report_names_every_constraint(mixed, tmp_path):
    file = tmp_path / "report.html"
    jp.report_html(mixed, file)
    text = file.read_text()
    for zone in mixed.scenario.zones:
        assert zone.name in text

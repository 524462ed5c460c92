"""Fleets: every link followed, all files the same whoever plans and however often it is killed."""

import json
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import fake_fleet
import numpy as np
import pytest
from fake_fleet import DEADLY, SHELL, die_at_one, files, plan_nothing, schedule
from reference import assert_each, boresights, unit

import jaxplan as jp
from jaxplan import sky
from jaxplan.constellation import fleet
from jaxplan.constellation.orders import order_of, plan_order

EPOCH = "2026-06-20T09:30:00"


@pytest.fixture
def quick(monkeypatch):
    """Satellites that take no planning."""
    monkeypatch.setattr(fleet, "plan_order", plan_nothing)


def never(order):
    pytest.fail(f"planned satellite {order.satellite} again")


def planned(folder, **options):
    return jp.plan_fleet(schedule(), folder, progress=False, **options)


# folders


def test_a_fleet_is_read_back_from_its_folder(quick, tmp_path):
    result = planned(tmp_path / "a" / "fleet")
    again = jp.load_fleet(tmp_path / "a" / "fleet")
    assert again.table == result.table
    assert again.title == result.title
    assert result.complete
    assert result.failures == {"GOAL_UNREACHABLE": 20}
    assert result.certified == 40
    assert [row["satellite"] for row in result.timings] == list(range(60))
    lines = (result.folder / "table.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == result.table
    assert "GOAL_UNREACHABLE" in str(result)
    assert "<table>" in result._repr_html_()


def test_what_is_done_is_not_planned_again_and_more_may_be_asked_for(quick, tmp_path, monkeypatch):
    some = planned(tmp_path / "a", satellites=[3, 50])
    assert [row["satellite"] for row in some.table] == [3, 50]
    planned(tmp_path / "a")
    whole = planned(tmp_path / "b")
    assert files(tmp_path / "a") == files(tmp_path / "b")
    monkeypatch.setattr(fleet, "plan_order", never)
    assert planned(tmp_path / "a").table == whole.table
    assert planned(tmp_path / "a", satellites=[3]).done == 1


@pytest.mark.slow
def test_a_killed_fleet_goes_on_to_the_same_files(quick, tmp_path):
    chance = random.Random(1)
    command = [sys.executable, fake_fleet.__file__, str(tmp_path / "a"), "0.03"]
    plans = tmp_path / "a" / "rows"
    killed = 0
    for _ in range(3):
        before = len(list(plans.glob("*.json"))) if plans.exists() else 0
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        while (len(list(plans.glob("*.json"))) if plans.exists() else 0) <= before and process.poll() is None:
            time.sleep(0.002)
        time.sleep(chance.uniform(0, 0.2))
        process.send_signal(signal.SIGKILL)
        killed += process.wait() == -signal.SIGKILL
    assert killed == 3
    assert 0 < jp.load_fleet(tmp_path / "a").done < 60
    (tmp_path / "a" / "plans" / "07.npz.part").write_bytes(b"half")
    planned(tmp_path / "a")
    planned(tmp_path / "b")
    assert files(tmp_path / "a") == files(tmp_path / "b")


@pytest.mark.parametrize(
    ("file", "damage"),
    [
        ("plans/11.npz", b""),
        ("plans/11.npz", b"PK\x03\x04 no plan"),
        ("rows/11.json", b""),
        ("rows/11.json", b'{"satellite": 11}'),
        ("rows/11.json", b"[" * 100_000),
    ],
)
def test_a_damaged_plan_or_row_is_made_again(quick, tmp_path, file, damage):
    planned(tmp_path)
    good = files(tmp_path)
    (tmp_path / file).write_bytes(damage)
    with pytest.raises(jp.PlanFileError, match=r"11\.npz: not a plan of a timeline"):
        jp.load_fleet(tmp_path).load(11)
    assert jp.load_fleet(tmp_path).done == 59
    planned(tmp_path)
    assert files(tmp_path) == good


def test_a_torn_plan_is_made_again(quick, tmp_path):
    planned(tmp_path)
    good = files(tmp_path)
    path = tmp_path / "plans" / "11.npz"
    path.write_bytes(path.read_bytes()[:-30])
    (tmp_path / "timings.jsonl").write_text('{"satellite": 3, "total_s"')
    assert jp.load_fleet(tmp_path).timings == []
    planned(tmp_path)
    assert files(tmp_path) == good


def test_another_fleet_in_the_folder_is_refused_by_what_differs(quick, tmp_path):
    planned(tmp_path, satellites=[0])
    others = {
        "tolerance_rad": lambda: planned(tmp_path, tolerance=0.001),
        "slew": lambda: planned(tmp_path, slew="calm"),
        "settings": lambda: planned(tmp_path, settings={"search.max_expansions": 500}),
        "links": lambda: jp.plan_fleet(schedule(step_s=200.0), tmp_path, progress=False),
        "cones_rad": lambda: jp.plan_fleet(schedule(moon_half_angle=0.01), tmp_path, progress=False),
        "epoch": lambda: jp.plan_fleet(schedule(epoch="2026-06-21"), tmp_path, progress=False),
    }
    for key, call in others.items():
        with pytest.raises(jp.StudyFolderError, match=rf"holds another fleet \(.*{key} .* there, .* here"):
            call()


def test_folders_of_other_things_are_refused(quick, tmp_path):
    (tmp_path / "thesis.tex").write_text("hello")
    with pytest.raises(jp.StudyFolderError, match=r"holds thesis\.tex, but no fleet"):
        planned(tmp_path)
    with pytest.raises(jp.StudyFolderError, match="cannot be a folder"):
        planned(tmp_path / "thesis.tex")
    with pytest.raises(jp.StudyFolderError, match="holds no fleet"):
        jp.load_fleet(tmp_path)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "fleet.json").write_text("{}")
    with pytest.raises(jp.StudyFolderError, match="not the head of a fleet"):
        jp.load_fleet(tmp_path / "b")
    planned(tmp_path / "c", satellites=[1])
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "fleet.json").write_bytes((tmp_path / "c" / "fleet.json").read_bytes())
    (tmp_path / "d" / "plans").symlink_to(tmp_path / "b")
    with pytest.raises(jp.StudyFolderError, match="is a link, which fleets do not follow"):
        planned(tmp_path / "d")


def test_a_folder_in_use_is_refused(quick, tmp_path, monkeypatch):
    def inside(order):
        with pytest.raises(jp.StudyFolderError, match="another process is working on this fleet"):
            planned(tmp_path)
        return plan_nothing(order)

    monkeypatch.setattr(fleet, "plan_order", inside)
    assert planned(tmp_path, satellites=[4]).done == 1


# who plans


def test_threads_give_the_same_files(quick, tmp_path):
    planned(tmp_path / "a")
    with ThreadPoolExecutor(3) as pool:
        planned(tmp_path / "b", workers=pool)
    assert files(tmp_path / "a") == files(tmp_path / "b")


@pytest.mark.slow
def test_processes_give_the_same_files(quick, tmp_path):
    planned(tmp_path / "a")
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        planned(tmp_path / "b", workers=pool)
    assert files(tmp_path / "a") == files(tmp_path / "b")


@pytest.mark.slow
def test_a_satellite_that_kills_its_worker_is_named_and_the_others_are_planned(tmp_path, monkeypatch):
    monkeypatch.setattr(fleet, "plan_order", die_at_one)
    result = planned(tmp_path, satellites=range(8), workers=2)
    assert result.done == 8
    assert result.table[DEADLY]["status"] == "crashed"
    assert "its worker died, 2 times" in result.table[DEADLY]["message"]
    assert result.failures == {"GOAL_UNREACHABLE": 3, "crashed": 1}
    with pytest.raises(ValueError, match=r"satellite = 5: is not planned, planned are 0, 1, 2, 3, 4, 6, 7$"):
        result.load(DEADLY)


def test_ctrl_c_returns_what_is_done(tmp_path, monkeypatch):
    def interrupted(order):
        if order.satellite == 4:
            raise KeyboardInterrupt
        return plan_nothing(order)

    monkeypatch.setattr(fleet, "plan_order", interrupted)
    result = planned(tmp_path)
    assert [row["satellite"] for row in result.table] == [0, 1, 2, 3]
    assert not result.complete
    assert "4 done of 60" in str(result)


def test_an_error_while_a_satellite_is_planned_is_its_row(monkeypatch):
    order = order_of(schedule(), 3, tolerance=1e-4, slew="shortest", settings={})
    monkeypatch.setattr("jaxplan.constellation.orders.plan_timeline", lambda *_, **__: 1 / 0)
    answer = plan_order(order)
    assert answer.row["status"] == "crashed"
    assert "ZeroDivisionError" in answer.row["message"]


def test_another_version_is_refused():
    order = order_of(schedule(), 3, tolerance=1e-4, slew="shortest", settings={})
    object.__setattr__(order, "version", "0.0")
    with pytest.raises(RuntimeError, match=r"planned by 0\.0: install the same"):
        plan_order(order)


# what is wrong is named


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"tolerance": 0.0}, jp.ScenarioError, "tolerance = 0.0"),
        ({"tolerance": np.nan}, jp.ScenarioError, "tolerance = nan"),
        ({"slew": "fast"}, jp.ScenarioError, "slew = 'fast': must be 'shortest' or 'calm'"),
        ({"satellites": [60]}, jp.ScenarioError, r"satellites\[0\] = 60"),
        ({"satellites": []}, jp.ScenarioError, "empty"),
        ({"settings": {"goal.targets": 1}}, jp.ScenarioError, "goal.targets: no setting"),
        ({"settings": 3}, TypeError, "settings must be a dict"),
        ({"workers": 0}, ValueError, "workers = 0"),
        ({"workers": "dask"}, TypeError, "get_executor"),
    ],
)
def test_wrong_arguments_are_refused_by_name(tmp_path, options, error, words):
    with pytest.raises(error, match=words):
        planned(tmp_path / "fleet", **options)
    assert not (tmp_path / "fleet").exists()


def test_what_is_no_schedule_folder_or_satellite_is_refused(quick, tmp_path):
    with pytest.raises(TypeError, match=r"jp\.link_schedule"):
        jp.plan_fleet(SHELL, tmp_path)
    with pytest.raises(TypeError, match="folder must be a path"):
        jp.plan_fleet(schedule(), 3)
    result = planned(tmp_path, satellites=[0])
    for number in (60, -1, 1.0, True):
        with pytest.raises(ValueError, match=r"satellite = .* must be an integer in"):
            result.load(number)


# real ones


FEW = (0, 13, 26)


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """Three satellites over ten minutes, with some changes of their links."""
    chosen = jp.walker("53:240/12/5", 1200.0)
    links = jp.link_schedule(chosen, epoch=EPOCH, duration_s=600.0, step_s=200.0)
    folder = tmp_path_factory.mktemp("real")
    return links, jp.plan_fleet(links, folder / "fleet", satellites=FEW, progress=False)


@pytest.mark.slow
def test_satellites_follow_their_links_but_for_slews_and_keep_out_of_sun_and_earth(real):
    links, result = real
    assert result.certified == len(FEW), result.table
    shell, craft = links.shell, links.spacecraft
    for number in FEW:
        plan = result.load(number)
        assert plan.trajectory.duration == pytest.approx(600.0)
        assert plan.ok
        assert plan.certify().certified
        for span, activity in zip(links.spans(number), plan.activities, strict=True):
            assert span.start < activity.start < activity.end == pytest.approx(span.end)
            for when in np.linspace(activity.start, activity.end, 5):
                at = plan.trajectory.sample(min(when, plan.trajectory.duration))
                seen = boresights(craft, at.attitude, at.joints)
                place = shell.positions(float(when))
                for terminal, other in enumerate(span.links):
                    if other >= 0:
                        way = unit(place[other] - place[number])
                        assert np.linalg.norm(seen[terminal] - way) < np.deg2rad(0.01)
        for when in np.linspace(0, 600, 60):
            at = plan.trajectory.sample(float(when))
            seen, place = boresights(craft, at.attitude, at.joints), shell.positions(float(when))[number]
            sun = unit(sky.positions("sun", epoch=EPOCH, times=float(when)) - place)
            for body, half in ((sun, links.cones["sun"]), (-unit(place), links.cones["earth"])):
                assert_each(np.arccos(np.clip(seen @ body, -1, 1)), ">=", half)


@pytest.mark.slow
def test_rows_say_what_the_plans_are(real):
    links, result = real
    for row, number in zip(result.table, FEW, strict=True):
        plan, spans = result.load(number), links.spans(number)
        assert plan.status.name == row["status"]
        assert plan.certificate.min_margin == pytest.approx(np.deg2rad(row["min_margin_deg"]))
        assert row["activities"] == row["planned"] == len(spans)
        slews = [one.slew for one in plan.activities if one.slew]
        assert (row["slews"], row["slew_s"]) == (len(slews), pytest.approx(sum(slews)))
        assert row["longest_slew_s"] == max(slews)
        assert row["pointing_error_deg"] <= 0.01
        assert row["linked_s"] <= row["scheduled_s"]
        tracked = sum(one.end - one.start for one in plan.segments if one.kind != "slew")
        assert tracked + sum(slews) == pytest.approx(600.0)
        assert row["min_margin_deg"] > 0


@pytest.mark.slow
def test_real_fleets_are_the_same_bytes_by_two_processes_also_after_a_kill(real, tmp_path):
    links, result = real
    plan_some = jp.plan_fleet(links, tmp_path / "fleet", satellites=FEW[1:2], workers=1, progress=False)
    assert plan_some.done == 1
    jp.plan_fleet(links, tmp_path / "fleet", satellites=FEW[::-1], workers=2, progress=False)
    assert files(tmp_path / "fleet") == files(result.folder)


@pytest.mark.slow
def test_dask_workers_give_the_same_files(quick, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra dask")
    planned(tmp_path / "a")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run(sys.path.insert, 0, os.path.dirname(fake_fleet.__file__))
        planned(tmp_path / "b", workers=client.get_executor())
    assert files(tmp_path / "a") == files(tmp_path / "b")


@pytest.mark.slow
def test_what_cannot_be_done_is_named_and_the_rest_is_planned(tmp_path):
    chosen = jp.walker("53:240/12/5", 1200.0)
    mesh = jp.link_schedule(chosen, epoch=EPOCH, duration_s=600.0, step_s=200.0)
    both = np.array(mesh.topology)
    both[1, 0] = [both[1, 0, 0], both[1, 0, 0], -1, -1]  # the one ahead, also by the terminal at the back
    links = jp.link_schedule(chosen, epoch=EPOCH, duration_s=600.0, topology=(mesh.times, both))
    result = jp.plan_fleet(links, tmp_path, satellites=[0], progress=False)
    (row,) = result.table
    assert row["status"] == "GOAL_UNREACHABLE"
    assert "links from 200 s" in row["message"]
    assert row["planned"] == row["activities"] - 1
    assert row["certified"]

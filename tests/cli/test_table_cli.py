"""The command line on tables of attitudes: few rows exported, and tables checked."""

import json

import jaxplan as jp
from jaxplan.cli import main


def test_the_command_line_checks_a_table_and_tells_of_few_rows(tmp_path, capsys):
    scene, file, table = tmp_path / "scene.toml", tmp_path / "plan.json", tmp_path / "few.csv"
    own = jp.plan(jp.paper_case(4))
    own.save(file)
    jp.save_scenario(own.scenario, scene)
    assert main(["export", str(file), "--format", "csv", "--step", "sparsest", "-o", str(table)]) == 0
    assert " rows, " in capsys.readouterr().err
    assert main(["check", str(table), "--scenario", str(scene)]) == 0
    told = capsys.readouterr().out
    assert "smallest margin" in told
    assert "last row off the goal" in told
    assert main(["check", str(table), "--scenario", str(scene), "--interpolation", "hermite", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["interpolation"] == "hermite"
    assert found["rate_jump_deg_s"] == 0
    assert "angular_acceleration" in found["peaks"]
    day = tmp_path / "day.toml"  # of the same scene
    rest = (jp.Activity(name="rest", idle=True, duration=5.0),)
    moving = jp.Timeline(name="day", scene=own.scenario, activities=rest, until=60.0)
    jp.save_timeline(moving, day)
    assert main(["check", str(table), "--scenario", str(day), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["goal_off_deg"] is None
    for arguments, words in (
        ([str(table)], "--scenario"),
        ([str(file), "--interpolation", "slerp"], "takes --scenario, too"),
        ([str(tmp_path / "absent.csv"), "--scenario", str(scene)], "no such file"),
        ([str(table), "--scenario", str(scene), "--interpolation", "linear"], "must be one of slerp"),
        ([str(scene), "--scenario", str(scene)], "no attitude file"),
        ([str(file), "--scenario", str(scene)], "is a plan and no table"),
    ):
        assert main(["check", *arguments]) == 2
        assert words in capsys.readouterr().err

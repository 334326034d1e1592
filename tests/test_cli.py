"""The command line: exit codes, messages, and a whole run."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from robomirror_drake import cli
from robomirror_drake.commands import run
from robomirror_drake.exceptions import PlanningError, SimulationError


def robomirror(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["robomirror", *arguments])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    return int(stopped.value.code or 0)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        ("--version",),
        ("run", "--help"),
        ("motions",),
        ("bench", "--help"),
    ],
)
def test_help_and_listings_succeed(monkeypatch, capsys, arguments):
    assert robomirror(monkeypatch, *arguments) == 0
    assert capsys.readouterr().out


def test_motions_as_json_has_every_action(monkeypatch, capsys):
    assert robomirror(monkeypatch, "motions", "--json") == 0
    listing = json.loads(capsys.readouterr().out)
    names = {action["name"] for action in listing["actions"]}
    assert {"walk", "front_kick", "wave", "bow", "squat"} <= names
    assert {action["group"] for action in listing["actions"]} == {
        "locomotion",
        "dynamic",
        "expressive",
    }


def test_explanation_of_a_command(monkeypatch, capsys, tmp_path):
    text = "walks four steps while waving the left hand, then kicks twice"
    place = tmp_path / "clauses.json"
    assert robomirror(monkeypatch, "motions", "--explain", text, "--json", str(place)) == 0
    assert "front_kick" in capsys.readouterr().out
    walk, wave, kick = json.loads(place.read_text())["clauses"]
    assert (walk["action"], walk["count"], walk["relation"]) == ("walk", 4, "follows")
    assert (wave["action"], wave["side"], wave["relation"]) == ("wave", "left", "accompanies")
    assert (kick["action"], kick["group"], kick["count"]) == ("front_kick", "dynamic", 2)
    assert robomirror(monkeypatch, "motions", "--explain", "a person plays the violin") == 2
    assert "nearest" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", ""), "empty"),
        (("run", "the stock market fell"), "nearest"),
        (("run", "/nowhere/motion.bvh"), "motion.bvh"),
        (("run", "clip:moonwalk"), "moonwalk"),
        (("run", "bow", "--seed", "-3"), "seed"),
        (("run", "bow", "-n", "0"), "candidates"),
        (("run", "bow", "--scenario", "nonesuch"), "nonesuch"),
        (("retarget", "wave"), "no motion file"),
        (("play", "/nowhere"), "/nowhere is no result folder"),
        (("survey", "--actions", "fly"), "fly"),
        (("run", "stand for ten hours"), "durations"),
        (("run", "walk one million steps"), "million"),
        (("no-such-command",), "No such command"),
        (("run", "bow", "--out", ""), "no name of its own"),
        (("run", "bow", "--out", f"{__file__}/results"), "is no folder"),
        (("run", "bow", "--graphviz", f"{__file__}/d.dot"), "is no folder"),
        (("run", "bow", "--graphviz", str(Path(__file__).parent)), "is a folder"),
        (("retarget", "clip:walk", "--out", __file__), "is no folder"),
        (("survey", "--json", f"{__file__}/s.json"), "is no folder"),
        (("bench", "controller", "--json", f"{__file__}/b.json"), "is no folder"),
    ],
)
def test_bad_input_exits_2_with_a_reason_and_no_traceback(monkeypatch, capsys, arguments, message):
    assert robomirror(monkeypatch, *arguments) == 2
    printed = capsys.readouterr()
    assert message in " ".join((printed.err + printed.out).split())
    assert "Traceback" not in printed.err


def test_an_unplannable_motion_is_bad_input_and_divergence_an_error(monkeypatch, capsys):
    for error, code in ((PlanningError("too short", {}), 2), (SimulationError(0.1, "why"), 1)):

        def refuse(*_: object, error: Exception = error, **__: object) -> None:
            raise error

        monkeypatch.setattr(run, "scenario_of", refuse)
        assert robomirror(monkeypatch, "run", "bow") == code
        assert "Traceback" not in capsys.readouterr().err


def test_an_internal_error_exits_1(monkeypatch, capsys):
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(run, "scenario_of", broken)
    assert robomirror(monkeypatch, "run", "bow") == 1
    assert "internal error: on purpose" in capsys.readouterr().err


def test_graphviz_names_every_stage(monkeypatch, tmp_path):
    path = tmp_path / "diagram.dot"
    arguments = ("run", "bow", "--scenario", "default", "--graphviz", str(path))
    assert robomirror(monkeypatch, *arguments) == 0
    text = path.read_text()
    for stage in (
        "motion_generator",
        "retargeter",
        "reference_selector",
        "dynamic_planner",
        "whole_body_controller",
        "outcome_recorder",
        "plant",
    ):
        assert stage in text


@pytest.mark.slow
def test_a_whole_run_leaves_a_whole_result(monkeypatch, tmp_path, capsys):
    folder = tmp_path / "bow"
    settings = ("-n", "2", "--seed", "3", "--scenario", "default", "--out", str(folder))
    assert robomirror(monkeypatch, "run", "a person bows", *settings) == 0
    outcome = json.loads((folder / "outcome.json").read_text())
    assert outcome["fell"] is False
    assert outcome["seeds"] == {"generator": 3, "disturbance": 3}
    assert {f.name for f in folder.iterdir()} == {
        "outcome.json",
        "scenario.yaml",
        "candidates.parquet",
        "reference.parquet",
        "execution.parquet",
        "report.html",
        "playback.html",
    }
    assert str(folder) in capsys.readouterr().out.replace("\n", "")

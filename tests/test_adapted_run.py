"""What a result tells of an adaptation: on disk, in the report, in the playback, at the prompt."""

from __future__ import annotations

import dataclasses
import json
import re
import xml.etree.ElementTree as ElementTree
from importlib import resources

import numpy as np
import pytest
import yaml
from scipy.special import expit

from robomirror_drake.adaptation.motion_measures import compare, told
from robomirror_drake.adaptation.record import (
    AdaptationRecord,
    AdaptedRun,
    HandoverRecord,
    Original,
    RankedCandidate,
    Task,
)
from robomirror_drake.commands.run import adapting, default_scenario
from robomirror_drake.commands.terminal import print_outcome
from robomirror_drake.comparison import Judges, foresight
from robomirror_drake.config import Scenario, load_scenario
from robomirror_drake.differences import differences, physics_warnings
from robomirror_drake.exceptions import ConfigError, InputError, ResultError
from robomirror_drake.learning.train import physics_of
from robomirror_drake.messages import Execution, Foresight, QualityPrediction, RobotReference
from robomirror_drake.optimization.adaptation.explain import Active, Change, Explanation
from robomirror_drake.outcome import evaluate
from robomirror_drake.playback.overlay import WIDTH, render_overlay
from robomirror_drake.playback.playback import render_playback
from robomirror_drake.playback.scene import BELOW, FRAMES_PER_SECOND, build_scene
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.report.report import render_report
from robomirror_drake.report.robot_strips import strip
from robomirror_drake.results import Result, load_result, save_result
from robomirror_drake.robot import load_robot
from robomirror_drake.run import run, stages
from robomirror_drake.yaml_file import to_yaml, validate

ROBOT = load_robot()

EXPLANATION = Explanation(
    risk_before=0.8, risk_after=0.06, risk_limit=0.1, tempo=0.7, amplitude=0.9, stride=1.0,
    deviation=1.3,
    changes=(Change("height of the pelvis", -0.04, "m", 1.2), Change("WAIST_P", 0.3, "rad", 0.8)),
    active=(Active("risk of a fall", 0.4, None), Active("limit of L_KNEE", 0.1, 0.7)),
)  # fmt: skip


def candidate(number: int, place: int, fall: float) -> RankedCandidate:
    scores = (0.9, 0.7, 1.0 - fall, 0.4, 0.5, 1.0)
    return RankedCandidate(number, place, scores, 0.6, fall, fall < 0.1, f"reason <{number}>")


HANDOVERS = (
    HandoverRecord(0.4, 0.7, False, False, 0.3, 0.3, "nothing is better"),
    HandoverRecord(0.6, 0.9, True, True, 0.5, 0.02, "halt 1 from 0.90 s on"),
)

RECORD = AdaptationRecord(
    method="selection", weights="ppn_1s", how="selected", number=1, changed=True, risk_before=0.6,
    risk=0.05, allowed=0.1, reason="Candidate 1 is done & not 0.",
    candidates=(candidate(0, 2, 0.6), candidate(1, 1, 0.05)),
    tasks=(Task("sways that far", "rad", 0.4, 0.3, True, 0.2, done=False),), explanation=None,
    warnings=("learned elsewhere",),
)  # fmt: skip


def foreseen(last: float) -> Foresight:
    time = np.arange(0.0, last, 0.1)
    return Foresight(time, np.full(len(time), 0.05), np.linspace(0.0, 0.9, len(time)), 1.0)


@pytest.fixture
def fallen(make_execution) -> Execution:
    """An execution that sinks below the floor's limit after half a second."""
    q = make_execution().q.copy()
    q[30:, 6] = 0.1
    return make_execution(q=q, motion_end=0.9)


@pytest.fixture
def result(candidates, reference, noisy_execution, fallen) -> Result:
    outcome = evaluate(noisy_execution, ROBOT.effort_limits, 0.6)
    original = Original(
        reference, fallen, evaluate(fallen, ROBOT.effort_limits, 0.6), foreseen(1.0)
    )
    adapted = AdaptedRun(RECORD, reference, reference, foreseen(2.0), original)
    return Result(
        "sway", "", candidates, 1, reference, noisy_execution, outcome, adaptation=adapted
    )


def with_record(result: Result, **changes) -> Result:
    adapted = result.adaptation
    record = dataclasses.replace(adapted.record, **changes)
    return dataclasses.replace(result, adaptation=dataclasses.replace(adapted, record=record))


def without_original(result: Result, **changes) -> Result:
    made = with_record(result, not_compared="it was not asked for", **changes)
    adapted = dataclasses.replace(made.adaptation, original=None)
    return dataclasses.replace(made, adaptation=adapted)


# --- on disk


@pytest.mark.parametrize("original", [True, False])
@pytest.mark.parametrize("explanation", [None, EXPLANATION])
def test_an_adaptation_comes_back_as_it_was(result, tmp_path, original, explanation):
    made = with_record(result, explanation=explanation)
    made = made if original else without_original(made)
    loaded = load_result(save_result(tmp_path / "run", made))
    assert loaded == made
    assert (loaded.adaptation.original is not None) == original


def test_handovers_come_back_and_are_shown_everywhere(result, tmp_path, capsys):
    halted = with_record(result, handovers=HANDOVERS)
    folder = save_result(tmp_path / "run", halted)
    assert load_result(folder) == halted
    page = without_libraries(render_report(halted, ROBOT))
    for words in ("halt 1 from 0.90 s on", "nothing was handed over", "brought to a halt"):
        assert words in page
    over = render_overlay(halted)
    assert over.count('class="handover"') == 1
    assert f'x1="{WIDTH * 0.9 / halted.execution.time[-1]}"' in over
    marks = [b for b in build_scene(halted, ROBOT).bodies if b.path.startswith("handover")]
    (mark,) = marks
    assert int(np.flatnonzero(mark.position[:, 2] > BELOW)[0]) == round(0.9 * FRAMES_PER_SECOND)
    print_outcome(halted, folder)
    said = capsys.readouterr().out
    assert "at 0.6 s: halt 1 from 0.90 s on" in said
    assert "nothing is better" not in said
    assert "brought to a halt" in said


def test_a_closed_loop_has_settings_in_the_scenario_and_needs_a_method():
    closed = adapting(load_scenario("worn"), None, None, closed_loop=True)
    assert validate(Scenario, yaml.safe_load(to_yaml(closed)), "again") == closed
    with pytest.raises(ConfigError, match="closed_loop with method none"):
        adapting(load_scenario("default"), None, None, closed_loop=True)
    with pytest.raises(InputError, match="live"):
        run(closed, meshcat=object())  # type: ignore[arg-type]


def test_results_without_adaptation_still_load(result, tmp_path):
    plain = dataclasses.replace(result, adaptation=None)
    folder = save_result(tmp_path / "run", plain)
    assert not (folder / "adaptation.json").exists()
    assert load_result(folder).adaptation is None


@pytest.mark.parametrize(
    "name",
    ["own", "commanded", "foresight", "original_reference", "original_execution"],
)
def test_a_missing_file_of_an_adaptation_is_named(result, tmp_path, name):
    folder = save_result(tmp_path / "run", result)
    (folder / f"{name}.parquet").unlink()
    with pytest.raises(ResultError, match=name):
        load_result(folder)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"record": {}}', '{"record": 1, "original_outcome": 2}']
)
def test_a_damaged_adaptation_is_named(result, tmp_path, text):
    folder = save_result(tmp_path / "run", result)
    (folder / "adaptation.json").write_text(text)
    with pytest.raises(ResultError, match=r"adaptation\.json"):
        load_result(folder)


# --- what speaks against predictions


def learned_in(scenario: str) -> dict[str, object]:
    whole = load_scenario(scenario).model_dump(mode="json")
    return {"scenario": {name: whole[name] for name in ("robot", "planner", "simulation")}}


def test_weights_are_silent_in_the_physics_they_know():
    assert physics_warnings(learned_in("worn"), load_scenario("worn"), "w") == []
    longer = load_scenario("worn").model_dump() | {"seed": 5, "command": "bow"}
    longer["simulation"]["hold"] = 3.0
    assert (
        physics_warnings(learned_in("worn"), load_scenario("worn").model_validate(longer), "w")
        == []
    )


def test_other_physics_are_told_with_both_figures_and_a_way_out():
    learned, here = learned_in("worn"), load_scenario("default")
    strength = learned["scenario"]["simulation"]["disturbance"]["actuators"]["strength"][0]
    apart = differences(learned["scenario"], here)
    name = "simulation.disturbance.actuators.strength"
    assert f"{name} is 1, theirs {strength:g}" in apart
    (warning,) = physics_warnings(learned, here, "ppn_1s")
    assert "ppn_1s" in warning
    assert "--scenario worn" in warning


def test_settings_that_are_newer_than_the_weights_do_not_count():
    learned = learned_in("worn")["scenario"]
    del learned["simulation"]["interface"]
    assert differences(learned, load_scenario("worn")) == []


def test_weights_that_do_not_say_are_told():
    (warning,) = physics_warnings({}, load_scenario("worn"), "mine.safetensors")
    assert "mine.safetensors" in warning


def test_what_weights_say_is_read_from_the_data_set(tmp_path):
    scenario = load_scenario("worn").model_dump(mode="json")
    (tmp_path / "dataset.json").write_text(json.dumps({"scenario": scenario}))
    assert physics_warnings({"scenario": physics_of(tmp_path)}, load_scenario("worn"), "w") == []
    (tmp_path / "dataset.json").write_text("{}")
    assert physics_of(tmp_path) == {}


# --- what changed


def walking(stretch: float, share: float, seconds: float = 4.0) -> RobotReference:
    """The pelvis goes ahead at an even speed, the feet are set down in turns."""
    count = round(60 * seconds * stretch) + 1
    s = np.linspace(0.0, 1.0, count)
    q = np.tile(ROBOT.standing, (count, 1))
    q[:, 4] += 1.5 * share * s
    v = np.zeros((count, 29))
    v[:, 3] = 1.5 * share / (seconds * stretch)
    phase = (8.0 * s).astype(int)
    contact = np.ones((count, 2, 4), dtype=bool)
    contact[(phase % 4 == 1), 0] = False
    contact[(phase % 4 == 3), 1] = False
    return RobotReference(np.arange(count) / 60.0, q, v, np.zeros_like(v), contact)


def test_a_slower_shorter_walk_is_measured_as_that():
    made = {m.name: m for m in compare(ROBOT, walking(1.0, 1.0), walking(2.0, 0.5))}
    assert made["duration"].share == pytest.approx(2.0)
    assert made["time of a step"].share == pytest.approx(2.0, abs=0.02)
    assert made["way over the floor"].share == pytest.approx(0.5)
    assert made["top speed of the pelvis"].share == pytest.approx(0.25, abs=0.01)
    assert made["number of steps"].before == made["number of steps"].after == 4.0
    assert not made["number of steps"].different
    assert told(list(made.values())).startswith("top speed of the pelvis 0.375 → 0.0938 m/s")


def test_the_same_motion_has_no_changes():
    measures = compare(ROBOT, walking(1.0, 1.0), walking(1.0, 1.0))
    assert measures
    assert not any(m.different for m in measures)
    assert told(measures) == ""


# --- pictures


def test_a_strip_shows_where_the_robot_is_and_when_it_has_fallen(fallen):
    drawn = ElementTree.fromstring(strip(ROBOT, fallen.time, fallen.q, fallen.q_ref, 0.5, 5))
    kinds = [group.get("class") for group in drawn.iter("g")]
    assert kinds == ["meant", "done", "meant", "done", *["meant", "fallen"] * 3]
    meant, done = (
        np.array([float(c.get("cy")) for c in group.iter("circle")])
        for group in (list(drawn.iter("g"))[-2], list(drawn.iter("g"))[-1])
    )
    # 0.7 m lower at 72 px/m, and down is positive
    np.testing.assert_allclose(done - meant, 0.7 * 72.0, atol=0.2)
    labels = [text.text for text in drawn.iter("text")]
    assert labels == ["0.0 s", "0.2 s", "0.5 s", "0.8 s", "1.0 s"]


def without_libraries(html: str) -> str:
    return re.sub(r"<script>/\*.*?</script>", "", html, count=1, flags=re.DOTALL)


def test_the_report_tells_both_outcomes_and_the_ranking(result):
    html = render_report(result, ROBOT)
    page = without_libraries(html)
    assert not re.search(r"https?://|src\s*=|<link|@import|url\(", page)
    assert "As commanded:" in page
    assert "The robot fell after 0.50 s" in page
    assert "and did not fall." in page
    assert "Candidate 1 is done &amp; not 0." in page
    assert "learned elsewhere" in page
    assert page.index("reason &lt;1&gt;") < page.index("reason &lt;0&gt;")
    assert page.count('<svg class="strip"') == 2
    for plot in ("risk", "paths", "measures", "courses"):
        assert f'id="{plot}"' in page


def test_the_report_of_an_optimised_motion_says_what_moved_and_what_holds_it(result):
    page = without_libraries(render_report(with_record(result, explanation=EXPLANATION), ROBOT))
    for words in ("height of the pelvis", "-4.0", "+17", "limit of L_KNEE", "70 % of the tempo"):
        assert words in page


def test_the_report_without_the_original_says_why_there_is_none(result):
    page = without_libraries(render_report(without_original(result), ROBOT))
    assert "it was not asked for" in page
    assert "As commanded:" not in page
    assert page.count('<svg class="strip"') == 2


def test_the_report_of_a_kept_motion_shows_one(result):
    kept = without_original(result, how="kept", number=0, changed=False)
    page = without_libraries(render_report(kept, ROBOT))
    assert page.count('<svg class="strip"') == 1
    assert 'id="paths"' not in page
    assert 'id="risk"' in page


def test_the_playback_has_both_robots_and_marks_the_fall(result):
    scene = build_scene(result, ROBOT)
    bodies = {body.path: body for body in scene.bodies}
    assert {path.split("/")[0] for path in bodies} == {
        "human", "robot", "original", "original_fall", "robot_gauge", "robot_risk",
        "original_gauge", "original_risk",
    }  # fmt: skip
    assert len({len(body.position) for body in scene.bodies}) == 1
    height = bodies["original_fall"].position[:, 2]
    first = int(np.flatnonzero(height > BELOW)[0])
    assert first == round(result.adaptation.original.outcome.fall_time_s * FRAMES_PER_SECOND)
    ball = bodies["robot_risk"].position[:, 2]
    np.testing.assert_allclose(ball[30], np.interp(1.0, *foreseen_curve(result)), atol=1e-12)


def foreseen_curve(result: Result) -> tuple[np.ndarray, np.ndarray]:
    seen = result.adaptation.foresight
    return seen.time, seen.underway


def test_the_playback_page_has_the_risk_over_it(result):
    over = render_overlay(result)
    page = render_playback(result, ROBOT)
    assert over in page
    assert not re.search(r"https?://|src\s*=", over)
    assert "Candidate 1 is done &amp; not 0." in over
    assert f"fall at {0.5:.2f} s" in over
    cross = float(re.search(r'class="original" stroke-width="3" d="M([\d.]+) ', over)[1]) + 5.0
    assert cross == pytest.approx(WIDTH * 0.5 / result.execution.time[-1], abs=0.1)
    assert render_overlay(dataclasses.replace(result, adaptation=None)) == ""


def test_the_prompt_tells_what_was_changed_and_both_ends(result, tmp_path, capsys):
    print_outcome(result, tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    assert "warning: learned elsewhere" in said
    assert "Candidate 1 is done & not 0." in said
    assert "As commanded: The robot fell at 0.50 s" in said
    assert "As adapted: The robot stayed on its feet" in said
    assert "The task was not done: sways that far; it was 0.20 rad." in said


# --- foresight


@pytest.fixture(scope="module")
def predictor(make_predictor) -> Predictor:
    return make_predictor()


def test_who_does_what_he_is_told_looks_as_foreseen(predictor, make_execution):
    told = walking(0.5, 0.5)
    exact = make_execution(len(told.time), time=told.time, q=told.q, v=told.v)
    seen = foresight(Judges(predictor, predictor), told, exact)
    np.testing.assert_allclose(seen.time, np.arange(0.0, 2.0, 0.1), atol=1e-9)
    np.testing.assert_array_equal(seen.beforehand, seen.underway)
    assert seen.horizon == 0.5
    q = exact.q.copy()
    q[90:, 6] -= 0.2  # from 1.5 s on it is lower
    lower = foresight(Judges(predictor, predictor), told, dataclasses.replace(exact, q=q))
    np.testing.assert_array_equal(lower.beforehand, seen.beforehand)
    np.testing.assert_array_equal(lower.underway[:15], seen.underway[:15])
    assert (lower.underway[15:] != seen.underway[15:]).all()


# --- a run


def test_a_run_has_the_stages_that_it_needs():
    plain = load_scenario("default")
    adapted = adapting(plain, "selection", "mine.safetensors")
    assert adapted.adaptation.predictor == ("mine.safetensors",)
    assert stages(plain) == ("generate", "retarget", "plan", "simulate")
    assert stages(adapted)[2] == "adapt"
    assert stages(adapted)[-1] == "compare"
    assert stages(adapted, compare=False)[-1] == "simulate"


class Foreteller:
    """Foresees that the first of some motions falls, and that no other one does."""

    options = PPNOptions()
    header: dict[str, object] = {}  # noqa: RUF012

    def foresee(self, q: np.ndarray, *_: object, **__: object) -> QualityPrediction:
        logit = np.full(len(q), -5.0)
        logit[0] = 3.0
        return QualityPrediction(1.0, expit(logit), *np.full((5, len(q)), 0.01))

    def predict(self, references, _start, _history) -> QualityPrediction:
        return QualityPrediction(1.0, *np.full((6, len(references)), 0.25))


@pytest.mark.slow
def test_a_run_does_the_safe_candidate_and_compares(monkeypatch):
    for module in ("predictor", "ensemble"):
        place = f"robomirror_drake.ppn.{module}.load_predictor"
        monkeypatch.setattr(place, lambda *_: Foreteller())
    scenario = adapting(load_scenario("default"), "selection", "ppn_3s")
    made = run(
        scenario.model_copy(
            update={
                "command": "a person bows",
                "candidates": 2,
                "simulation": scenario.simulation.model_copy(update={"hold": 0.2}),
            }
        )
    )
    adapted = made.adaptation
    assert (adapted.record.how, adapted.record.number, made.chosen) == ("selected", 1, 1)
    assert adapted.record.risk_before > 0.9
    assert "andidate 1" in adapted.record.reason
    assert adapted.commanded.source == made.candidates[1].source
    assert adapted.original.reference.source == adapted.own.source == made.candidates[0].source
    assert not adapted.original.outcome.fell
    assert adapted.record.not_compared == ""
    assert all(task.met for task in adapted.record.tasks)
    assert adapted.record.done


def test_run_adapts_by_default_where_there_are_weights():
    assert default_scenario("mine.safetensors") == "worn"
    there = resources.files("robomirror_drake.assets") / "ppn" / "ppn_1s.safetensors"
    assert default_scenario(None) == ("worn" if there.is_file() else "default")
    assert load_scenario("worn").adaptation.method == "selection_optimisation"
    assert load_scenario("default").adaptation.method == "none"


def test_missing_weights_are_named(monkeypatch, capsys):
    from tests.test_cli import robomirror

    arguments = ("run", "bow", "--method", "selection", "--weights", "nonesuch")
    assert robomirror(monkeypatch, *arguments) == 2
    assert "nonesuch" in capsys.readouterr().err

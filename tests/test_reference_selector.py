from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from robomirror_drake.config import Scenario
from robomirror_drake.exceptions import PortError
from robomirror_drake.messages import DIMENSIONS, QualityPrediction, Ranking, RobotReference
from robomirror_drake.pipeline import build_plan_diagram, give_command
from robomirror_drake.robot import load_robot
from robomirror_drake.systems.motion_generator import MotionGenerator
from robomirror_drake.systems.reference_selector import ReferenceSelector
from robomirror_drake.systems.retargeter import Retargeter

ROBOT = load_robot()


def reference(source: str, squat: float = 0.0) -> RobotReference:
    """Three seconds of standing; ``squat`` lowers the pelvis by so much in the middle [m]."""
    q = np.tile(ROBOT.standing, (180, 1))
    q[:, 6] -= squat * np.sin(np.linspace(0.0, np.pi, 180)) ** 2
    zeros = np.zeros((180, 29))
    clean = {"self_penetration": 0.0, "penetration": 0.0, "keypoint_error": 0.01}
    contact = np.ones((180, 2, 4), dtype=bool)
    return RobotReference(
        np.arange(180) / 60, q, zeros, zeros, contact, source=source, residuals=clean
    )


def predict(*fall: float) -> QualityPrediction:
    return QualityPrediction(1.0, np.array(fall), *(np.full(len(fall), 0.01) for _ in range(5)))


def selector_with(**values: object) -> tuple[ReferenceSelector, Context]:
    selector = ReferenceSelector(ROBOT)
    context = selector.CreateDefaultContext()
    for port, value in values.items():
        selector.GetInputPort(port).FixValue(context, Value[object](value))
    return selector, context


def out(name: str, **values: object) -> Any:
    selector, context = selector_with(**values)
    return selector.GetOutputPort(name).Eval(context)


def test_without_predictions_it_takes_the_first_and_keeps_it_whole():
    first = reference("nominal")
    assert out("reference", references=(first, reference("other"))) == first
    assert out("reference", references=(first,), command="a person squats") == first
    with pytest.raises(PortError, match="predictions"):
        out("ranking", references=(first,))


@pytest.mark.parametrize("value", [(), None, ("walk",), [reference("list")]])
def test_refuses_what_is_not_a_tuple_of_references(value):
    with pytest.raises(PortError):
        out("reference", references=value)


def test_takes_the_safe_one_and_says_why():
    given = (reference("first"), reference("second"))
    values = {"references": given, "predictions": predict(0.7, 0.01)}
    assert out("reference", **values) == given[1]
    ranking = out("ranking", **values)
    assert isinstance(ranking, Ranking)
    assert list(ranking.order) == [1, 0]
    assert "70.0%" in ranking.reasons[0]


def test_among_the_safe_it_takes_the_one_that_does_what_was_said():
    given = (reference("squats", 0.3), reference("hardly", 0.05), reference("stands"))
    foreseen = predict(0.5, 0.05, 0.04)
    by_goal = out("ranking", references=given, predictions=foreseen, command="a person squats")
    goal = by_goal.scores[:, DIMENSIONS.index("goal")]
    assert goal[0] == 1.0
    assert goal[0] > goal[1] > goal[2] == 0.0
    assert by_goal.best == 1
    assert "task not done: squat: lowers the pelvis" in by_goal.reasons[1]
    assert out("ranking", references=given, predictions=foreseen).best == 2


def test_words_that_only_a_learned_generator_knows_prefer_nobody():
    given = (reference("a", 0.3), reference("b"))
    values = {"references": given, "predictions": predict(0.0, 0.0)}
    ranking = out("ranking", command="a person juggles flaming chainsaws", **values)
    np.testing.assert_array_equal(ranking.scores[:, DIMENSIONS.index("goal")], 1.0)


@pytest.mark.parametrize(
    ("port", "value"), [("predictions", 3), ("predictions", predict(0.1)), ("command", 5)]
)
def test_refuses_what_does_not_belong_on_a_port(port, value):
    given = (reference("a"), reference("b"))
    values = {"references": given, "predictions": predict(0.0, 0.0)} | {port: value}
    with pytest.raises(PortError, match=port):
        out("ranking", **values)


def test_a_new_prediction_changes_the_choice_and_nothing_is_judged_twice(monkeypatch):
    from robomirror_drake.systems import reference_selector as module

    judged = []
    measure = module.measure
    monkeypatch.setattr(module, "measure", lambda *a: judged.append(1) or measure(*a))
    given = (reference("a", 0.3), reference("b", 0.3))
    selector, context = selector_with(references=given, command="a person squats")
    for foreseen, best in ((predict(0.0, 0.5), 0), (predict(0.5, 0.0), 1)):
        selector.GetInputPort("predictions").FixValue(context, Value[object](foreseen))
        assert selector.GetOutputPort("reference").Eval(context) == given[best]
        assert selector.GetOutputPort("ranking").Eval(context).best == best
    assert len(judged) == len(given)


class Foreteller(LeafSystem):
    """Foresees falls from how low the pelvis goes: the lower, the likelier."""

    def __init__(self) -> None:
        super().__init__()
        self._references = self.DeclareAbstractInputPort("references", Value[object]())
        self.DeclareAbstractOutputPort(
            "predictions",
            Value[object],
            self._calc,
            prerequisites_of_calc={self._references.ticket()},
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        depth = [0.85 - r.q[:, 6].min() for r in self._references.Eval(context)]
        deepest, least = max(depth), min(depth)
        output.set_value(predict(*((d - least) / (deepest - least) for d in depth)))


def test_in_a_diagram_the_choice_follows_from_the_words():
    def diagram() -> Diagram:
        builder = DiagramBuilder()
        generator = builder.AddSystem(MotionGenerator(4, seed=2))
        retargeter = builder.AddSystem(Retargeter(ROBOT))
        foreteller = builder.AddSystem(Foreteller())
        selector = builder.AddSystem(ReferenceSelector(ROBOT))
        builder.ExportInput(generator.GetInputPort("command"), "command")
        builder.ConnectInput("command", selector.GetInputPort("command"))
        builder.Connect(generator.get_output_port(), retargeter.get_input_port())
        references = retargeter.GetOutputPort("references")
        builder.Connect(references, foreteller.get_input_port())
        builder.Connect(references, selector.GetInputPort("references"))
        builder.Connect(foreteller.get_output_port(), selector.GetInputPort("predictions"))
        builder.ExportOutput(references, "references")
        builder.ExportOutput(selector.GetOutputPort("ranking"), "ranking")
        builder.ExportOutput(selector.GetOutputPort("reference"), "reference")
        return builder.Build()

    made = diagram()
    rankings = []
    for command in ("a person squats", "a person squats three times"):
        context = made.CreateDefaultContext()
        give_command(made, context, command)
        given = made.GetOutputPort("references").Eval(context)
        ranking = made.GetOutputPort("ranking").Eval(context)
        depth = [-r.q[:, 6].min() for r in given]
        # The gentlest of the pool is the only one that is foreseen to stand.
        assert ranking.best == int(np.argmin(depth))
        assert made.GetOutputPort("reference").Eval(context) == given[ranking.best]
        assert ranking.safe.sum() >= 1
        rankings.append(ranking)
    assert rankings[0] != rankings[1]


def test_in_the_plan_diagram_the_nominal_motion_is_taken_as_long_as_nothing_is_foreseen():
    made = build_plan_diagram(ROBOT, Scenario.model_validate({"candidates": 2}))
    context = made.CreateDefaultContext()
    give_command(made, context, "a person waves")
    given = made.GetOutputPort("references").Eval(context)
    assert made.GetOutputPort("reference").Eval(context) == given[0]

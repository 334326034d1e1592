"""The system hands on what can be followed, reports the rest, and solves once."""

import dataclasses

import numpy as np
import pytest
from pydrake.common.value import Value

from robomirror_drake.exceptions import PortError, RetargetingError
from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retargeting import retarget as module
from robomirror_drake.optimization.retargeting.retarget import RetargetOptions
from robomirror_drake.robot import load_robot
from robomirror_drake.systems.retargeter import Retargeter


@pytest.fixture(scope="module")
def walk():
    motion = load_clip("walk")
    return dataclasses.replace(motion, positions=motion.positions[:16], text="walks")


@pytest.fixture
def impossible(walk):
    """The same walk with every joint thrown about: no robot can follow."""
    noise = np.random.default_rng(0).normal(scale=0.4, size=walk.positions.shape)
    return dataclasses.replace(walk, positions=walk.positions + noise)


@pytest.fixture
def retargeter():
    return Retargeter(load_robot())


def evaluated(system, value, port):
    context = system.CreateDefaultContext()
    system.GetInputPort("candidates").FixValue(context, Value[object](value))
    return system.GetOutputPort(port).Eval(context)


def test_passes_references_and_reports_failures(retargeter, walk, impossible):
    context = retargeter.CreateDefaultContext()
    retargeter.GetInputPort("candidates").FixValue(context, Value[object]((walk, impossible, walk)))
    references = retargeter.GetOutputPort("references").Eval(context)
    failures = retargeter.GetOutputPort("failures").Eval(context)
    assert [type(r) for r in references] == [RobotReference] * 2
    assert references[0].text == "walks"
    assert [type(f) for f in failures] == [RetargetingError]
    assert failures[0].exceeded
    assert failures[0].residuals[failures[0].exceeded[0]] > 0.0


def test_nothing_left_is_an_error_with_evidence(retargeter, impossible):
    with pytest.raises(RetargetingError, match="cannot be retargeted"):
        evaluated(retargeter, (impossible,), "references")


@pytest.mark.parametrize("value", [None, (), "walk", (1, 2)])
def test_wrong_values_are_named(retargeter, value):
    with pytest.raises(PortError, match="'candidates' carries"):
        evaluated(retargeter, value, "references")


def test_solves_once_for_both_ports_and_until_the_input_changes(retargeter, walk, monkeypatch):
    solves = []
    original = module.retarget_window
    monkeypatch.setattr(
        module, "retarget_window", lambda *a, **k: solves.append(1) or original(*a, **k)
    )
    context = retargeter.CreateDefaultContext()
    retargeter.GetInputPort("candidates").FixValue(context, Value[object]((walk,)))
    first = retargeter.GetOutputPort("references").Eval(context)
    context.SetTime(1.0)
    assert retargeter.GetOutputPort("references").Eval(context) is first
    assert retargeter.GetOutputPort("failures").Eval(context) == ()
    assert len(solves) == 1


def test_options_reach_the_solver(walk):
    strict = RetargetOptions(gate={"keypoint_error": 1e-6})
    with pytest.raises(RetargetingError, match="keypoint_error"):
        evaluated(Retargeter(load_robot(), strict), (walk,), "references")


def test_same_input_gives_the_same_bytes(walk):
    one, two = (evaluated(Retargeter(load_robot()), (walk, walk), "references") for _ in range(2))
    assert one == two
    assert np.all(np.isfinite(one[0].a))

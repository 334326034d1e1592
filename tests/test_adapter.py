"""The closed loop: when it acts, what it hands over, and that it can be replayed."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from scipy.special import expit

from robomirror_drake.adaptation.handover_options import AdapterOptions, Continuation
from robomirror_drake.closed_loop import rollout_adaptive
from robomirror_drake.exceptions import ConfigError, PortError
from robomirror_drake.messages import Handover, QualityPrediction, RobotReference
from robomirror_drake.optimization.planning.plan import plan_dynamics
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.robot import load_robot
from robomirror_drake.simulation import SimulationOptions
from robomirror_drake.systems import whole_body_controller
from robomirror_drake.systems.adapter import Adapter

ROBOT = load_robot()
ARM = 7 + ROBOT.joint_names.index("L_ELBOW_P")
OPTIONS = AdapterOptions(
    continuations=(Continuation(tempo=0.8), Continuation(tempo=0.5)), settling=0.3, braking=0.4
)


class Foreteller:
    """Foresees falls from how fast an arm will move: faster than ``limit`` is not safe [rad/s]."""

    options = PPNOptions(horizon=0.5, history=0.2)

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def foresee(self, q: Any, contact: Any, history: Any, ahead: float) -> QualityPrediction:
        assert q.shape[1] == contact.shape[1] == round((ahead + 0.5) * 20) + 1
        assert history.q.shape == (self.options.back, 30)
        later = np.abs(np.diff(q[:, 5:, ARM], axis=1)).max(axis=1) * 20.0
        fall = expit(np.log(1.0 / 9.0) + 20.0 * (later / self.limit - 1.0))
        return QualityPrediction(ahead + 0.5, fall, *np.full((5, len(q)), 0.01))


@lru_cache
def commanded() -> RobotReference:
    """Three seconds in which an elbow swings, ever faster."""
    time = np.arange(181) / 60.0
    s = time / 3.0
    phase = 2.0 * np.pi * 3.0 * s**2
    rate, bend = 2.0 * np.pi * 2.0 * s, 4.0 * np.pi / 3.0
    q = np.tile(ROBOT.standing, (181, 1))
    v, a = np.zeros((2, 181, 29))
    q[:, ARM] -= 0.3 * (1.0 - np.cos(phase))
    v[:, ARM - 1] = -0.3 * np.sin(phase) * rate
    a[:, ARM - 1] = -0.3 * (np.cos(phase) * rate**2 + np.sin(phase) * bend)
    clean = dict.fromkeys(
        ("self_penetration", "penetration", "keypoint_error", "stance_drift", "limit_violation"),
        0.0,
    )
    contact = np.ones((181, 2, 4), dtype=bool)
    return RobotReference(time, q, v, a, contact, text="juggles", residuals=clean)


@lru_cache
def plan() -> RobotReference:
    return plan_dynamics(ROBOT, commanded())


def adapter_with(limit: float, options: AdapterOptions = OPTIONS) -> tuple[Adapter, Context]:
    adapter = Adapter(ROBOT, Foreteller(limit), options)  # type: ignore[arg-type]
    context = adapter.CreateDefaultContext()
    given(adapter, context)
    return adapter, context


def given(adapter: Adapter, context: Context) -> None:
    adapter.GetInputPort("commanded").FixValue(context, Value[object](commanded()))
    adapter.GetInputPort("plan").FixValue(context, Value[object](plan()))
    standing = np.append(plan().q[0], plan().v[0])
    adapter.GetInputPort("state").FixValue(context, standing)


def out(adapter: Adapter, context: Context, port: str) -> Any:
    return adapter.GetOutputPort(port).Eval(context)


def run(limit: float, until: float, options: AdapterOptions = OPTIONS) -> tuple[Adapter, Context]:
    adapter, context = adapter_with(limit, options)
    Simulator(adapter, context).AdvanceTo(until)
    return adapter, context


def test_leaves_alone_what_is_safe() -> None:
    adapter, context = run(100.0, 3.0)
    assert out(adapter, context, "handovers") == ()
    assert out(adapter, context, "reference") is plan()
    time, risk = out(adapter, context, "risk")
    assert 1.5 < time < 3.0
    assert risk < 0.1


def test_hands_over_to_a_slower_rest_before_it_gets_dangerous() -> None:
    adapter, context = adapter_with(2.6)
    simulator = Simulator(adapter, context)
    while not out(adapter, context, "handovers"):
        simulator.AdvanceTo(context.get_time() + 0.1)
    (taken,) = out(adapter, context, "handovers")
    assert isinstance(taken, Handover)
    assert taken.done
    assert not taken.stopped
    assert taken.tempo in (0.8, 0.5)
    assert taken.risk_before > 0.1 > taken.risk_after
    assert taken.names[0] == "as it is"
    assert len(taken.names) == 1 + 2 + 1
    assert "P(fall)" in taken.reason
    assert taken.time + 0.3 <= taken.start + 1e-9 < taken.time + 0.3 + 1 / 60
    frame = round(taken.start * 60)
    assert taken.start == pytest.approx(frame / 60, abs=1e-9)
    # Until then the old plan, then one that has the same past.
    simulator.AdvanceTo(taken.start - 0.01)
    assert out(adapter, context, "reference") is plan()
    simulator.AdvanceTo(taken.start)
    new = out(adapter, context, "reference")
    assert new.duration > plan().duration
    for kind in "qva":
        was, now = getattr(plan(), kind), getattr(new, kind)
        np.testing.assert_array_equal(now[:frame], was[:frame])
        np.testing.assert_allclose(now[frame], was[frame], atol=1e-9)
    simulator.AdvanceTo(taken.start + 0.05)
    assert out(adapter, context, "reference") is new
    assert len(out(adapter, context, "commanded_now").time) == len(new.time)


def test_stops_where_nothing_goes_on_safely_and_then_is_done() -> None:
    adapter, context = run(0.3, 3.0)
    log = out(adapter, context, "handovers")
    stop = log[-1]
    assert stop.stopped
    assert stop.done
    assert sum(one.done for one in log) == 1
    reference = out(adapter, context, "reference")
    assert reference.duration < plan().duration
    np.testing.assert_allclose(reference.v[-1], 0.0, atol=1e-8)
    assert out(adapter, context, "risk")[0] == stop.time


def test_goes_on_where_a_halt_is_no_safer(monkeypatch) -> None:
    def lost(_: Foreteller, q: Any, *__: Any) -> QualityPrediction:
        return QualityPrediction(1.5, np.full(len(q), 0.95), *np.full((5, len(q)), 0.01))

    monkeypatch.setattr(Foreteller, "foresee", lost)
    adapter, context = run(0.3, 2.0)
    log = out(adapter, context, "handovers")
    assert log
    assert not any(one.done or one.stopped for one in log)
    assert out(adapter, context, "reference") is plan()


def test_slows_down_no_further_than_it_may() -> None:
    least = OPTIONS.model_copy(update={"least": Continuation(tempo=0.7), "halting": 0.3})
    adapter, context = run(2.6, 3.0, least)
    first, *_, stop = out(adapter, context, "handovers")
    assert first.tempo == 0.8
    assert first.names == ("as it is", "tempo 80%", "halt 1")
    assert stop.names == ("as it is", "halt 1")
    assert stop.stopped


def test_says_so_where_nothing_is_better() -> None:
    adapter, context = run(2.6, 2.0, OPTIONS.model_copy(update={"margin": 1e3, "halting": 1.0}))
    log = out(adapter, context, "handovers")
    assert log
    assert not any(one.done for one in log)
    assert all(one.tempo == one.amplitude == one.stride == 1.0 for one in log)
    assert out(adapter, context, "reference") is plan()


def test_no_second_hand_over_while_one_is_pending_nor_soon_after() -> None:
    always = OPTIONS.model_copy(update={"rate": 10.0, "interval": 0.4, "margin": 0.0})
    adapter, context = run(1.2, 3.0, always)
    done = [one for one in out(adapter, context, "handovers") if one.done]
    assert len(done) > 1
    for one, after in pairwise(done):
        assert after.time >= one.start + 0.4 - 1e-6


def test_replay_from_a_cloned_or_reset_context_is_bitwise_equal() -> None:
    adapter, context = adapter_with(2.6)
    simulator = Simulator(adapter, context)
    middle = None
    while not out(adapter, context, "handovers"):
        middle = context.Clone()
        simulator.AdvanceTo(context.get_time() + 0.1)
    pending = context.Clone()
    simulator.AdvanceTo(3.0)
    log, reference = (out(adapter, context, port) for port in ("handovers", "reference"))
    seen = context.get_discrete_state(0).value().tobytes()
    adapter.SetDefaultContext(context)
    given(adapter, context)
    context.SetTime(0.0)
    for again in (middle, pending, context):
        assert again is not None
        Simulator(adapter, again).AdvanceTo(3.0)
        assert out(adapter, again, "handovers") == log
        assert out(adapter, again, "reference") == reference
        assert again.get_discrete_state(0).value().tobytes() == seen


def test_refuses_what_is_no_reference() -> None:
    adapter, context = adapter_with(1.0)
    adapter.GetInputPort("plan").FixValue(context, Value[object]("a walk"))
    with pytest.raises(PortError, match="plan"):
        out(adapter, context, "reference")


def test_looks_between_the_states_that_it_gathers() -> None:
    adapter, context = run(2.6, 3.0, OPTIONS.model_copy(update={"rate": 7.0}))
    (taken, *_) = out(adapter, context, "handovers")
    assert taken.done
    assert taken.time * 7.0 == pytest.approx(round(taken.time * 7.0), abs=1e-6)
    assert taken.start >= taken.time + 0.3


@pytest.mark.parametrize(
    "bad", [{"rate": 0.5}, {"rate": 20.0}, {"latency": 0.0}, {"attempts": 0}, {"speed": 1}]
)
def test_refuses_settings_out_of_bounds(bad: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(bad))):
        AdapterOptions.model_validate(bad)


def test_in_physics_the_robot_follows_through_the_hand_over(monkeypatch) -> None:
    made = []
    gains = whole_body_controller.preview_gains
    monkeypatch.setattr(
        whole_body_controller, "preview_gains", lambda *a: made.append(1) or gains(*a)
    )
    physics = SimulationOptions(hold=0.2)
    done = rollout_adaptive(ROBOT, commanded(), plan(), Foreteller(2.6), physics, OPTIONS)  # type: ignore[arg-type]
    taken = [one for one in done.handovers if one.done]
    assert taken
    assert not any(one.stopped for one in taken)
    # What is dear is made once for each plan.
    assert len(made) == 1 + len(taken)
    assert done.plan.duration > plan().duration
    assert done.execution.time[-1] == pytest.approx(done.plan.duration + 0.2, abs=0.02)
    assert done.execution.motion_end == done.plan.duration
    rows = done.plan.rows_at(done.execution.time)
    np.testing.assert_allclose(done.execution.q_ref[:, 7:], done.plan.q[rows, 7:], atol=0.05)
    error = np.abs(done.execution.q[:, 7:] - done.execution.q_ref[:, 7:]).max(axis=1)
    assert error.max() < 0.05
    assert len(done.seconds) == len(done.risk)
    assert (done.seconds > 0.0).all()


def test_weights_that_know_states_from_the_command_are_refused() -> None:
    foreteller = Foreteller(1.0)
    foreteller.options = PPNOptions(states="commanded")
    with pytest.raises(ConfigError, match="learned from measured ones"):
        Adapter(ROBOT, foreteller)

"""Messages are frozen, checked, and survive copying and pickling unchanged."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from robomirror_drake.messages import HumanMotion, RobotReference


def motion() -> HumanMotion:
    rng = np.random.default_rng(0)
    return HumanMotion(rng.normal(size=(5, 22, 3)), 20.0, "waves", "test", {"tempo": 1.1})


def reference(**changes: object) -> RobotReference:
    n = 4
    q = np.zeros((n, 30))
    q[:, 0] = 1.0
    values: dict[str, object] = {
        "time": np.arange(n) / 60.0,
        "q": q,
        "v": np.zeros((n, 29)),
        "a": np.zeros((n, 29)),
        "contact": np.ones((n, 2, 4), dtype=bool),
    }
    return RobotReference(**(values | changes))  # type: ignore[arg-type]


def test_arrays_cannot_be_written_even_through_the_array_they_came_from():
    positions = np.zeros((3, 22, 3))
    made = HumanMotion(positions, 30.0)
    positions[:] = 1.0
    assert not made.positions.any()
    with pytest.raises(ValueError, match="read-only"):
        made.positions[0] = 1.0
    with pytest.raises(TypeError):
        made.style["tempo"] = 2.0  # type: ignore[index]


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))])
def test_copies_are_equal_and_still_frozen(clone):
    for message in (motion(), reference(residuals={"drift": 0.001})):
        twin = clone(message)
        assert twin == message
        for value in vars(twin).values():
            assert not isinstance(value, np.ndarray) or not value.flags.writeable


def test_equality_sees_every_bit():
    moved = np.array(motion().positions)
    moved[0, 0, 0] = np.nextafter(moved[0, 0, 0], 1.0)
    assert motion() == motion()
    assert motion() != HumanMotion(moved, 20.0, "waves", "test", {"tempo": 1.1})


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: HumanMotion(np.zeros((5, 21, 3)), 20.0), r"positions has shape \(5, 21, 3\)"),
        (lambda: HumanMotion(np.zeros((1, 22, 3)), 20.0), "2 frames"),
        (lambda: HumanMotion(np.zeros((5, 22, 3)), 0.0), "fps is 0"),
        (lambda: HumanMotion(np.full((5, 22, 3), np.nan), 20.0), r"index \(0, 0, 0\)"),
        (lambda: reference(time=np.zeros(4)), "increasing"),
        (lambda: reference(v=np.zeros((4, 30))), "v has shape"),
        (lambda: reference(contact=np.ones((4, 2))), "contact has shape"),
    ],
)
def test_what_is_wrong_is_named(build, message):
    with pytest.raises(ValueError, match=message):
        build()


def test_a_reference_without_a_plan_has_zero_planned_forces():
    assert reference().foot_force.shape == (4, 2, 6)
    assert not reference().foot_force.any()
    assert not reference().planned

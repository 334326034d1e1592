"""An independent solve with exact constraints finds hardly anything better."""

import pytest

from robomirror_drake.exceptions import RetargetingError
from robomirror_drake.motion.contacts import foot_contacts
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retargeting.kernel import DEADBAND
from robomirror_drake.optimization.retargeting.limits import excess
from robomirror_drake.optimization.retargeting.reference import solve_reference
from robomirror_drake.optimization.retargeting.retarget import (
    RetargetOptions,
    retarget_window,
    scale_motion,
    window_of,
)
from robomirror_drake.optimization.retargeting.solver import objective
from robomirror_drake.robot import load_robot

OPTIONS = RetargetOptions(tolerance=6e-4, flatness=1e-3, iterations=60)


def window(clip, start):
    motion = load_clip(clip)
    targets = scale_motion(load_robot(), motion, foot_contacts(motion))
    return retarget_window(load_robot(), window_of(targets, start, start + 25), OPTIONS)


@pytest.mark.slow
@pytest.mark.parametrize(("clip", "start"), [("walk", 10), ("jump", 30)])
def test_online_objective_is_within_five_percent(clip, start):
    fast = window(clip, start)
    assert fast.solution.violation < 1e-3
    assert excess(fast.path.control[:, 6:], fast.problem.limits, 1 / 15).max() <= 0.0
    exact = solve_reference(fast.problem, fast.solution.standing, fast.path.control, DEADBAND)
    # Both computations of the objective agree, though they share no code.
    assert objective(fast.problem, exact.control) == pytest.approx(exact.objective, rel=1e-6)
    assert fast.solution.objective <= 1.05 * exact.objective


def test_reference_that_cannot_be_found_is_an_error():
    fast = window("walk", 10)
    with pytest.raises(RetargetingError, match="reference solve"):
        solve_reference(fast.problem, fast.solution.standing, fast.path.control, 1e-4, iterations=1)

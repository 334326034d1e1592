"""The projection onto the limits keeps them, and is the nearest that does."""

import numpy as np
import pytest

from robomirror_drake.optimization.retargeting.limits import Limits, excess, project

LIMITS = Limits(
    lower=np.array([-1.0, -0.5]),
    upper=np.array([1.0, 2.0]),
    speed=np.array([4.0, 8.0]),
    acceleration=np.array([60.0, 90.0]),
)
SPACING = 0.1


@pytest.fixture
def control():
    return np.random.default_rng(2).normal(scale=0.6, size=(20, 2))


def test_limits_are_kept(control):
    assert excess(control, LIMITS, SPACING).max() > 0.0
    assert excess(project(control, LIMITS, SPACING), LIMITS, SPACING).max() <= 0.0


def test_what_keeps_them_is_left_alone(control):
    inside = project(control, LIMITS, SPACING)
    np.testing.assert_array_equal(project(inside, LIMITS, SPACING), inside)


def test_nothing_that_keeps_them_is_nearer(control):
    projected = project(control, LIMITS, SPACING)
    rng = np.random.default_rng(3)
    for _ in range(50):
        other = project(projected + 0.05 * rng.normal(size=control.shape), LIMITS, SPACING)
        # The variational inequality of a projection on a convex set.
        assert np.sum((control - projected) * (other - projected)) <= 1e-4


def test_fixed_points_stay(control):
    start = project(control, LIMITS, SPACING)[:3]
    joined = np.vstack([start, control[3:]])
    projected = project(joined, LIMITS, SPACING, fixed=3)
    np.testing.assert_allclose(projected[:3], start, atol=1e-12)

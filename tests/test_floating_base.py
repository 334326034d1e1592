"""v and a are the derivatives of q that Drake's order of coordinates means."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robomirror_drake.optimization import floating_base, spline


@pytest.fixture
def path():
    rng = np.random.default_rng(0)
    steps = Rotation.from_rotvec(0.3 * rng.normal(size=(13, 3)))
    turns = [Rotation.identity()]
    for step in steps[1:]:
        turns.append(turns[-1] * step)
    quaternions = np.array([turn.as_quat(scalar_first=True) for turn in turns])
    for k in range(1, 13):
        quaternions[k] *= np.sign(quaternions[k] @ quaternions[k - 1])
    return floating_base.Path(0.5 * rng.normal(size=(13, 29)), quaternions, 0.1)


def test_velocity_and_acceleration_by_finite_differences(path):
    time, step = np.linspace(0.05, 0.95, 40), 1e-5
    ahead, here, behind = (floating_base.sample(path, time + s) for s in (step, 0.0, -step))
    turn = [Rotation.from_quat(m.q[:, :4], scalar_first=True) for m in (ahead, behind)]
    omega = (turn[0] * turn[1].inv()).as_rotvec() / (2 * step)
    np.testing.assert_allclose(here.v[:, :3], omega, atol=1e-5)
    linear = (ahead.q[:, 4:] - behind.q[:, 4:]) / (2 * step)
    np.testing.assert_allclose(here.v[:, 3:], linear, atol=1e-5)
    np.testing.assert_allclose(here.a, (ahead.v - behind.v) / (2 * step), atol=1e-4)


def test_orientation_is_the_reference_times_the_offset(path):
    time = np.linspace(0.0, 1.0, 31)
    basis = spline.basis(time, 0.1, 13)
    phi = spline.evaluate(basis, path.control)[:, 3:6]
    expected = floating_base.reference_rotation(basis, path.reference)
    expected = expected @ Rotation.from_rotvec(phi).as_matrix()
    q = floating_base.sample(path, time).q[:, :4]
    np.testing.assert_allclose(
        Rotation.from_quat(q, scalar_first=True).as_matrix(), expected, atol=1e-12
    )

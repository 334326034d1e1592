"""r(z), the variables of an adaptation and the rows that it keeps: exact derivatives and limits."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest

from robomirror_drake.exceptions import InputError, RobotModelError
from robomirror_drake.messages import RobotReference
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization import rotations
from robomirror_drake.optimization.adaptation.legs import make_legs, solve_legs
from robomirror_drake.optimization.adaptation.motion import Samples, quaternion_gradient, sample
from robomirror_drake.optimization.adaptation.options import AdaptOptions
from robomirror_drake.optimization.adaptation.path import make_path
from robomirror_drake.optimization.adaptation.rows import families, make_limits, proxy
from robomirror_drake.optimization.adaptation.variables import make_layout
from robomirror_drake.optimization.kinematics import body_poses
from robomirror_drake.optimization.retargeting.retarget import retarget
from robomirror_drake.robot import load_robot, rotation_matrix

ROBOT = load_robot()
LEGS = make_legs(ROBOT)


@lru_cache
def walk() -> RobotReference:
    return retarget(ROBOT, load_clip("walk"))


@lru_cache
def walking() -> SimpleNamespace:
    """The walk as a path, with variables away from the command."""
    options = AdaptOptions()
    path = make_path(LEGS, walk(), options)
    layout = make_layout(path, options)
    rng = np.random.default_rng(3)
    z = 0.1 * rng.normal(size=layout.size)
    z[:3] = 0.5, -1.0, -0.8
    time = np.arange(0.0, 1.3 * walk().duration, 0.05)
    return SimpleNamespace(
        path=path, layout=layout, z=z, time=time, d=rng.normal(size=layout.size), options=options
    )


def moved(z: np.ndarray, derivatives: bool = True) -> Samples:
    w = walking()
    return sample(LEGS, w.path, w.layout, z, w.time, derivatives)


def test_no_change_gives_the_command_back() -> None:
    w = walking()
    time = np.arange(0.0, walk().duration, 0.05)
    same = sample(LEGS, w.path, w.layout, np.zeros(w.layout.size), time, derivatives=False)
    rows = np.round(time * 60).astype(int)
    np.testing.assert_allclose(same.q, walk().q[rows], atol=1e-10)
    np.testing.assert_array_equal(same.contact, walk().contact[rows])


def test_jacobian_by_finite_differences() -> None:
    w, e = walking(), 1e-6
    at = moved(w.z)
    rate = (moved(w.z + e * w.d, False).q - moved(w.z - e * w.d, False).q) / (2 * e)
    v = at.jacobian @ w.d
    np.testing.assert_allclose(rate[:, 7:], v[:, 6:], atol=1e-6)
    np.testing.assert_allclose(rate[:, 4:7], v[:, 3:6], atol=1e-7)
    weights = np.random.default_rng(0).normal(size=rate.shape)
    by_v = quaternion_gradient(at.q, weights)
    assert np.sum(by_v * v) == pytest.approx(np.sum(weights * rate), rel=1e-7)


def test_rows_by_finite_differences() -> None:
    w, e = walking(), 1e-6
    limits = make_limits(ROBOT, LEGS, moved(0 * w.z, False), w.options)
    after, before = (families(limits, moved(w.z + s * e * w.d, False)) for s in (1, -1))
    names = [family.name for family in families(limits, moved(w.z))]
    assert names == ["position", "stretch", "speed", "torque", "ground"]
    few = families(limits, moved(w.z))
    for family, some, b, a in zip(
        families(limits, moved(w.z), near=np.inf), few, after, before, strict=True
    ):
        found = family.jacobian @ w.d
        assert len(family.near) == len(family.value)
        assert len(some.near) < len(family.near) or family.name == "stretch"
        np.testing.assert_allclose(some.jacobian, family.jacobian[some.near], atol=1e-12)
        assert np.abs(found).max() > 0.1, family.name
        np.testing.assert_allclose((b.value - a.value) / (2 * e), found, atol=1e-5)


def test_feet_stand_where_they_stand() -> None:
    """Whatever changes, a foot that stands does not move from one sample to the next."""
    w = walking()
    z = w.z.copy()
    z[w.layout.blocks["stride"]] = 0.0  # which moves footholds, but not within a stance
    feet = LEGS.chain[:, -1]
    for variables in (z, w.z):
        at = moved(variables, False)
        assert at.miss < 1e-9
        stands = at.contact.any(axis=2)
        tau, _, _ = w.path.tau(w.time, w.layout.changes(variables)[0])
        led = w.path.at(tau).position[0][:, 1:]
        way = at.origin[:, feet] - led
        for foot in range(2):
            both = stands[1:, foot] & stands[:-1, foot]
            drift = np.linalg.norm(np.diff(way[:, foot], axis=0), axis=1)[both]
            assert drift.max() < 5e-4  # in the last sixtieth it may begin to lift
        if variables is z:
            np.testing.assert_allclose(at.origin[:, feet][stands], led[stands], atol=5e-4)


def test_stride_shrinks_the_way_and_keeps_the_stance() -> None:
    w = walking()
    z = np.zeros(w.layout.size)
    z[w.layout.blocks["stride"]] = -0.3 / w.layout.scale[w.layout.blocks["stride"]]
    time = w.path.time[:-1:3]
    before = sample(LEGS, w.path, w.layout, 0 * z, time, derivatives=False)
    after = sample(LEGS, w.path, w.layout, z, time, derivatives=False)
    length = [np.linalg.norm(np.ptp(s.q[:, 4:6], axis=0)) for s in (before, after)]
    assert length[1] == pytest.approx(0.7 * length[0], rel=0.05)


def test_tempo_stretches_time() -> None:
    w = walking()
    z = np.zeros(w.layout.size)
    z[w.layout.blocks["tempo"]] = 0.5 / w.layout.scale[w.layout.blocks["tempo"]]
    tau, rate, by_sigma = w.path.tau(w.time, 0.5)
    assert (np.diff(tau) >= 0.0).all()
    assert rate[0] == pytest.approx(1.0, abs=0.01)  # under way at its start: it goes on as it was
    inside = tau < w.path.duration
    back = tau + 0.5 * w.path.stretched(tau)
    np.testing.assert_allclose(back[inside], w.time[inside], atol=1e-9)
    e = 1e-6
    slope = (w.path.tau(w.time, 0.5 + e)[0] - w.path.tau(w.time, 0.5 - e)[0]) / (2 * e)
    np.testing.assert_allclose(slope, by_sigma, atol=1e-7)


def test_the_start_is_kept() -> None:
    """Offsets, amplitude and stride leave position and velocity at the start as they are."""
    w, h = walking(), 1e-4
    z = w.z.copy()
    z[w.layout.blocks["tempo"]] = 0.0
    time = np.array([0.0, h])
    kept, command = (
        sample(LEGS, w.path, w.layout, v, time, derivatives=False).q for v in (z, 0 * z)
    )
    np.testing.assert_allclose(kept[0], command[0], atol=1e-12)
    upper = 7 + LEGS.upper
    apart = (np.diff(kept, axis=0) - np.diff(command, axis=0)) / h
    assert np.abs(apart[:, upper]).max() < np.abs(np.diff(command, axis=0) / h).max()


def test_cost_is_the_deviation() -> None:
    """½ zᵀ H z of a pure offset of the upper joints is its mean square by its scale."""
    options = AdaptOptions.model_validate({"variables": ["upper"], "scales": {"smooth": 0.0}})
    path = make_path(LEGS, walk(), options)
    layout = make_layout(path, options)
    z = np.random.default_rng(0).normal(size=layout.size)
    tau = np.linspace(0.0, path.duration, 2001)
    offset = layout.basis(tau)[0] @ (z * layout.scale).reshape(layout.tie.shape[1], -1)
    mean = np.mean(np.sum((offset / options.scales.upper) ** 2, axis=1))
    assert z @ layout.hessian @ z == pytest.approx(mean, rel=0.05)


def test_proxy_is_gravity_without_ground() -> None:
    """With no load on the feet and at rest the proxy is the gravity torque of Pinocchio."""
    w = walking()
    limits = make_limits(ROBOT, LEGS, moved(0 * w.z, False), w.options)
    at = moved(w.z, False)
    free = proxy(limits._replace(inertia=np.zeros(23)), at._replace(load=0.0 * at.load))[0]
    data = ROBOT.model.createData()
    for k in (0, 7, 20):
        g = pin.computeGeneralizedGravity(ROBOT.model, data, ROBOT.to_pinocchio(at.q[k]))
        np.testing.assert_allclose(free[k], g[6:], atol=1e-9)


def test_legs_reach_random_poses() -> None:
    rng = np.random.default_rng(5)
    q = np.tile(ROBOT.standing, (20, 1))
    q[:, 7:] += rng.normal(scale=0.15, size=(20, 23))
    q[:, 7:] = np.clip(q[:, 7:], *ROBOT.position_limits)
    base = rotation_matrix(q[:, :4])
    x = np.hstack([q[:, 4:7], np.zeros((20, 3)), q[:, 7:]])
    R, p = body_poses(LEGS.tree, base, x)
    feet = LEGS.chain[:, -1]
    start = np.tile(ROBOT.standing[7:], (20, 1))
    start[:, LEGS.upper] = q[:, 7 + LEGS.upper]
    poses = (np.ascontiguousarray(R[:, feet]), np.ascontiguousarray(p[:, feet]))
    joints, miss = solve_legs(LEGS, (base, q[:, 4:7].copy()), poses, start)
    assert miss.max() < 1e-9
    again = body_poses(LEGS.tree, base, np.hstack([x[:, :6], joints]))
    np.testing.assert_allclose(again[1][:, feet], p[:, feet], atol=1e-9)
    np.testing.assert_allclose(again[0][:, feet], R[:, feet], atol=1e-9)


def test_rotation_vectors() -> None:
    phi = np.random.default_rng(1).normal(size=(6, 3))
    phi[0] = 1e-6
    np.testing.assert_allclose(rotations.log(rotations.exp(phi)), phi, atol=1e-9)
    e, d = 1e-6, np.array([0.3, -0.5, 0.8])
    turned = rotations.exp(phi + e * d) @ rotations.exp(phi - e * d).swapaxes(1, 2)
    found = rotations.left_jacobian(phi) @ d
    np.testing.assert_allclose(rotations.log(turned) / (2 * e), found, atol=1e-8)


def test_what_cannot_be_adapted_is_refused() -> None:
    short = walk()
    cut = {name: getattr(short, name)[:4] for name in ("time", "q", "v", "a", "contact")}
    with pytest.raises(InputError, match="4 samples"):
        make_path(LEGS, replace(short, **cut, foot_force=None), AdaptOptions())
    with pytest.raises(ValueError, match="twice"):
        AdaptOptions(variables=("tempo", "tempo"))


def test_legs_of_another_number_of_joints_are_refused() -> None:
    wrong = replace(
        ROBOT,
        spec=ROBOT.spec.model_copy(
            update={
                "feet": {
                    name: foot.model_copy(update={"link": ROBOT.spec.keypoints["neck"].link})
                    for name, foot in ROBOT.spec.feet.items()
                }
            }
        ),
    )
    with pytest.raises(RobotModelError, match="has 3 joints"):
        make_legs(wrong)

"""The comparison with per-frame IK runs, and says what it measured."""

import sys

import numpy as np
import pytest
from rich.console import Console

from robomirror_drake.bench import retarget
from robomirror_drake.exceptions import InputError
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.optimization.retargeting.retarget import scale_motion
from robomirror_drake.robot import load_robot


def test_rows_and_figures(monkeypatch):
    pytest.importorskip("mink")
    monkeypatch.setattr(retarget, "REPEATS", 1)
    figures = retarget.run(["turn_right1"])
    ours, mink = figures["rows"]
    assert (ours["method"], mink["method"]) == ("ours", "mink")
    assert mink["keypoint_cm"] < 1.0, "mink did not reach its keypoints: no fair comparison"
    assert ours["stance_drift_mm"] < 5.0 < mink["stance_drift_mm"]
    assert ours["jerk_rms"] < mink["jerk_rms"] / 20
    assert ours["limit_violation"] == 0.0
    for name in ("window_1s_cold_ms", "window_1s_warm_ms", "pool_8x1s_ms"):
        assert figures[name] > 0.0
    console = Console(width=160, record=True)
    retarget.print_table(figures, console)
    assert "turn_right1" in console.export_text()


def test_mujoco_model_is_the_same_robot():
    mujoco = pytest.importorskip("mujoco")
    robot = load_robot()
    model = retarget.mujoco_model(robot, mujoco)
    assert model.nq == robot.model.nq
    assert float(np.sum(model.body_mass)) == pytest.approx(robot.mass, rel=1e-6)
    data = mujoco.MjData(model)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    targets = scale_motion(robot, load_clip("walk"), np.ones((39, 2, 2), bool))
    assert targets.keypoints.shape[1] == model.nsite
    hips = [data.site(f"{side}_hip").xpos for side in ("left", "right")]
    np.testing.assert_allclose(np.subtract(*hips), [0.0, 0.192, 0.0], atol=1e-9)


def test_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mink", None)
    with pytest.raises(InputError, match=r"robomirror_drake\[bench\]"):
        retarget.run(["walk"])

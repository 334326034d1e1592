"""Fixtures that more than one test module uses."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from robomirror_drake.dataset.columns import episodes_table, frame_columns, frames_table
from robomirror_drake.dataset.shards import Store, encode, write_shard
from robomirror_drake.messages import Execution, HumanMotion, RobotReference
from robomirror_drake.optimization import spline
from robomirror_drake.optimization.planning.options import PlanOptions
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import PAD, reference_frames
from robomirror_drake.ppn.model import PPN
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.robot import load_robot

RATE = 60.0


def _standing(samples: int) -> np.ndarray:
    """(samples, 30) upright at 0.8 m, all joints at zero."""
    q = np.zeros((samples, 30))
    q[:, 0], q[:, 6] = 1.0, 0.8
    return q


@pytest.fixture(scope="session")
def make_execution() -> Callable[..., Execution]:
    """Makes a perfect, motionless execution; keyword arguments replace its fields."""

    def make(samples: int = 61, **changes: Any) -> Execution:
        weight = np.zeros((samples, 2, 3))
        weight[..., 2] = 300.0
        perfect = Execution(
            time=np.arange(samples) / RATE,
            q=_standing(samples),
            v=np.zeros((samples, 29)),
            q_ref=_standing(samples),
            v_ref=np.zeros((samples, 29)),
            torque=np.zeros((samples, 23)),
            foot_force=weight,
            other_force=np.zeros(samples),
            contact_ref=np.ones((samples, 2, 4), dtype=np.bool_),
            qp_status=np.zeros(samples),
            qp_slack=np.zeros(samples),
            contact_scheduled=np.ones((samples, 2)),
            contact_measured=np.ones((samples, 2)),
            torque_limit=np.zeros((samples, 23)),
        )
        return dataclasses.replace(perfect, **changes)

    return make


@pytest.fixture(scope="session")
def resampled() -> Callable[[RobotReference, float], tuple[np.ndarray, ...]]:
    """Times and x, ẋ, ẍ of a plan at any rate, by a spline through its samples."""

    def sample(plan: RobotReference, rate: float) -> tuple[np.ndarray, ...]:
        intervals = max(5, round(plan.duration / PlanOptions().knot_spacing))
        spacing, points = plan.duration / intervals, intervals + spline.ORDER - 1
        fitted = spline.fit(spline.basis(plan.time, spacing, points), plan.q, smoothing=1e-12)
        time = np.arange(0.0, plan.duration, 1 / rate)
        at = spline.basis(time, spacing, points)
        return time, *(spline.evaluate(at, fitted, order) for order in range(3))

    return sample


@pytest.fixture(scope="session")
def noisy_execution(make_execution: Callable[..., Execution]) -> Execution:
    """Two seconds of random numbers in the right shapes and of sensible size."""
    rng = np.random.default_rng(7)
    n = 121
    sway = 0.02 * rng.standard_normal((n, 30))
    q = _standing(n) + sway
    q[:, :4] /= np.linalg.norm(q[:, :4], axis=1, keepdims=True)
    return make_execution(
        n,
        q=q,
        v=0.1 * rng.standard_normal((n, 29)),
        torque=40.0 * rng.standard_normal((n, 23)),
        contact_ref=rng.random((n, 2, 4)) > 0.3,
        text="a person sways <b>& more</b>",
        source="test",
        seed=3,
        motion_end=1.5,
    )


@pytest.fixture(scope="session")
def candidates() -> tuple[HumanMotion, ...]:
    """Three human motions of unequal length, two of them with style parameters."""
    rng = np.random.default_rng(5)
    stand = np.zeros((22, 3))
    stand[:, 2] = np.linspace(0.9, 1.6, 22)
    return tuple(
        HumanMotion(
            positions=stand + 0.01 * rng.standard_normal((frames, 22, 3)),
            fps=20.0,
            text="a person sways",
            source=f"test/{frames}",
            style=style,
        )
        for frames, style in ((41, {"tempo": 1.0}), (35, {"tempo": 1.1, "amplitude": 0.9}), (9, {}))
    )


@pytest.fixture(scope="session")
def reference() -> RobotReference:
    """Two seconds of standing with a planned share of the weight on each foot."""
    n = 121
    force = np.zeros((n, 2, 6))
    force[..., 5] = 306.0
    return RobotReference(
        time=np.arange(n) / RATE,
        q=_standing(n),
        v=np.zeros((n, 29)),
        a=np.zeros((n, 29)),
        contact=np.ones((n, 2, 4), dtype=np.bool_),
        text="a person sways",
        source="test/41",
        residuals={"keypoint_error": 0.012, "penetration": 1e-4},
        foot_force=force,
        planned=True,
    )


Change = Callable[[dict[str, Any], dict[str, np.ndarray]], None]


@pytest.fixture(scope="session")
def make_predictor() -> Callable[..., Predictor]:
    """Makes a predictor of a small network with weights of chance, by a seed.

    Keyword arguments replace options of the network.
    """

    def make(seed: int = 0, dtype: torch.dtype = torch.float32, **changes: Any) -> Predictor:
        robot = load_robot()
        small = {"horizon": 0.5, "history": 0.1, "width": 8, "heads": 2}
        layers = {"self_layers": 1, "cross_layers": 1, "dropout": 0.0}
        options = PPNOptions.model_validate(small | layers | changes)
        one = torch.from_numpy(np.tile(robot.standing, (1, 1 + 2 * PAD, 1)))
        bears = torch.ones(1, 1, 2, 4, dtype=torch.float64)
        body = Body.of(robot)
        frames = reference_frames(body, one, bears, 1.0 / options.rate)
        more = 4 + sum(len(leg) for leg in body.legs)
        torch.manual_seed(seed)
        sizes = frames.as_state(more).flat().shape[-1], frames.flat().shape[-1]
        return Predictor(PPN(options, *sizes).to(dtype), robot)

    return make


@pytest.fixture(scope="session")
def write_executions() -> Callable[..., Path]:
    """Writes a data set in which who leans falls: an execution a command, every other one falls."""
    return _write_executions


def _write_executions(
    folder: Path, change: Change = lambda *_: None, falls: float = 0.5, **commands: int
) -> Path:
    """Writes so many commands of each split; ``change`` may alter a row and its frames."""
    rows, frames = [], []
    for split, count in commands.items():
        for number in range(count):
            fell = number + 1 <= falls * count
            row, arrays = _leaning(len(rows), split, fell)
            change(row, arrays)
            row["raw_q"] = np.asarray(row["raw_q"], np.float32).ravel()
            row["raw_contact"] = np.ones(len(row["raw_q"]) // 30 * 8, np.bool_)
            rows.append(row)
            frames.append(arrays)
    together = {name: np.concatenate([part[name] for part in frames]) for name in frames[0]}
    shard = Store(folder).group(0, len(rows) - 1)
    write_shard(shard, *encode(episodes_table(rows), frames_table(together, 23)))
    about = {
        "options": {"seed": 0, "per_prompt": 1, "executions": 1, "longest": 60.0},
        "scenario": {"simulation": {"hold": 0.0}},
        "prompts": {"count": len(rows)},
        "versions": {},
    }
    (folder / "dataset.json").write_text(json.dumps(about))
    return folder


def _leaning(number: int, split: str, fell: bool) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """An execution of 1.5 s: the robot sways, and leans ever more for 0.9 s until it falls."""
    rng = np.random.default_rng(number)
    robot, time = load_robot(), np.arange(91) / RATE
    heading, place = rng.uniform(-np.pi, np.pi), rng.normal(size=2)
    fall_time = round(rng.uniform(1.0, 1.4) * RATE) / RATE if fell else None
    rate = 0.6
    lean = rate * np.clip(time - (fall_time or 99.0) + 0.9, 0.0, None)
    turn = Rotation.from_euler("z", heading)
    q = np.tile(robot.standing, (len(time), 1))
    q[:, 4:6] = place
    q[:, 7:] += rng.uniform(0.01, 0.1) * np.sin(3.0 * time + rng.uniform(0.0, 6.0))[:, None]
    raw = q.copy()
    raw[:, :4] = turn.as_quat(scalar_first=True)
    done = q + 0.01 * rng.normal(size=q.shape)
    leaning = turn * Rotation.from_rotvec(lean[:, None] * np.array([[0.0, 1.0, 0.0]]))
    done[:, :4] = leaning.as_quat(scalar_first=True)
    v = 0.1 * rng.normal(size=(len(time), 29))
    v[:, :3] += turn.apply(np.array([0.0, 1.0, 0.0])) * rate * (lean > 0.0)[:, None]
    arrays = {c.name: np.zeros((len(time), *c.shape)) for c in frame_columns()}
    arrays |= {"time": time, "q": done, "v": v, "q_raw": raw, "v_raw": np.zeros_like(v)}
    arrays |= {"episode": np.full(len(time), number), "frame": np.arange(len(time))}
    row = {
        "episode": number, "prompt_index": number, "prompt": f"sways {number} times",
        "actions": ["sway"], "group": "expressive", "split": split, "candidate": 0,
        "execution": 0, "kind": "nominal", "seed": number, "frames": len(time), "raw_q": raw.copy(),
        "raw_duration_s": 1.5, "motion_end_s": 1.5, "lead_s": 0.0, "fell": fell,
        "fall_time_s": fall_time,
        "family": ("sideways" if number % 2 else "lunges") if split == "held_out" else None,
    }  # fmt: skip
    return row, arrays

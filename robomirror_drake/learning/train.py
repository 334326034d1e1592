"""Train a performance prediction network; reads from top to bottom.

What a step draws follows from (seed, epoch, step), so that a training that was interrupted
goes on to the same weights. Several processes share the steps when the module is started
with ``torchrun``: each learns from its part of every batch.
"""

from __future__ import annotations

import copy
import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, distributed
from torch.nn import functional
from torch.nn.utils import clip_grad_norm_

from robomirror_drake import checkpoint
from robomirror_drake.dataset.folder import description
from robomirror_drake.exceptions import ConfigError
from robomirror_drake.learning.calibrate import balanced_accuracy, calibrate
from robomirror_drake.learning.motions import foreseen, read_motions
from robomirror_drake.learning.windows import Integers, Windows, load_windows
from robomirror_drake.ppn.model import PPN, Scores
from robomirror_drake.ppn.options import TrainOptions
from robomirror_drake.ppn.predictor import Predictor
from robomirror_drake.robot import load_robot

WEIGHTS, CHECKPOINT, LOG = "ppn.safetensors", "checkpoint.safetensors", "log.jsonl"

_WARMUP = 0.05  # share of the steps
_CHUNK = 1024  # windows at once where nothing is learned


class Epoch(NamedTuple):
    """How an epoch went.

    Attributes:
        epoch, epochs: Which of how many at most, from 1.
        loss: Mean of its steps.
        validation: Loss on the commands for validation, with as many falls as not.
        accuracy: Share of falls told rightly there, with as many falls as not.
        best: Whether it is the best so far.
        seconds: What it took [s].
    """

    epoch: int
    epochs: int
    loss: float
    validation: float
    accuracy: float
    best: bool
    seconds: float


def train(
    options: TrainOptions,
    report: Callable[[Epoch], None] = lambda _: None,
    read: Callable[[int], None] | None = None,
    stepped: Callable[[int, int], None] = lambda *_: None,
) -> Path:
    """Trains a network, or goes on with one; returns the file of its weights.

    Args:
        options: Of the training.
        report: Told about each epoch.
        read: Told how many episodes are read.
        stepped: Told how many steps are done, and of how many at most.

    Raises:
        ConfigError: The folder holds a checkpoint of another training, or there is no GPU.
        ResultError: The data set has no windows to learn from or to validate with.
    """
    # --- what to learn from
    rank, world = _processes()
    torch.set_num_threads(options.threads)
    if options.device == "cuda" and not torch.cuda.is_available():
        raise ConfigError("device is cuda, and there is none here; train on the cpu")
    device = torch.device(options.device)
    if options.device == "cuda":
        device = torch.device("cuda", rank % torch.cuda.device_count())
    robot = load_robot(options.robot)
    data = load_windows(options.data, robot, options.network, options.spacing, options.mirror, read)
    learned, judged = _splits(data, options)

    # --- the network
    torch.manual_seed(options.seed)
    network = PPN(options.network, *_sizes(data)).to(device)
    network.fit_scales(*_seen(data, learned, options), data.errors[learned])
    average = copy.deepcopy(network).eval()
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay
    )
    # An epoch draws as many windows with a fall as there are: each is seen about once in it.
    steps = math.ceil(int(data.fall[learned].sum()) / (options.falls * options.batch))
    header = {
        "options": options.model_dump(mode="json", exclude={"data", "out", "device", "threads"}),
        "data": _described(data, learned, judged),
        "robot": robot.spec.name,
        "joints": list(robot.joint_names),
    }

    # --- where it stands
    options.out.mkdir(parents=True, exist_ok=True)
    begun, best, waited, best_state = 0, math.inf, 0, average.state_dict()
    place = options.out / CHECKPOINT
    if place.exists():
        tensors, told = checkpoint.load(place, checkpoint.PREDICTOR)
        _check_same(place, told, header)
        checkpoint.restore("network", network, tensors)
        checkpoint.restore("average", average, tensors)
        checkpoint.restore_optimizer(optimizer, tensors)
        best_state = {k[5:]: t for k, t in tensors.items() if k.startswith("best.")}
        begun, best, waited = told["epoch"], told["best"], told["waited"]

    # --- learn
    for epoch in range(begun, options.epochs):
        if waited >= options.patience:
            break
        started, total = time.monotonic(), 0.0
        network.train()
        for step in range(steps):
            rng = np.random.default_rng((options.seed, epoch, step))
            torch.manual_seed(int(rng.integers(2**62)) + rank)
            done = (epoch * steps + step) / (options.epochs * steps)
            for group in optimizer.param_groups:
                group["lr"] = options.learning_rate * _schedule(done)
            which = _draw(data, learned, options, rng)[rank::world]
            state, reference = (x.to(device) for x in data.inputs(which, options.network))
            loss = _loss(network, network(state, reference), data, which, options)
            optimizer.zero_grad(set_to_none=True)
            loss.backward()  # type: ignore[no-untyped-call]
            if world > 1:
                _share_gradients(network, world)
            clip_grad_norm_(network.parameters(), 1.0)
            optimizer.step()
            _follow(average, network, min(options.average, 1.0 - 1.0 / (epoch * steps + step + 1)))
            total += float(loss.detach())
            stepped(epoch * steps + step + 1, options.epochs * steps)
        # --- judge
        scores = predict(average, data, judged)
        fall = data.fall[judged]
        weight = torch.where(fall, 0.5 / fall.float().mean(), 0.5 / (~fall).float().mean())
        validation = float(_loss(network, scores, data, judged, options, weight))
        better = validation < best
        if better:
            best, waited, best_state = validation, 0, copy.deepcopy(average.state_dict())
        else:
            waited += 1
        made = Epoch(
            epoch + 1, options.epochs, total / steps, validation,
            balanced_accuracy(scores.fall, fall), better, time.monotonic() - started,
        )  # fmt: skip
        if rank == 0:
            stand = {"epoch": epoch + 1, "best": best, "waited": waited}
            _keep(options, place, (network, average), optimizer, best_state, header, made, stand)
            report(made)

    # --- what is kept of it
    average.load_state_dict(best_state)
    logit = predict(average, data, judged).fall.double().numpy()
    calibrate(average.calibration, logit, data.fall[judged].numpy())
    motions = read_motions(options.data, ("validation",))["validation"]
    fell = np.array([motion.fell for motion in motions], np.bool_)
    whole = foreseen(Predictor(average.cpu(), robot), motions)
    calibrate(average.motion_calibration, whole, fell)
    path = options.out / WEIGHTS
    if rank == 0:
        half = {name: t.half() for name, t in checkpoint.named("network", average).items()}
        kept = half | {f"network.{name}": t for name, t in average.named_buffers()}
        told = header | {"best": best, "scenario": physics_of(options.data)}
        told["motions"] = {"validation": len(motions), "falls_validation": int(fell.sum())}
        checkpoint.save(path, kept, told, checkpoint.PREDICTOR)
    return path


def predict(network: PPN, data: Windows, which: Integers) -> Scores:
    """Scores of windows, without gradients."""
    network.eval()
    device = network.cls.device
    with torch.no_grad():
        parts = [
            network(*(x.to(device) for x in data.inputs(some, network.options)))
            for some in np.array_split(which, max(1, len(which) // _CHUNK))
        ]
    return Scores(*(torch.cat(part).cpu() for part in zip(*parts, strict=True)))


def _loss(
    network: PPN,
    scores: Scores,
    data: Windows,
    which: Integers,
    options: TrainOptions,
    weight: Tensor | float = 1.0,
) -> Tensor:
    """L_fall + λ1 L_align + λ2 L_smooth; errors in deviations of their logarithms.

    Errors count by their square up to one deviation, and in proportion beyond.
    """
    device = scores.fall.device
    fall, errors = data.fall[which].float().to(device), data.errors[which].to(device)
    far = (scores.errors.to(device) - errors) / network.error_scale[1].to(device)
    square = functional.smooth_l1_loss(far, torch.zeros_like(far), reduction="none")
    told = functional.binary_cross_entropy_with_logits(scores.fall, fall, reduction="none")
    align, smooth = square[:, [0, 1, 3, 4]].mean(1), square[:, 2]
    return (weight * (told + options.align * align + options.smooth * smooth)).mean()


def _draw(
    data: Windows, learned: Integers, options: TrainOptions, rng: np.random.Generator
) -> Integers:
    """A batch with the wanted share of falls."""
    falling = data.fall[learned].numpy()
    falls = round(options.falls * options.batch)
    return np.concatenate(
        [
            rng.choice(learned[falling], falls),
            rng.choice(learned[~falling], options.batch - falls),
        ]
    )


def _splits(data: Windows, options: TrainOptions) -> tuple[Integers, Integers]:
    """Windows to learn from and to validate with, each with and without falls."""
    prompts = sorted({row["prompt_index"] for row in data.episodes if row["split"] == "train"})
    order = np.random.default_rng(options.seed).permutation(prompts)
    kept = set(order[: math.ceil(options.share * len(order))].tolist())
    learned = data.of(lambda row: row["prompt_index"] in kept)
    judged = data.of_split("validation")
    if options.network.states == "commanded":  # nothing tells of a push
        learned, judged = (which[~data.pushed[which]] for which in (learned, judged))
    for name, which in (("train", learned), ("validation", judged)):
        data.check_falls(which, options.data, f"for {name}")
    return learned, judged


def _sizes(data: Windows) -> tuple[int, int]:
    """Features of a state and of a reference."""
    return data.states.shape[1], data.references.shape[1]


def _seen(data: Windows, which: Integers, options: TrainOptions) -> tuple[Tensor, Tensor]:
    """Features (N, F_s), (M, F_r) of frames as they are seen, from some of the windows."""
    some = np.random.default_rng(options.seed).permutation(which)[: 8 * _CHUNK]
    state, reference = data.inputs(some, options.network)
    return state.flatten(0, 1), reference.flatten(0, 1)


def _described(data: Windows, learned: Integers, judged: Integers) -> dict[str, Any]:
    """What was learned from, for the header of the weights."""
    rows = data.episodes
    used = [rows[i] for i in np.unique(data.episode[learned])]
    return {
        "fingerprint": data.fingerprint,
        "executions": sum(not row["mirrored"] for row in rows),
        "executions_learned": sum(not row["mirrored"] for row in used),
        "commands_learned": len({row["prompt_index"] for row in used}),
        "windows_learned": len(learned),
        "windows_validation": len(judged),
        "falls_learned": float(data.fall[learned].float().mean()),
        "falls_validation": float(data.fall[judged].float().mean()),
    }


def physics_of(data: Path) -> dict[str, Any]:
    """What of a data set's scenario decides how the robot fares; empty where it does not say."""
    scenario = description(data).get("scenario", {})
    return {name: scenario[name] for name in ("robot", "planner", "simulation") if name in scenario}


def _keep(
    options: TrainOptions,
    place: Path,
    networks: tuple[PPN, PPN],
    optimizer: torch.optim.Optimizer,
    best_state: dict[str, Tensor],
    header: dict[str, Any],
    made: Epoch,
    stand: dict[str, Any],
) -> None:
    """Writes the checkpoint and a line of the log."""
    tensors = checkpoint.named("network", networks[0]) | checkpoint.named("average", networks[1])
    tensors |= {f"best.{name}": tensor for name, tensor in best_state.items()}
    tensors |= checkpoint.named_optimizer(optimizer)
    checkpoint.save(place, tensors, header | stand, checkpoint.PREDICTOR)
    with (options.out / LOG).open("a", encoding="utf-8") as file:
        file.write(json.dumps(made._asdict()) + "\n")


def _check_same(place: Path, told: dict[str, Any], header: dict[str, Any]) -> None:
    for key, value in header.items():
        there, here = told.get(key), json.loads(json.dumps(value))
        if there != here:
            names = _differing(there, here) if isinstance(here, dict) else []
            said = f" ({', '.join(names)})" if names else ""
            raise ConfigError(
                f"{place} was begun with other {key}{said}; "
                "continue with the same, or name another folder"
            )


def _differing(there: object, here: dict[str, Any]) -> list[str]:
    """Keys whose values differ, by their path."""
    names = []
    for key, value in here.items():
        other = there.get(key) if isinstance(there, dict) else None
        if isinstance(value, dict):
            names += [f"{key}.{name}" for name in _differing(other, value)]
        elif other != value:
            names.append(key)
    return names


def _schedule(done: float) -> float:
    """Share of the learning rate: warm-up, then a cosine down to a hundredth."""
    if done < _WARMUP:
        return (done + 1e-3) / _WARMUP
    return 0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * (done - _WARMUP) / (1.0 - _WARMUP)))


@torch.no_grad()
def _follow(average: PPN, network: PPN, decay: float) -> None:
    for mean, now in zip(average.parameters(), network.parameters(), strict=True):
        mean.lerp_(now, 1.0 - decay)


def _processes() -> tuple[int, int]:
    """Rank and number of the processes that train together."""
    if int(os.environ.get("WORLD_SIZE", "1")) > 1 and not distributed.is_initialized():
        distributed.init_process_group("gloo")
    return (
        (distributed.get_rank(), distributed.get_world_size())
        if distributed.is_initialized()
        else (0, 1)
    )


def _share_gradients(network: PPN, world: int) -> None:
    for parameter in network.parameters():
        if parameter.grad is not None:
            distributed.all_reduce(parameter.grad)
            parameter.grad /= world

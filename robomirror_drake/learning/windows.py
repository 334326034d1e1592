"""From a data set on disk to what a network learns from: frames, windows and labels."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import torch
from torch import Tensor

from robomirror_drake.dataset.folder import description
from robomirror_drake.dataset.shards import Shard, read_frames, read_shards
from robomirror_drake.dataset.windows import Labels, Track, label_windows
from robomirror_drake.exceptions import ResultError
from robomirror_drake.messages import Array, BoolArray
from robomirror_drake.ppn.body import Body
from robomirror_drake.ppn.features import (
    PAD,
    RECORDED,
    REFERENCE_VECTORS,
    STATE_VECTORS,
    reference_frames,
    rows_at,
    seen,
    state_frames,
    unflat,
)
from robomirror_drake.ppn.mirror import Mirror
from robomirror_drake.ppn.options import PPNOptions
from robomirror_drake.robot import Robot
from robomirror_drake.tables import rows_in_shape

_LEAST_ERROR = 1e-4  # errors below are alike: the logarithm of nothing is not to be learned

Integers = npt.NDArray[np.int64]


class Episode(NamedTuple):
    """One execution as it stands in a data set.

    Attributes:
        about: Its row among the episodes.
        track: What it did and what was commanded, with the whole command after a fall too.
        raw_q: (R, 30) kinematic reference at 60 Hz.
        raw_contact: (R, 2, 4).
    """

    about: dict[str, Any]
    track: Track
    raw_q: Array
    raw_contact: Array


@dataclass(frozen=True)
class Windows:
    """All windows of some episodes, over frames that they share.

    Attributes:
        states: (N, F) features of states, :meth:`.features.Frames.flat`.
        references: (M, F) of kinematic references, as long as any window looks back and ahead.
        now: (W,) row of ``states`` that a window begins at.
        first: (W,) row of its episode's first state.
        ahead: (W,) row of ``references`` that it begins at.
        fall: (W,) whether the robot falls within the horizon.
        time_to_fall: (W,) [s], +inf where the execution has no fall.
        errors: (W, 5) natural logarithms of the mean errors.
        pushed: (W,) whether the robot has been pushed before.
        episode: (W,) row of ``episodes``.
        episodes: What the data set says of each.
        fingerprint: Of the episodes that were read, mirrored ones aside.
    """

    states: Tensor
    references: Tensor
    now: Integers
    first: Integers
    ahead: Integers
    fall: Tensor
    time_to_fall: Tensor
    errors: Tensor
    pushed: BoolArray
    episode: Integers
    episodes: list[dict[str, Any]]
    fingerprint: str

    def __len__(self) -> int:
        return len(self.now)

    def inputs(self, which: Integers, options: PPNOptions) -> tuple[Tensor, Tensor]:
        """What the network sees of windows: (n, S, F_s) of states, (n, T, F_r) of the reference."""
        back = np.arange(1 - options.back, 1)
        if options.states == "commanded":
            commanded = unflat(self.references[self.ahead[which, None] + back], REFERENCE_VECTORS)
            more = self.references.shape[1] - self.states.shape[1]
            past = commanded.as_state(more - 3 * (REFERENCE_VECTORS - STATE_VECTORS)).flat()
        else:
            past = self.states[np.maximum(self.now[which, None] + back, self.first[which, None])]
        future = self.ahead[which, None] + np.arange(options.ahead)
        return seen(past, self.references[future], options.use_state)

    def of(self, keep: Callable[[dict[str, Any]], bool]) -> Integers:
        """Windows of the episodes that a rule keeps."""
        wanted = np.array([keep(row) for row in self.episodes], dtype=np.bool_)
        return np.flatnonzero(wanted[self.episode])

    def of_split(self, split: str) -> Integers:
        """Windows of a split, mirrored episodes aside."""
        return self.of(lambda row: row["split"] == split and not row["mirrored"])

    def check_falls(self, which: Integers, folder: Path, words: str) -> None:
        """Makes sure that some windows have a fall and some have none.

        Args:
            which: The windows.
            folder: Of the data set.
            words: What the windows are, for the message.

        Raises:
            ResultError: All of them are of one kind.
        """
        falls = int(self.fall[which].sum())
        if falls == 0 or falls == len(which):
            raise ResultError(
                f"{folder}: of {len(which)} windows {words}, {falls} have a fall; "
                "some must and some must not: execute more commands"
            )


def load_windows(
    folder: Path,
    robot: Robot,
    options: PPNOptions,
    spacing: float,
    mirror: bool = False,
    report: Callable[[int], None] | None = None,
) -> Windows:
    """Windows of all episodes of a data set; what pushes the robot later is left out.

    Args:
        folder: Of the data set; a run that is not over will do.
        robot: That it was made with.
        options: Of the network.
        spacing: Between the beginnings of an episode's windows [s].
        mirror: Whether each episode is there again with left and right exchanged.
        report: Told how many episodes are read.

    Raises:
        ResultError: There is nothing to learn from.
    """
    step = round(RECORDED / options.rate)
    every = max(1, round(spacing * options.rate))
    body, digest = Body.of(robot), hashlib.sha256()
    parts: list[dict[str, Any]] = []
    episodes: list[dict[str, Any]] = []
    states = references = 0
    for episode in _all_episodes(folder, Mirror(robot) if mirror else None):
        made = _windows(episode, body, options, step, every)
        if not episode.about["mirrored"]:
            digest.update(f"{episode.about['episode']} {episode.about['seed']} ".encode())
        if len(made["now"]):
            made["episode"] = np.full(len(made["now"]), len(episodes))
            made["first"] = np.full(len(made["now"]), states)
            made["now"] += states
            made["ahead"] += references
            states += len(made["states"])
            references += len(made["references"])
            parts.append(made)
            episodes.append(episode.about)
        if report is not None:
            report(len(episodes))
    if not parts:
        raise ResultError(f"{folder} holds no execution of {options.horizon:g} s to learn from")
    joined: dict[str, Any] = {
        name: (torch.cat if isinstance(first, Tensor) else np.concatenate)(
            [part[name] for part in parts]
        )
        for name, first in parts[0].items()
    }
    return Windows(**joined, episodes=episodes, fingerprint=digest.hexdigest()[:16])


def _all_episodes(folder: Path, mirror: Mirror | None) -> Iterator[Episode]:
    """Those on disk, each told whether it is ``mirrored``."""
    for episode in read_episodes_of(folder):
        yield episode._replace(about=episode.about | {"mirrored": False})
        if mirror is not None:
            time, q, v, q_raw, v_raw = episode.track
            yield Episode(
                episode.about | {"mirrored": True},
                Track(
                    time, mirror.positions(q), mirror.rates(v),
                    mirror.positions(q_raw), mirror.rates(v_raw),
                ),
                mirror.positions(episode.raw_q),
                mirror.contacts(episode.raw_contact),
            )  # fmt: skip


def executed(folder: Path) -> Iterator[tuple[Shard, pa.Table]]:
    """Shards of a data set with their episodes, without those that were not executed.

    Raises:
        ResultError: It was made before episodes held their kinematic reference.
    """
    for shard, table in read_shards(folder):
        if "raw_q" not in table.column_names:
            raise ResultError(f"{shard.episodes} has no column raw_q; make the data set anew")
        rows = table.filter(pc.greater(table["frames"], 1))
        if len(rows):
            yield shard, rows


def take_reference(about: dict[str, Any]) -> tuple[Array, Array]:
    """Takes the kinematic reference (R, 30), (R, 2, 4) at 60 Hz out of an episode's row."""
    contact = np.array(about.pop("raw_contact"), dtype=np.float64).reshape(-1, 2, 4)
    return np.array(about.pop("raw_q"), dtype=np.float64).reshape(len(contact), -1), contact


def read_episodes_of(folder: Path) -> Iterator[Episode]:
    """All whole episodes of a data set; raises what :func:`executed` does."""
    wanted = ["episode", "time", "q", "v", "q_raw", "v_raw"]
    run: dict[str, float] = {}
    for shard, rows in executed(folder):
        frames, run = read_frames(shard, wanted), run or _run_of(folder)
        number = frames["episode"].to_numpy()
        columns = {name: rows_in_shape(frames, name) for name in wanted[1:]}
        for about in rows.to_pylist():
            where = slice(*np.searchsorted(number, [about["episode"], about["episode"] + 1]))
            track = Track(*(columns[name][where] for name in wanted[1:]))
            raw_q, raw_contact = take_reference(about)
            yield Episode(about | run, track, raw_q, raw_contact)


def _run_of(folder: Path) -> dict[str, float]:
    """How long the last pose of executions is held, and where they are cut off [s]."""
    told = description(folder)
    try:
        return {
            "hold_s": told["scenario"]["simulation"]["hold"],
            "longest_s": told["options"]["longest"],
        }
    except KeyError as error:
        raise ResultError(
            f"{folder}/dataset.json: does not tell how long executions last: {error!r}"
        ) from error


def _windows(
    episode: Episode, body: Body, options: PPNOptions, step: int, every: int
) -> dict[str, Any]:
    """States, references and windows of one episode, rows counted from its own first."""
    about, track = episode.about, episode.track
    pushes = [about["push_time_s"]] if about["push_time_s"] is not None else []
    fall = about["fall_time_s"] if about["fell"] else None
    end = min(about["motion_end_s"] + about["hold_s"], about["longest_s"])
    labels = label_windows(track, options.horizon, fall, pushes, end)
    keep = labels.foreseeable & (labels.start % (step * every) == 0)
    labels = Labels(*(part[keep] for part in labels))
    q, v = (torch.from_numpy(np.ascontiguousarray(x[::step], np.float64)) for x in track[1:3])
    before, count = options.back - 1, len(q) + options.ahead
    time = np.arange(-PAD - before, count + PAD) / options.rate - about["lead_s"]
    rows = rows_at(time, len(episode.raw_q))
    asked_q, contact = (
        torch.from_numpy(part[at])
        for part, at in ((episode.raw_q, rows), (episode.raw_contact, rows[PAD:-PAD]))
    )
    asked = reference_frames(body, asked_q, contact, step / RECORDED)
    return {
        "states": state_frames(body, q, v).flat().float(),
        "references": asked.flat().float(),
        "now": labels.start // step,
        "ahead": labels.start // step + before,
        "fall": torch.from_numpy(labels.fall),
        "time_to_fall": torch.from_numpy(labels.time_to_fall).float(),
        "pushed": labels.start >= min(pushes, default=np.inf) * RECORDED,
        "errors": torch.from_numpy(np.log(np.maximum(labels.errors, _LEAST_ERROR))).float(),
    }

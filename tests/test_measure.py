"""Text to motion measured by one command: figures, page and contact sheet."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from robomirror_drake.cli import app
from robomirror_drake.exceptions import ConfigError, InputError
from robomirror_drake.measure.measure import (
    MeasureOptions,
    make_pools,
    measure,
    quality,
    sheet_texts,
)
from robomirror_drake.messages import HumanMotion
from robomirror_drake.motion.mocap import load_clip
from robomirror_drake.motion.text import parse
from robomirror_drake.report.motion_strips import MOMENTS, strip

ROWS = """
- [a person bows, bow]
- [the man waves with the left hand, wave left]
- [a person bows twice, bow]
- [someone plays the violin, wave]
"""


@pytest.fixture(scope="module")
def sentences(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("measure") / "sentences.yaml"
    path.write_text(ROWS)
    return path


def test_the_contact_sheet_spreads_over_all_that_commands_may_say() -> None:
    texts = sheet_texts()
    read = [parse(text) for text in texts]
    groups = [clauses[0].group for clauses in read]
    assert len(set(texts)) == 24
    assert {group: groups.count(group) for group in set(groups)} == dict.fromkeys(
        ("locomotion", "dynamic", "expressive"), 8
    )
    followers = [clause for clauses in read for clause in clauses[1:]]
    assert sum(clause.accompanies for clause in followers) >= 3
    assert sum(not clause.accompanies for clause in followers) >= 5


def test_one_command_writes_figures_and_a_page(sentences: Path, tmp_path: Path) -> None:
    page, file = tmp_path / "m.html", tmp_path / "m.json"
    arguments = ["generator", "measure", "--sentences", str(sentences), "--candidates", "4"]
    arguments += ["--sources", "composer", "--json", str(file), "--html", str(page)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    found = json.loads(file.read_text())
    assert (found["intent"]["right"], found["intent"]["sentences"]) == (2, 4)
    assert found["intent"]["refused"] == 1
    composer = found["sources"]["composer"]
    assert composer["refused"] == ["someone plays the violin"]
    assert 0.0 < composer["multimodality"]["mean"] < composer["diversity"]["mean"] < 2.0
    assert composer["time"]["median_s"] > 0.0
    assert composer["quality"]["bone_drift_percent"]["worst"] < 1e-6
    assert found["clips"]["quality"]["stance_drift_mm"]["median"] > 0.0
    text = page.read_text()
    assert text.count("<svg") == 24 * 4
    assert not re.search(r'(?:src|href)="|url\(|@import', text)  # needs nothing from elsewhere


def test_figures_are_the_same_every_time_but_for_the_clock(sentences: Path) -> None:
    options = MeasureOptions(sentences=str(sentences), candidates=4, sources=("learned",))
    runs = []
    for _ in range(2):
        figures, _ = measure(options)
        figures["sources"]["learned"].pop("time")
        runs.append(figures)
    assert runs[0] == runs[1]


def test_pools_tell_what_they_refuse(sentences: Path) -> None:
    told: list[tuple[int, int]] = []
    pools, refused = make_pools(
        ["a person bows", "someone plays the violin"],
        "composer",
        MeasureOptions(sentences=str(sentences), candidates=4),
        lambda _, done, total: told.append((done, total)),
    )
    assert [pool.text for pool in pools] == ["a person bows"]
    assert refused == ["someone plays the violin"]
    assert told == [(1, 2), (2, 2)]
    assert len(pools[0].motions) == 4
    assert pools[0].core_s > 0.0


def test_quality_names_the_worst() -> None:
    clips = [load_clip(name) for name in ("walk", "kick", "turn_left0")]
    assert quality(clips)["peak_acceleration_m_s2"]["worst_is"] == "pybullet:kick"


@pytest.mark.parametrize(
    "arguments",
    [("--texts", "1"), ("--candidates", "2"), ("--sources", "oracle"), ("--sources", "")],
)
def test_bad_settings_are_refused(arguments: tuple[str, ...]) -> None:
    done = CliRunner().invoke(app, ["generator", "measure", *arguments])
    assert isinstance(done.exception, ConfigError)


def test_missing_sentences_are_refused(tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app, ["generator", "measure", "--sentences", str(tmp_path / "nonesuch.yaml")]
    )
    assert isinstance(done.exception, InputError)
    assert "nonesuch.yaml" in str(done.exception)


def test_a_strip_draws_the_body_on_the_floor_and_its_way() -> None:
    motion = load_clip("walk_forward")
    drawing = str(strip(motion))
    assert drawing.count("<circle") == MOMENTS
    floor = float(re.search(r'class="floor" d="M0 ([\d.]+)H', drawing)[1])  # type: ignore[index]
    legs = re.findall(r'class="[lr]" d="M([^"]+)"', drawing)
    lowest = max(float(point.split()[1]) for leg in legs for point in leg.split("L"))
    assert floor - 5.0 < lowest < floor + 1.0
    width = float(re.search(r'viewBox="0 0 ([\d.]+)', drawing)[1])  # type: ignore[index]
    numbers = [float(x) for x in re.findall(r"[ML](-?[\d.]+) ", drawing)]
    assert 0.0 <= min(numbers) <= max(numbers) <= width


def test_a_strip_leaves_out_the_rests() -> None:
    walk = load_clip("walk_forward")
    still = np.repeat(walk.positions[:1], 300, axis=0)
    padded = HumanMotion(np.concatenate([still, walk.positions]), walk.fps)
    times = re.findall(r">([\d.]+) s<", str(strip(padded)))
    assert float(times[0]) >= 299 / walk.fps - 0.1

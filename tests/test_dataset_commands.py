"""``robomirror dataset`` at the prompt."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from robomirror_drake import cli

UNKNOWN = "the stock market fell\nparliament adjourned the debate\n"


def robomirror(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["robomirror", *arguments])
    with pytest.raises(SystemExit) as stopped:
        cli.main()
    return int(stopped.value.code or 0)


def test_a_data_set_of_failures_is_made_and_told(monkeypatch, capsys, tmp_path):
    (tmp_path / "p.txt").write_text(UNKNOWN)
    folder, figures = tmp_path / "data", tmp_path / "info.json"
    arguments = (
        "dataset", "generate", "--prompts", str(tmp_path / "p.txt"), "--out", str(folder),
        "--per-prompt", "2", "--executions", "2", "--workers", "0",
    )  # fmt: skip
    for _ in range(2):
        assert robomirror(monkeypatch, *arguments) == 0
        assert "8 episodes" in capsys.readouterr().out
    assert robomirror(monkeypatch, "dataset", "info", str(folder), "--json", str(figures)) == 0
    printed = capsys.readouterr().out
    assert "4 failed: generate: UnknownCommandError" in printed
    told = json.loads(figures.read_text())
    assert (told["prompts"], told["total"]["failed"]) == (2, 8)
    changed = [*arguments[:-4], "--executions", "3", "--workers", "0"]
    assert robomirror(monkeypatch, *changed) == 2
    assert "options.executions is 2 there and 3 here" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("generate", "--out", "d", "--prompts", "nonesuch"), "no prompts 'nonesuch'"),
        (("generate", "--out", "d", "--prompts", "p.txt", "--per-prompt", "0"), "per_prompt"),
        (("generate", "--out", "p.txt", "--prompts", "p.txt", "--workers", "0"), "p.txt"),
        (("generate", "--out", "d", "--prompts", "p.txt", "--limit", "0"), "limit"),
        (("generate", "--prompts", "p.txt"), "out"),
        (("generate", "--out", "d", "--prompts", "p.txt", "--settings", "q.yaml"), "push_sped"),
        (("info", "nowhere"), "nowhere is no data set"),
        (("prompts", "--out", "p.txt/corpus.csv"), "is no folder"),
    ],
)
def test_bad_input_exits_2_with_a_reason(monkeypatch, capsys, tmp_path, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("p.txt").write_text(UNKNOWN)
    Path("q.yaml").write_text("push_sped: [0.1, 0.2]")
    assert robomirror(monkeypatch, "dataset", *arguments) == 2
    printed = capsys.readouterr()
    assert message in " ".join((printed.err + printed.out).split())
    assert "Traceback" not in printed.err

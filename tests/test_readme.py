"""What the README tells a reader to type has to work."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robomirror_drake.cli import app

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_diagram_example_runs(capsys):
    (example,) = re.findall(r"```python\n(from pydrake.*?)```", README, flags=re.DOTALL)
    exec(compile(example, "README.md", "exec"), {})
    assert len(capsys.readouterr().out.splitlines()) == 4


def test_every_command_of_the_readme_exists():
    known = {command.name or command.callback.__name__ for command in app.registered_commands}
    groups = {group.name for group in app.registered_groups}
    used = set(re.findall(r"^robomirror (\w+)", README, flags=re.MULTILINE))
    assert used
    assert used <= known | groups


@pytest.mark.parametrize("target", sorted(set(re.findall(r"^make ([\w-]+)", README, re.MULTILINE))))
def test_every_make_target_of_the_readme_exists(target):
    makefile = (Path(__file__).parents[1] / "Makefile").read_text(encoding="utf-8")
    assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE)

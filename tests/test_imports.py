"""Imports inside the package point one way, and the root folders cannot be imported bare."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "robomirror_drake"

# Lowest first: a module may import from its own layer and from those below it.
LAYERS: tuple[tuple[str, ...], ...] = (
    ("messages", "exceptions", "assets"),
    ("yaml_file", "checkpoint", "tables"),
    ("robot_spec", "urdf", "robot", "optimization", "motion", "outcome", "ppn"),
    ("disturbance",),
    ("disturbance_draw",),
    ("goals",),
    ("adaptation",),
    ("systems", "plant"),
    ("simulation", "fall_signs"),
    ("config", "fall_cause"),
    ("pipeline", "rollout"),
    ("closed_loop", "comparison", "differences", "results"),
    ("report", "playback"),
    ("run",),
    ("dataset",),
    ("learning",),
    ("study",),
    ("bench", "survey", "measure"),
    ("commands",),
    ("cli",),
    ("__main__",),
)
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}


def _modules() -> dict[str, Path]:
    """Dotted name below the package -> file, for every module of the package."""
    folders = [PACKAGE, ROOT / "systems", ROOT / "optimization"]
    files = {path for folder in folders for path in folder.rglob("*.py")}
    return {".".join(path.relative_to(_home(path)).with_suffix("").parts): path for path in files}


def _home(path: Path) -> Path:
    return PACKAGE if path.is_relative_to(PACKAGE) else ROOT


def _imported(path: Path) -> set[str]:
    """Every absolute module name that a file imports, also inside functions."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import in line {node.lineno}"
            module = node.module or ""
            names.add(module)
            names.update(f"{module}.{alias.name}" for alias in node.names)
    return names


def test_imports_point_one_way() -> None:
    wrong = []
    for name, path in _modules().items():
        top = name.split(".")[0]
        if top == "__init__":
            continue
        assert top in LEVEL, f"{path} is in no layer; add it to LAYERS"
        for imported in _imported(path):
            parts = imported.split(".")
            if parts[0] != "robomirror_drake" or len(parts) < 2 or parts[1] not in LEVEL:
                continue
            if LEVEL[parts[1]] > LEVEL[top]:
                wrong.append(f"{name} imports {imported}")
    assert not wrong, "\n".join(sorted(wrong))


def test_optimization_knows_no_systems() -> None:
    wrong = [
        f"{name} imports {imported}"
        for name, path in _modules().items()
        if name.split(".")[0] == "optimization"
        for imported in _imported(path)
        if imported.startswith("pydrake.systems")
    ]
    assert not wrong, "\n".join(wrong)


def test_library_imports_no_pydrake_all_and_no_bare_root_folder() -> None:
    bare = {"systems", "optimization", "assets", "pydrake.all"}
    wrong = [
        f"{name} imports {imported}"
        for name, path in _modules().items()
        for imported in _imported(path)
        if imported in bare or imported.split(".")[0] in bare
    ]
    assert not wrong, "\n".join(wrong)


def test_every_import_is_declared() -> None:
    """What the package imports comes with Python or is named in pyproject.toml."""

    def canonical(name: str) -> str:
        return re.sub(r"[-_.]+", "-", re.split(r"[<>=!~;\[ ]", name)[0]).lower()

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["dependencies"] + project["optional-dependencies"]["bench"]
    declared = {canonical(name) for name in wanted}
    providers = {**packages_distributions(), "pinocchio": ["pin"]}  # installed beside the path
    missing = set()
    for name, path in _modules().items():
        for top in {imported.split(".")[0] for imported in _imported(path)}:
            if top in sys.stdlib_module_names or top == "robomirror_drake":
                continue
            if not declared & {canonical(d) for d in providers.get(top, [top])}:
                missing.add(f"{name} imports {top}")
    assert not missing, "\n".join(sorted(missing))


@pytest.mark.parametrize("name", ["systems", "optimization", "assets"])
def test_root_folder_refuses_its_short_name(name: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", f"import {name}"], cwd=ROOT, capture_output=True, text=True
    )
    assert run.returncode != 0
    assert f"import this package as robomirror_drake.{name}" in run.stderr


def test_symlinks_lead_to_the_root_folders() -> None:
    for name in ("systems", "optimization", "assets"):
        module = importlib.import_module(f"robomirror_drake.{name}")
        assert module.__file__ is not None
        assert Path(module.__file__).resolve() == ROOT / name / "__init__.py"

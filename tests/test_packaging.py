"""sdist -> wheel -> a fresh environment outside the repository."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import tarfile
import venv
import zipfile
from collections import Counter
from pathlib import Path

import pytest

pytestmark = pytest.mark.packaging

ROOT = Path(__file__).parents[1]
IN_PACKAGE = ("systems/", "optimization/", "assets/")


def _run(*command: str | Path, cwd: Path) -> str:
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The sdist of a clean export of the working tree, and the wheel built from that sdist."""
    work = tmp_path_factory.mktemp("dist")
    source = work / "source"
    tracked = _run("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", cwd=ROOT)
    for name in filter(None, tracked.split("\0")):
        origin, copy = ROOT / name, source / name
        if not origin.exists():
            continue
        copy.parent.mkdir(parents=True, exist_ok=True)
        if origin.is_symlink():
            copy.symlink_to(origin.readlink())
        else:
            copy.write_bytes(origin.read_bytes())
    _run(sys.executable, "-m", "build", "--outdir", work, source, cwd=work)
    (sdist,), (wheel,) = work.glob("*.tar.gz"), work.glob("*.whl")
    return sdist, wheel


@pytest.fixture(scope="module")
def python(distributions: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An interpreter that sees the wheel, and the dependencies but not the editable install.

    A .pth file adds the outer site-packages as a plain folder, so that its own .pth
    files, the editable install's among them, are not read. Only Pinocchio's folder,
    which is reached through such a file, is added by name.
    """
    home = tmp_path_factory.mktemp("fresh") / "venv"
    venv.create(home, with_pip=False)
    inner = home / "lib" / f"python{sysconfig.get_python_version()}" / "site-packages"
    outer = Path(sysconfig.get_paths()["purelib"])
    cmeel = [path for path in map(Path, sys.path) if "cmeel.prefix" in path.parts]
    assert cmeel, "Pinocchio's folder is not on the path"
    (inner / "dependencies.pth").write_text("\n".join(map(str, [outer, *cmeel])) + "\n")
    interpreter = home / "bin" / "python"
    _run(
        *(sys.executable, "-m", "pip", "--python", interpreter, "install"),
        *("--no-deps", "--no-index", "--force-reinstall", distributions[1]),
        cwd=home,
    )
    return interpreter


def _packaged_sources() -> set[str]:
    """Where the wheel must hold each file that belongs to the package."""
    listed = _run("git", "ls-files", "--cached", "--others", "--exclude-standard", cwd=ROOT)
    names = {name for name in listed.splitlines() if (ROOT / name).is_file()}
    inside = {name for name in names if name.startswith("robomirror_drake/")}
    linked = {f"robomirror_drake/{name}" for name in names if name.startswith(IN_PACKAGE)}
    return inside | linked


def test_wheel_holds_every_file_once(distributions: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(distributions[1]) as wheel:
        names = Counter(wheel.namelist())
    files = {name for name in names if ".dist-info/" not in name}
    assert max(names.values()) == 1
    assert files == _packaged_sources()


def test_sdist_holds_every_file_once(distributions: tuple[Path, Path]) -> None:
    with tarfile.open(distributions[0]) as sdist:
        members = [member for member in sdist.getmembers() if not member.isdir()]
    assert all(member.isfile() for member in members), "the sdist holds links"
    names = Counter(member.name.split("/", 1)[1] for member in members)
    assert max(names.values()) == 1
    assert _packaged_sources() <= set(names)
    assert {"LICENSE", "README.md", "pyproject.toml"} <= set(names)
    assert not any(name.startswith(IN_PACKAGE) for name in names)


def test_every_module_imports_from_the_wheel(python: Path) -> None:
    program = """
import importlib, pkgutil, sys
import robomirror_drake
assert robomirror_drake.__file__.startswith(sys.prefix), robomirror_drake.__file__
names = [m.name for m in pkgutil.walk_packages(robomirror_drake.__path__, "robomirror_drake.")]
for name in names:
    if name.endswith("__main__"):
        continue
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in ("mink", "mujoco"):  # of the bench extra
            raise
print(*names)
"""
    names = _run(python, "-I", "-c", program, cwd=python.parent).split()
    modules = {name for name in _packaged_sources() if name.endswith(".py")}
    assert len(names) == len(modules) - 1  # all but the package's own __init__


def test_assets_open_from_the_wheel(python: Path) -> None:
    program = """
import sys
from importlib.resources import files
text = (files("robomirror_drake.assets") / "LICENSES.md").read_text(encoding="utf-8")
assert text.startswith("#"), text[:80]
"""
    _run(python, "-I", "-c", program, cwd=python.parent)


@pytest.mark.parametrize("name", ["systems", "optimization", "assets"])
def test_root_folders_are_not_installed_under_their_short_names(python: Path, name: str) -> None:
    done = subprocess.run([python, "-I", "-c", f"import {name}"], capture_output=True, text=True)
    assert "ModuleNotFoundError" in done.stderr


def test_console_script_starts(python: Path) -> None:
    assert "Usage" in _run(python.parent / "robomirror", "--help", cwd=python.parent)

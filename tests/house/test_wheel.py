"""The wheel is whole: one package with its data files, and it works where there is no checkout."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

from tests.house.source import ROOT

FOLDERS = ("app", "engine", "widgets", "assets", "docs/guide")
FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "NOTICE")


def run(*command: object, cwd: Path, **variables: str) -> str:
    """What a command says; it must succeed. It sees no package but those that are installed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | variables
    result = subprocess.run([*map(str, command)], cwd=cwd, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """A wheel, built from a copy of the project: setuptools leaves its `build` and `.egg-info` beside what it builds."""
    copy = tmp_path_factory.mktemp("source")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, copy)
    run(sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", "dist", ".", cwd=copy)
    [path] = (copy / "dist").glob("*.whl")
    return path


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory) -> Path:
    """The interpreter of an environment in which the wheel alone is installed.

    What it depends on is read from this environment's folder of packages, which a `.pth` file adds; `.pth` files inside an added folder are
    not read, so the finder of an editable install does not come along.
    """
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True, symlinks=os.name != "nt")
    scripts, packages = (Path(sysconfig.get_path(name, "venv", {"base": str(folder)})) for name in ("scripts", "purelib"))
    program = scripts / f"python{sysconfig.get_config_var('EXE') or ''}"
    run(program, "-m", "pip", "install", "--no-deps", "--no-index", wheel, cwd=folder)
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return program


def test_it_holds_one_package_with_every_file(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
        [installed] = (archive.read(name).decode() for name in names if name.endswith(".dist-info/top_level.txt"))
    assert installed.split() == ["degense"]
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"degense"}
    here = {
        f"degense/{path.relative_to(ROOT).as_posix()}"
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.name.startswith(".")
    }
    assert {name for name in names if name.startswith("degense/")} == here


@pytest.mark.timeout(900)  # numba compiles everything anew there
def test_the_demo_and_the_diagnostics_run_without_a_checkout(python, own_folders, tmp_path):
    degense = python.with_name(f"degense{python.suffix}")
    assert "Nothing is missing." in run(degense, "doctor", cwd=tmp_path)
    code = """
        import sys
        from degense.app.cli.main import main

        status = main(["demo", "--headless", "out"])
        print(*(getattr(module, "__file__", None) for name, module in sys.modules.items() if name.split(".")[0] == "degense"), sep="\\n")
        sys.exit(status)
    """
    said = run(python, "-c", "\n".join(line.strip() for line in code.splitlines()), cwd=tmp_path)
    sources = {line for line in said.splitlines() if line.endswith(".py")}
    assert len(sources) > 50
    assert not [source for source in sources if not Path(source).is_relative_to(python.parents[1])]
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {"rgb.png", "mask_gallbladder.png", "displacement.png", "warp.png"}

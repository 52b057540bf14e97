"""A cache of compiled kernels that a power cut or a bad disk damaged is made anew."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numba
import pytest

import degense.engine.threads
from tests.house.source import imports, modules

CODE = "from numba import njit\n\n\n@njit(cache=True)\ndef twice(x):\n    return 2 * x\n"


def computed(file: Path) -> int:
    """The kernel's answer, in a module that is loaded anew."""
    spec = importlib.util.spec_from_file_location("kernel", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["kernel"] = module
    try:
        spec.loader.exec_module(module)
        return int(module.twice(21))
    finally:
        del sys.modules["kernel"]


@pytest.mark.parametrize("damage", [b"", b"\x80", b"noise" * 50])
@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc"])
def test_damaged_files_are_written_anew(tmp_path, monkeypatch, damage, kind):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "kernel.py").write_text(CODE)
    assert computed(tmp_path / "kernel.py") == 42
    [file] = (tmp_path / "cache").rglob(kind)
    whole = len(file.read_bytes())
    file.write_bytes(damage)
    assert computed(tmp_path / "kernel.py") == 42
    assert len(file.read_bytes()) >= whole // 2  # it is kept again
    assert computed(tmp_path / "kernel.py") == 42


def test_where_nothing_can_be_kept_kernels_are_compiled(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").touch()
    (tmp_path / "__pycache__").touch()
    (tmp_path / "kernel.py").write_text(CODE)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "file/cache"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    degense.engine.threads._say_once.cache_clear()
    assert computed(tmp_path / "kernel.py") == 42
    assert "NUMBA_CACHE_DIR" in caplog.text


def test_all_files_with_kernels_are_patient():
    for path in modules("engine"):
        names = {name for _, name in imports(path)}
        assert "numba.njit" not in names or any(name.startswith("degense.engine.threads") for name in names), path

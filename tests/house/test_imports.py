"""Imports go one way: app → widgets, engine; widgets → the engine's value types; engine → neither."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.house.source import imports, modules, within

GUI = ("PySide6", "shiboken6", "qtpy", "PyQt5", "PyQt6", "pyvista", "pyvistaqt", "vtk", "vtkmodules")
VALUE_TYPES = ("engine.camera", "engine.splats", "engine.errors", "engine.progress", "engine.colour_maps")


def refused(path: Path, name: str) -> bool:
    """Whether a file may not import this name."""
    match path.parts[0]:
        case "engine":
            return within(name, (*GUI, "app", "widgets", "tests"))
        case "widgets":
            return within(name, ("app", "tests")) or (within(name, ("engine",)) and not within(name, VALUE_TYPES))
        case "app":
            return within(name, ("tests",))
    return False


@pytest.mark.parametrize("package", ["engine", "widgets", "app"])
def test_imports_go_one_way(package):
    wrong = [f"{path}:{line} imports {name}" for path in modules(package) for line, name in imports(path) if refused(path, name)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("path", "name", "expected"),
    [
        ("engine/layers/registry.py", "PySide6.QtGui", True),
        ("engine/clip.py", "app.session", True),
        ("engine/clip.py", "vtkmodules.vtkCommonCore", True),
        ("engine/clip.py", "engine.camera", False),
        ("engine/clip.py", "application", False),
        ("widgets/theme.py", "app.settings", True),
        ("widgets/theme.py", "engine.scene.Scene", True),
        ("widgets/theme.py", "engine.camera.Camera", False),
        ("app/window/main.py", "engine.scene", False),
        ("app/window/main.py", "tests.fakes", True),
    ],
)
def test_the_rule_itself(path, name, expected):
    assert refused(Path(path), name) is expected


def test_no_module_is_called_utils():
    assert not [path for path in modules("engine", "widgets", "app") if path.stem in ("utils", "util", "helpers", "common", "misc")]

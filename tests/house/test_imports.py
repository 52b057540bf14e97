"""Imports go one way: app → widgets, engine; widgets → the engine's value types; engine → neither."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.house.source import imports, modules, within

GUI = ("PySide6", "shiboken6", "qtpy", "PyQt5", "PyQt6", "pyvista", "pyvistaqt", "vtk", "vtkmodules")
VALUE_TYPES = (
    "degense.engine.camera",
    "degense.engine.splats",
    "degense.engine.errors",
    "degense.engine.progress",
    "degense.engine.colour_maps",
)


def refused(path: Path, name: str) -> bool:
    """Whether a file may not import this name."""
    match path.parts[0]:
        case "engine":
            return within(name, (*GUI, "degense.app", "degense.widgets", "tests"))
        case "widgets":
            return within(name, ("degense.app", "tests")) or (within(name, ("degense.engine",)) and not within(name, VALUE_TYPES))
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
        ("engine/clip.py", "degense.app.session.session", True),
        ("engine/clip.py", "vtkmodules.vtkCommonCore", True),
        ("engine/clip.py", "degense.engine.camera", False),
        ("engine/clip.py", "application", False),
        ("widgets/theme.py", "degense.app.shell.settings", True),
        ("widgets/theme.py", "degense.engine.scene.Scene", True),
        ("widgets/theme.py", "degense.engine.camera.Camera", False),
        ("app/shell/main_window.py", "degense.engine.scene", False),
        ("app/shell/main_window.py", "tests.fakes", True),
    ],
)
def test_the_rule_itself(path, name, expected):
    assert refused(Path(path), name) is expected


def test_no_module_is_called_utils():
    assert not [path for path in modules("engine", "widgets", "app") if path.stem in ("utils", "util", "helpers", "common", "misc")]

"""The shape of the tree: arrows between rooms go one way, without circles, and no folder, file or function outgrows its reader.

The rooms of a folder are the files and subfolders in it; an arrow goes from the room that imports to the room that is imported.
"""

from __future__ import annotations

import ast
from collections import Counter, defaultdict
from collections.abc import Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.house.source import ROOT, imports, modules

PRODUCT = ("app", "engine", "widgets")
MOST_FILES, MOST_LINES, LONGEST_FUNCTION = 15, 300, 60

#: Rooms in their order: each may import the ones before it. Files that lie in `engine` itself are value types and come before all of these.
ORDERS = {
    "engine": (
        "processes",
        "vocabulary",
        "motion",
        "data",
        "raster",
        "field",
        "semantics",
        "store",
        "training",
        "scene",
        "archive",
        "layers",
        "metrics",
        "annotation",
        "research",
    ),
    "app": ("session", "shell", "features", "batch", "application.py", "cli"),
}


def files() -> dict[str, Path]:
    """Every module of the product by its dotted name, a package by the name of its folder."""
    found = {}
    for path in modules(*PRODUCT):
        parts = ("degense", *path.with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def arrows(by_name: bool = True) -> set[tuple[Path, Path]]:
    """(importing file, imported file) of the product; `by_name`: with those that `import_module` loads."""
    known, found = files(), set()
    for path in known.values():
        for _, name in imports(path, by_name):
            while name and name not in known:
                name = name.rpartition(".")[0]
            if name and known[name] != path:
                found.add((path, known[name]))
    return found


def rooms(folder: Path, inside: set[tuple[Path, Path]]) -> dict[str, set[str]]:
    """For each room of a folder, those that it imports; the folder's own `__init__` is a sign on the door, not a room."""
    depth = len(folder.parts)
    found: dict[str, set[str]] = defaultdict(set)
    for a, b in inside:
        if folder in a.parents and folder in b.parents and folder / "__init__.py" not in (a, b) and a.parts[depth] != b.parts[depth]:
            found[a.parts[depth]].add(b.parts[depth])
    return found


def circle(graph: dict[str, set[str]]) -> list[str] | None:
    """A circle of a graph, or None."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return None


def report(found: Mapping[str, object]) -> str:
    """What breaks a rule, one a line."""
    return "\n".join(f"{name} ({why})" for name, why in sorted(found.items()))


def test_no_circle_between_the_rooms_of_a_folder():
    every = arrows()
    folders = {folder for pair in every for path in pair for folder in path.parents}
    wrong = report({f"circle:{folder.as_posix()}": " ← ".join(ring) for folder in folders if (ring := circle(rooms(folder, every)))})
    assert not wrong, wrong


def test_every_folder_of_the_engine_has_a_place_in_the_order():
    assert {path.name for path in (ROOT / "engine").iterdir() if path.is_dir() and path.name != "__pycache__"} == {*ORDERS["engine"]}


@pytest.mark.parametrize("folder", ORDERS)
def test_no_arrow_upwards(folder):
    place = {room: index for index, room in enumerate(ORDERS[folder])}
    loose = -1 if folder == "engine" else len(place)
    graph = rooms(Path(folder), arrows())
    wrong = report(
        {f"{folder}/{a}->{folder}/{b}": "upwards" for a in graph for b in graph[a] if b in place and place.get(a, loose) < place[b]}
    )
    assert not wrong, wrong


def test_the_product_does_not_need_research():
    """Only programs that measure import it; commands load it by name, when they are called."""
    measuring = ("engine/research", "app/research")
    wrong = report(
        {
            f"{a.as_posix()}->{b.as_posix()}": "research"
            for a, b in arrows(by_name=False)
            if b.is_relative_to("engine/research") and not any(a.is_relative_to(folder) for folder in measuring)
        }
    )
    assert not wrong, wrong


def test_no_file_imports_what_its_own_folder_offers():
    """A package's `__init__` takes what it offers from its files: one of them that imports it back closes a circle."""
    every = arrows()
    offering = {a.parent for a, b in every if a.name == "__init__.py" and a.parent in b.parents}
    wrong = report(
        {
            f"{a.as_posix()}->{b.as_posix()}": "name the module instead"
            for a, b in every
            if b.name == "__init__.py" and b.parent in offering and b.parent in a.parents
        }
    )
    assert not wrong, wrong


def test_no_folder_holds_too_many_files():
    count = Counter(path.parent.as_posix() for path in modules(*PRODUCT, "tests") if path.name != "__init__.py")
    wrong = report({folder: number for folder, number in count.items() if number > MOST_FILES})
    assert not wrong, wrong


def test_no_file_is_too_long():
    count = {path.as_posix(): len((ROOT / path).read_text(encoding="utf-8").splitlines()) for path in modules(*PRODUCT, "tests")}
    wrong = report({path: number for path, number in count.items() if number > MOST_LINES})
    assert not wrong, wrong


def test_no_function_is_too_long():
    functions = (
        (f"{path.as_posix()}:{node.name}", (node.end_lineno or 0) - node.lineno + 1)
        for path in modules(*PRODUCT, "tests")
        for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )
    wrong = report({name: number for name, number in functions if number > LONGEST_FUNCTION})
    assert not wrong, wrong


def test_the_rules_find_what_they_look_for():
    p = Path
    pairs = {(p("a/x/one.py"), p("a/y.py")), (p("a/y.py"), p("a/x/two.py")), (p("a/__init__.py"), p("a/y.py")), (p("a/y.py"), p("b/z.py"))}
    assert rooms(p("a"), pairs) == {"x": {"y.py"}, "y.py": {"x"}}
    assert rooms(p("a/x"), pairs) == {}
    assert circle(rooms(p("a"), pairs))
    assert not circle(rooms(p(), pairs))

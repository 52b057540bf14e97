"""The project's own files, as the checks of the house read them."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CODE = ("engine", "widgets", "app", "tests")
TEXT_SUFFIXES = {".py", ".md", ".toml", ".txt", ".json", ".yml", ".yaml", ".cfg", ".sh", ".svg", ".html", ""}


def modules(*packages: str) -> list[Path]:
    """Python files of top-level packages, relative to the project."""
    return sorted(path.relative_to(ROOT) for package in packages for path in (ROOT / package).rglob("*.py"))


def texts() -> list[Path]:
    """Every text file that belongs to the project: of the code, the documents and the scripts, and the loose files beside them."""
    folders = [ROOT / name for name in (*CODE, "docs", "scripts", "assets", ".ci")]
    files = [path for folder in folders for path in folder.rglob("*")] + [path for path in ROOT.iterdir() if path.name != ".git"]
    return sorted(path for path in files if path.is_file() and path.suffix in TEXT_SUFFIXES and "__pycache__" not in path.parts)


def imports(path: Path, by_name: bool = True) -> Iterator[tuple[int, str]]:
    """(line, absolute name) of everything that a file of the project imports, wherever in it the import stands.

    `from a import b` gives `a.b`, for b may be a module. A string that `import_module` is called with counts as an import, unless
    `by_name` is false.
    """
    for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8"), str(path))):
        match node:
            case ast.Import(names=names):
                yield from ((node.lineno, name.name) for name in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                package = list(path.parent.parts)
                start = package[: len(package) - level + 1] if level else []
                yield from ((node.lineno, ".".join([*start, *filter(None, [module]), name.name])) for name in names)
            case ast.Call(func=ast.Attribute(attr="import_module"), args=[ast.Constant(str(name)), *_]) if by_name:
                yield node.lineno, name


def within(name: str, packages: tuple[str, ...] | set[str]) -> bool:
    """Whether a dotted name is one of these modules or lies in one."""
    return any(name == package or name.startswith(package + ".") for package in packages)

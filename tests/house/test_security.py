"""Nothing in the product reads a file as code, by what it imports and calls."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from degense.engine.data.files.surgt_case import read_yaml
from degense.engine.errors import ClipError
from tests.house.source import ROOT, imports, modules, within

PRODUCT = ("app", "engine", "widgets")
#: Modules whose reading runs what a file says.
NEVER_IMPORTED = ("pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "jsonpickle")
#: Builtins and functions that run text.
NEVER_CALLED = {"eval", "exec", "compile", "__import__", "os.system", "os.popen", "tempfile.mktemp"}
NEVER_CALLED |= {"yaml.unsafe_load", "yaml.full_load", "yaml.load_all", "yaml.unsafe_load_all", "yaml.full_load_all"}
SAFE_LOADERS = {"yaml.BaseLoader", "yaml.SafeLoader", "yaml.CSafeLoader"}
#: A loader of its own: a `SafeLoader` that also reads tuples, and makes no other object (below).
OWN_LOADERS = {("engine/data/files/surgt_case.py", "plain")}


def called(node: ast.expr) -> str:
    """The dotted name of what is called; a method of something else begins with a dot."""
    if isinstance(node, ast.Name):
        return node.id
    return f"{called(node.value)}.{node.attr}" if isinstance(node, ast.Attribute) else ""


def faults(tree: ast.Module, path: str = "") -> Iterator[tuple[int, str]]:
    """(line, what) of calls that could run what a file says."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        name, options = called(node.func), {word.arg: word.value for word in node.keywords}
        if name in NEVER_CALLED:
            yield node.lineno, name
        if name == "torch.load" and not _is(options.get("weights_only"), True):
            yield node.lineno, "torch.load without weights_only=True"
        if "allow_pickle" in options and not _is(options["allow_pickle"], False):
            yield node.lineno, "allow_pickle"
        if name == "yaml.load":
            loader = options.get("Loader", node.args[1] if len(node.args) > 1 else None)
            told = called(loader) if loader is not None else ""
            if told not in SAFE_LOADERS and (path, told) not in OWN_LOADERS:
                yield node.lineno, "yaml.load with a loader that makes objects"
        if "shell" in options and not _is(options["shell"], False):
            yield node.lineno, "a shell"


def _is(value: ast.expr | None, wanted: bool) -> bool:
    return isinstance(value, ast.Constant) and value.value is wanted


def test_nothing_that_runs_what_it_reads_is_imported():
    wrong = [f"{path}:{line} imports {name}" for path in modules(*PRODUCT) for line, name in imports(path) if within(name, NEVER_IMPORTED)]
    assert not wrong, "\n".join(wrong)


def test_nothing_that_runs_what_it_reads_is_called():
    wrong = [
        f"{path}:{line} {what}"
        for path in modules(*PRODUCT)
        for line, what in faults(ast.parse((ROOT / path).read_text(encoding="utf-8")), path.as_posix())
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("eval('1')", True),
        ("model.eval()", False),
        ("app.exec()", False),
        ("exec(text)", True),
        ("torch.load(path)", True),
        ("torch.load(path, weights_only=False)", True),
        ("torch.load(path, weights_only=True)", False),
        ("np.load(path, allow_pickle=True)", True),
        ("np.load(path, allow_pickle=flag)", True),
        ("np.load(path)", False),  # NumPy's default refuses objects
        ("yaml.load(text)", True),
        ("yaml.load(text, Loader=yaml.Loader)", True),
        ("yaml.load(text, yaml.BaseLoader)", False),
        ("subprocess.run(words, shell=True)", True),
        ("re.compile('a')", False),
    ],
)
def test_the_rule_itself(code, found):
    assert bool([*faults(ast.parse(code))]) is found


def test_the_rule_reads_all_of_the_product():
    assert {Path("engine/store/files.py"), Path("app/cli/main.py"), Path("engine/semantics/teachers/precomputed.py")} <= {
        *modules(*PRODUCT)
    }


@pytest.mark.parametrize("tag", ["object/apply:os.system [true]", "name:os.system", "module:os", "object/new:os.PathLike {}"])
def test_the_own_loader_makes_no_objects(tag, tmp_path):
    (tmp_path / "boxes.yaml").write_text(f"0: !!python/{tag}", encoding="utf-8")
    with pytest.raises(ClipError, match="without objects"):
        read_yaml(tmp_path / "boxes.yaml")


def test_the_tests_that_the_threat_model_names_exist():
    page = (ROOT / "docs" / "threat-model.md").read_text(encoding="utf-8")
    named = re.findall(r"`(tests/[\w/]+\.py)::(\w+)`", page)
    assert len(named) > 20
    missing = [f"{path}::{name}" for path, name in named if f"def {name}(" not in (ROOT / path).read_text(encoding="utf-8")]
    assert not missing
    rows = [row for row in page.splitlines() if row.startswith("| ") and not row.startswith(("| what", "|---"))]
    assert not [row for row in rows if "::" not in row]

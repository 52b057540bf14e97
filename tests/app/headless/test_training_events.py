"""Events of a training: their JSON form, that every one of them is sent and handled, and TensorBoard."""

import ast
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import get_args

import pytest

import degense.engine
from degense.app.cli.main import main
from degense.app.cli.training_events import TensorBoardEvents
from degense.app.features.train.stage_words import STAGES as TITLES
from degense.engine.errors import DegenseError
from degense.engine.events import (
    NAMES,
    STAGES,
    Done,
    Event,
    Failed,
    Preview,
    Reliability,
    Rollback,
    Stage,
    Step,
    Stopped,
    TrainingProgress,
    from_json,
    to_json,
)
from degense.engine.training import TrainConfig, train
from tests.fakes import MemoryClip

EXAMPLES = [
    Stage("load"),
    Step("flow", 0.5, "following tissue"),
    TrainingProgress(25, 100, 0.5, 21.5, 400, 3.0, 9.0, {"l1": 0.4, "ssim": 0.1}),
    TrainingProgress(25, 100),
    Reliability("This teacher contradicts itself in 22 % of what it says."),
    Preview("previews/last.png", 7),
    Rollback(100, "values stopped being numbers"),
    Done("run"),
    Stopped(0),
    Failed("The disk is full."),
]
ROOT = Path(degense.engine.__file__).parent.parent


def test_every_event_survives_the_border():
    assert {type(event) for event in EXAMPLES} == set(get_args(Event)) == set(NAMES.values())
    for event in EXAMPLES:
        assert from_json(json.loads(json.dumps(to_json(event)))) == event


@pytest.mark.parametrize(
    "data",
    [
        None,
        [],
        3,
        "stage",
        {},
        {"event": 3},
        {"event": "tea"},
        {"event": "stage"},
        {"event": "stage", "stage": 5},
        {"event": "stopped", "iteration": True},
        {"event": "stopped", "iteration": 2.5},
        {"event": "progress", "iteration": 1, "iterations": 2, "losses": {"l1": "x"}},
    ],
)
def test_what_is_no_event_of_ours_is_none(data):
    assert from_json(data) is None


def test_fields_of_a_newer_version_are_ignored():
    assert from_json({"event": "stopped", "iteration": 5, "mood": "calm"}) == Stopped(5)


def named(paths, pick):
    """Names that `pick` finds in the syntax trees of modules."""
    return {name for path in paths for node in ast.walk(ast.parse((ROOT / path).read_text())) for name in pick(node)}


def calls(node):
    return {node.func.id} if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else set()


def cases(node):
    return {ast.unparse(node.cls).removeprefix("events.")} if isinstance(node, ast.MatchClass) else set()


def strings(node):
    return {node.value} if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()


def test_every_event_is_sent_and_every_receiver_knows_it():
    kinds = {kind.__name__ for kind in get_args(Event)}
    senders = [path.relative_to(ROOT) for path in (ROOT / "engine/training").rglob("*.py")]
    assert kinds <= named([*senders, "app/cli/training.py"], calls)
    for receiver in ("app/cli/training_events.py", "app/features/train/controller.py"):
        assert named([receiver], cases) == kinds
    ends = {"Done", "Failed", "Stopped"}
    assert named(["app/features/train/process.py"], cases) == ends


def test_every_stage_is_sent_and_has_a_title():
    assert set(TITLES) == set(STAGES)

    def strings(node):
        return {node.value} if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()

    assert set(STAGES) <= named([path.relative_to(ROOT) for path in (ROOT / "engine/training").rglob("*.py")], strings)


@pytest.fixture
def written(monkeypatch):
    """What goes to TensorBoard."""
    written = []

    class SummaryWriter:
        def __init__(self, folder, purge_step):
            written.append((folder, purge_step))

        def add_scalar(self, name, value, step):
            written.append((name, value, step))

        def close(self):
            written.append("closed")

    stub = ModuleType("torch.utils.tensorboard")
    stub.SummaryWriter = SummaryWriter
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", stub)
    return written


def test_tensorboard_gets_every_term_of_the_loss(tmp_path, written):
    board = TensorBoardEvents(tmp_path)
    board(Stage("load"))
    assert written == []  # the run folder is not there yet
    board(TrainingProgress(25, 100, 0.5, None, 400, 3.0, 9.0, {"l1": 0.4, "ssim": 0.1}))
    board.close()
    scalars = [("loss", 0.5, 25), ("gaussians", 400, 25), ("loss/l1", 0.4, 25), ("loss/ssim", 0.1, 25)]
    assert written == [(str(tmp_path / "tensorboard"), 25), *scalars, "closed"]


def test_tensorboard_gets_the_terms_of_a_semantic_distillation(tmp_path, written):
    config = TrainConfig.preset_of("quick", iterations=30, max_gaussians=400, resolution=8, channels=8, device="cpu")
    board = TensorBoardEvents(tmp_path / "run")
    train(MemoryClip(), tmp_path / "run", config, events=board, stop=lambda: False)
    board.close()
    terms = {item[0] for item in written[1:-1] if item[2] > 30}
    assert terms == {"loss", "gaussians", "loss/align", "loss/region", "loss/delta_semantics"}
    assert not terms & {item[0] for item in written[1:-1] if item[2] <= 30} - {"loss", "gaussians"}


def test_a_missing_tensorboard_is_said_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    with pytest.raises(DegenseError, match=r"pip install 'degense\[tensorboard\]'"):
        TensorBoardEvents(tmp_path)


@pytest.mark.parametrize("resume", [False, True])
@pytest.mark.parametrize(("teacher", "loaded"), [("none", False), ("labels", False), ("degraded", True), ("degraded:model=flips", True)])
def test_research_is_loaded_for_its_teacher_and_for_what_was_begun(tiny_clip, tmp_path, monkeypatch, teacher, loaded, resume):
    names: list[str] = []
    monkeypatch.setattr("degense.app.cli.training.importlib", SimpleNamespace(import_module=names.append))
    monkeypatch.setattr("degense.engine.training.train", lambda *_, **__: object())
    how = ["--resume"] if resume else ["--teacher", teacher]  # a run may have begun with anything
    assert main(["train", str(tiny_clip), "--out", str(tmp_path), *how]) == 0
    assert names == (["degense.engine.research"] if loaded or resume else [])

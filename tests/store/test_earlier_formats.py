"""Runs as each version of the format was written open, and show what they showed then: a small one of each is kept beside this file.

A change of `FORMAT` in `engine/store/run.py` needs a run of the new format here; those that are here are never made again.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from degense.app.features.annotate.label_sets import open_annotations
from degense.app.session import session_file
from degense.engine.errors import RunError
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from degense.engine.store.run import FORMAT, Run

KEPT = Path(__file__).parent / "formats"
#: What the program that wrote them showed, at frame 3 (displacement at frame 5, in the clip's unit).
SHOWN = {
    1: {
        "colour": (113.15, 74.07, 58.67),
        "displacement": 0.45991,
        "areas": {"liver": 0.39193, "grasper": 0.03516, "fat": 0.13835, "tool": 0.03516},
    }
}


@pytest.fixture(params=sorted(SHOWN))
def kept(request, tmp_path) -> tuple[int, Path]:
    """A format, and a copy of its run: opening one may write into it."""
    shutil.copytree(KEPT / f"format-{request.param}" / "run", tmp_path / "run")
    return request.param, tmp_path / "run"


def test_each_format_is_kept_and_small():
    assert {int(path.name.removeprefix("format-")) for path in KEPT.iterdir()} == set(range(1, FORMAT + 1)) == {*SHOWN}
    assert sum(path.stat().st_size for path in KEPT.rglob("*") if path.is_file()) < 200_000


def test_the_scene_looks_moves_and_answers_as_it_did(kept):
    number, path = kept
    scene, shown = Scene.open(path, device="cpu"), SHOWN[number]
    assert (scene.frames, len(scene.model), scene.run.info["format"]) == (6, 99, number)
    np.testing.assert_allclose(scene.render_rgb(3).mean((0, 1)), shown["colour"], atol=0.5)
    assert float(scene.states.displacement(5).mean()) == pytest.approx(shown["displacement"], rel=1e-3)
    for text, area in shown["areas"].items():
        assert decode_frame(scene, PromptSet((text,)), 3).masks[0].mean() == pytest.approx(area, abs=0.01)


def test_annotations_and_the_session_come_back(kept):
    _, path = kept
    work = open_annotations(path / "annotations", Scene.open(path, device="cpu"), None)
    assert [frame for frame, record in work.records.items() if record.labels is not None] == [0, 1]
    assert [kind.name for kind in work.classes][:3] == ["abdominal wall", "liver", "gallbladder"]
    assert len(np.unique(work.labels(1))) > 3
    saved = session_file.read(path / "session.json")
    assert [prompt["text"] for prompt in saved.states[session_file.VIEW]["prompts"]] == ["liver"]


def test_a_later_format_is_refused_with_what_to_do(kept):
    _, path = kept
    info = json.loads((path / "run.json").read_text(encoding="utf-8"))
    (path / "run.json").write_text(json.dumps(info | {"format": FORMAT + 1}), encoding="utf-8")
    with pytest.raises(RunError, match=r"newer degense .* update to open it"):
        Run.open(path)

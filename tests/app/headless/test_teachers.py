"""Training from other teachers than label maps, through the command line."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli import main
from engine.clip import UNLABELLED
from engine.language.teachers import store
from engine.readers.images import read_index
from engine.readers.labels import read_classes

RUN_ARGUMENTS = ("--preset", "quick", "--iterations", "40", "--max-gaussians", "1500", "--device", "cpu")


@pytest.fixture
def clip(tiny_clip: Path, tmp_path: Path) -> Path:
    """A clip without label maps."""
    copy = tmp_path / "clip"
    shutil.copytree(tiny_clip, copy, ignore=shutil.ignore_patterns("labels"))
    return copy


def scribble(clip: Path, labels: np.ndarray) -> None:
    """Of each class the pixels farthest inside its regions, as the strokes of frame 0."""
    strokes = np.full_like(labels, UNLABELLED)
    for value in np.unique(labels):
        inside = cv2.distanceTransform(np.pad(labels == value, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
        strokes[inside >= 0.7 * inside.max()] = value
    (clip / "strokes").mkdir()
    cv2.imwrite(str(clip / "strokes" / "000000.png"), strokes)


def test_strokes_train_a_scene_that_can_be_prompted(clip, tiny_clip, tmp_path, capsys):
    labels = read_index(tiny_clip / "labels" / "000000.png")
    scribble(clip, labels)
    assert main(["info", str(clip)]) == 0
    assert "strokes 1 of 10 frames" in capsys.readouterr().out
    assert main(["train", str(clip), "--out", str(tmp_path / "run"), *RUN_ARGUMENTS]) == 0  # strokes are what this clip has
    assert main(["segment", str(tmp_path / "run"), "--prompt", "liver", "--frame", "4", "--out", str(tmp_path / "m.npy")]) == 0
    truth = read_index(tiny_clip / "labels" / "000004.png") == read_classes(clip / "classes.json").index("liver")
    found = np.load(tmp_path / "m.npy")
    assert (found & truth).sum() / (found | truth).sum() > 0.6

    capsys.readouterr()
    assert main(["cache"]) == 0
    assert "answers to 1 askings" in capsys.readouterr().out
    assert main(["cache", "--clear", "--limit", "0.5"]) == 0
    assert "0 MB of at most 0.5 GB" in capsys.readouterr().out
    assert store.cache_use().entries == 0


def test_strokes_that_are_not_there(clip, tmp_path, capsys):
    assert main(["train", str(clip), "--out", str(tmp_path / "run"), "--teacher", "strokes"]) == 2
    assert capsys.readouterr().err.endswith("has no strokes; draw some, or add strokes/ and classes.json.\n")

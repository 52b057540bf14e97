"""Training from other teachers than label maps, through the command line."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.cli.main import main
from degense.engine.clip import UNLABELLED
from degense.engine.data.files.images import read_index
from degense.engine.data.files.labels import read_classes
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import PromptError, RunError
from degense.engine.progress import silent
from degense.engine.scene import Scene
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import target_cache as store
from degense.engine.semantics.text.text_vectors import write_vectors
from tests.semantics.models.tiny_models import write_model
from tests.semantics.teachers import peers

SMALL = ("--preset", "quick", "--iterations", "20", "--max-gaussians", "800", "--device", "cpu")


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A phantom; its label maps are moved out of it, into `truth/` beside it."""
    clip = tmp_path / "clip"
    make_phantom(clip, PhantomOptions(frames=4, width=64, height=48, seed=3), silent)
    shutil.move(clip / "labels", tmp_path / "truth")
    return clip


def truth(clip: Path, frame: int) -> np.ndarray:
    return read_index(clip.parent / "truth" / f"{frame:06d}.png")


def overlap(found: np.ndarray, there: np.ndarray) -> float:
    return (found & there).sum() / (found | there).sum()


def scribble(clip: Path, labels: np.ndarray) -> None:
    """Of each class the pixels farthest inside its regions, as the strokes of frame 0."""
    strokes = np.full_like(labels, UNLABELLED)
    for value in np.unique(labels):
        inside = cv2.distanceTransform(np.pad(labels == value, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
        strokes[inside >= 0.7 * inside.max()] = value
    (clip / "strokes").mkdir()
    cv2.imwrite(str(clip / "strokes" / "000000.png"), strokes)


def test_strokes_train_a_scene_that_can_be_prompted(clip, tmp_path, capsys):
    scribble(clip, truth(clip, 0))
    assert main(["info", str(clip)]) == 0
    assert "strokes 1 of 4 frames" in capsys.readouterr().out
    assert main(["train", str(clip), "--out", str(tmp_path / "run"), *SMALL]) == 0  # strokes are what this clip has
    assert main(["segment", str(tmp_path / "run"), "--prompt", "liver", "--frame", "1", "--out", str(tmp_path / "m.npy")]) == 0
    liver = read_classes(clip / "classes.json").index("liver")
    assert overlap(np.load(tmp_path / "m.npy"), truth(clip, 1) == liver) > 0.6

    capsys.readouterr()
    assert main(["cache"]) == 0
    assert "answers to 1 askings" in capsys.readouterr().out
    assert main(["cache", "--clear", "--limit", "0.5"]) == 0
    assert "0 MB of at most 0.5 GB" in capsys.readouterr().out
    assert store.cache_use().entries == 0


def test_strokes_that_are_not_there(clip, tmp_path, capsys):
    assert main(["train", str(clip), "--out", str(tmp_path / "run"), "--teacher", "strokes"]) == 2
    assert capsys.readouterr().err.endswith("has no strokes; draw some, or add strokes/ and classes.json.\n")


@pytest.mark.parametrize("kind", peers.WRITERS)
def test_features_of_peers_train_a_scene_that_can_be_prompted(kind, clip, tmp_path):
    run, names, features = tmp_path / "run", read_classes(clip / "classes.json"), clip / "features"
    vectors = peers.class_vectors(names)
    features.mkdir()
    write_vectors(features / "text_vectors.safetensors", dict(zip(names, vectors, strict=True)), "made-up")
    for frame in (0, 2, 3):
        peers.WRITERS[kind](features, f"{frame:06d}", truth(clip, frame), vectors)
    teacher = f"precomputed:{features}?level=2" if kind == "langsplat" else "precomputed"
    assert main(["train", str(clip), "--out", str(run), "--teacher", teacher, *SMALL]) == 0
    assert main(["segment", str(run), "--prompt", "livers", "--frame", "1", "--out", str(tmp_path / "m.npy")]) == 0
    assert overlap(np.load(tmp_path / "m.npy"), truth(clip, 1) == names.index("liver")) > 0.6
    assert main(["segment", str(run), "--prompt", "spleen", "--frame", "1", "--out", str(tmp_path / "n.npy")]) == 2  # has no text vector
    with pytest.raises(RunError, match="text encoder 'made-up'"):
        Scene.open(run, device="cpu", encoder=EmbeddedEncoder())


def test_a_clip_model_trains_a_scene_that_can_be_prompted_without_it(clip, tmp_path):
    model, run = write_model(tmp_path / "model", "clip"), tmp_path / "run"
    assert main(["train", str(clip), "--out", str(run), "--teacher", f"vlm:{model}", *SMALL]) == 0
    shutil.rmtree(model)
    scene = Scene.open(run, device="cpu")
    assert scene.encoder.name.startswith("clip-")
    asked = scene.query(1).similarity(scene.vectors(("the gall bladder",))[0])
    assert asked.shape == (48, 64)
    assert 0.001 < np.ptp(asked) < 2
    with pytest.raises(PromptError, match="xyzzy"):
        scene.vectors(("xyzzy",))

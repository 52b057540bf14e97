"""What an opened run needs: its clip, absent, moved, gone or changed, and the encoder of its features."""

import json
import shutil

import numpy as np
import pytest

from degense.engine.errors import DegenseError, RunError
from degense.engine.scene import Scene
from degense.engine.semantics import TextVectors


def copied(scene, tmp_path, **changes):
    """A copy of the run folder beside a link to its clip, with changes to run.json."""
    shutil.copytree(scene.run.path, tmp_path / "copy")
    shutil.copytree(scene.clip.path, tmp_path / "clip")
    file = tmp_path / "copy" / "run.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    return tmp_path / "copy"


def test_a_run_without_its_clip_still_shows(lonely):
    assert lonely.observed(0) is None
    assert lonely.labels(0) is None
    assert lonely.render(2)["rgb"].shape == (48, 64, 3)
    with pytest.raises(DegenseError, match="recording, which is missing: the clip was deleted"):
        _ = lonely.observed_motion


def test_run_and_clip_can_be_moved_together(scene, tmp_path):
    moved = Scene.open(copied(scene, tmp_path), device="cpu")
    assert moved.clip is not None
    assert moved.clip.path == (tmp_path / "clip").resolve()
    np.testing.assert_array_equal(moved.render_rgb(4), scene.render_rgb(4))


def test_a_clip_that_is_gone_or_changed_is_said(scene, tmp_path):
    path = copied(scene, tmp_path)
    labels = sorted((tmp_path / "clip" / "images").iterdir())
    labels[0].write_bytes(labels[1].read_bytes())
    changed = Scene.open(path, device="cpu")
    assert changed.clip is None
    assert "has changed since the training" in changed.clip_missing
    shutil.rmtree(tmp_path / "clip")
    gone = Scene.open(path, device="cpu")
    assert gone.clip is None
    assert str(tmp_path / "clip") in gone.clip_missing
    assert "\n" not in gone.clip_missing
    given = Scene.open(path, device="cpu", clip=scene.clip)
    assert given.clip is scene.clip


def test_unknown_clip_options_are_said(scene, tmp_path):
    recorded = scene.run.info["clip"] | {"options": {"wormhole": 1}}
    opened = Scene.open(copied(scene, tmp_path, clip=recorded), device="cpu")
    assert opened.clip is None
    assert "options for its clip that this version does not know" in opened.clip_missing


def test_no_run_no_scene(tmp_path):
    with pytest.raises(RunError):
        Scene.open(tmp_path / "nothing")


def test_words_that_do_not_fit_the_features_are_refused(scene, speechless, tmp_path):
    other = TextVectors({"liver": np.ones(5)}, "embedded-surgical-1")  # it bears the right name
    with pytest.raises(RunError, match="features of length 128, and text vectors of length 5"):
        Scene.open(copied(scene, tmp_path, classes=["liver"]), encoder=other)
    with pytest.raises(RunError, match="was trained without semantics, so no encoder"):
        Scene.open(speechless.run.path, encoder=other)

"""Label maps of another folder, in place of a clip's own."""

import json

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.readers import open_clip, with_labels
from degense.engine.errors import ClipError
from degense.engine.semantics.teachers import teacher_by_name, teacher_choices
from tests.data.readers.makers import HEIGHT, WIDTH, save, write_frames


@pytest.fixture
def scribbled(tmp_path):
    """A clip, and a folder with one line each of two classes on its frame 2."""
    write_frames(tmp_path / "clip", np.random.default_rng(0))
    lines = np.full((HEIGHT, WIDTH), UNLABELLED, np.uint8)
    lines[10, 10:40], lines[50, 10:40] = 0, 1
    save(tmp_path / "drawn" / "labels" / "000002.png", lines)
    (tmp_path / "drawn" / "classes.json").write_text(json.dumps({"classes": ["liver", "fat"]}))
    return tmp_path


def test_labels_of_a_folder_are_the_clips_labels_and_its_strokes(scribbled):
    clip = open_clip(scribbled / "clip", ClipOptions(labels=str(scribbled / "drawn")))
    assert clip.classes == ("liver", "fat")
    assert clip.labelled_frames == clip.stroked_frames == [2]
    assert np.array_equal(clip.labels(2), clip.strokes(2))
    assert {choice.name for choice in teacher_choices(clip) if choice.available} == {"labels", "strokes", "none"}
    assert teacher_by_name("strokes", clip).frames
    assert "drawn" in clip.provenance["strokes"]


def test_a_folder_without_labels_is_refused(scribbled):
    with pytest.raises(ClipError, match="holds no labels/"):
        with_labels(open_clip(scribbled / "clip"), scribbled)

"""Ten strokes on one frame of a real operation."""

import shutil

import cv2
import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.files.labels import read_classes
from degense.engine.data.readers import open_clip
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.teachers import StrokeTeacher

#: Class and ends of ten strokes, four pixels wide, at most two a class: first one in the middle of each class, then one each where the map
#: that came of the strokes so far was most wrong, as a person corrects it.
STROKES = [
    ("liver", (200, 364), (133, 277)),
    ("gallbladder", (379, 209), (292, 142)),
    ("fat", (512, 450), (438, 440)),
    ("abdominal_wall", (116, 140), (171, 45)),
    ("grasper", (355, 78), (451, 38)),
    ("ligament", (567, 118), (601, 37)),
    ("liver", (213, 51), (306, 13)),
    ("gallbladder", (387, 465), (425, 415)),
    ("grasper", (529, 14), (598, 4)),
    ("ligament", (569, 233), (569, 206)),
]
FLOOR = {"liver": 0.85, "gallbladder": 0.88, "fat": 0.6, "abdominal_wall": 0.8}


@pytest.fixture
def stroked(clips, tmp_path):
    """The clip's first frames, with strokes on the annotated one instead of its label map; and that map."""
    folder = tmp_path / "clip"
    for i, file in enumerate(sorted((clips / "cholec160" / "images").iterdir())):
        if i < 24:
            (folder / "images").mkdir(parents=True, exist_ok=True)
            shutil.copy(file, folder / "images" / file.name)
    shutil.copy(clips / "cholec160" / "classes.json", folder)
    labels = cv2.imread(str(clips / "cholec160" / "labels" / "000159.png"), cv2.IMREAD_UNCHANGED)
    (folder / "strokes").mkdir()
    classes = read_classes(folder / "classes.json")
    strokes = np.full_like(labels, UNLABELLED)
    for name, start, end in STROKES:
        cv2.line(strokes, start, end, classes.index(name), 4)
    strokes[strokes != labels] = UNLABELLED
    cv2.imwrite(str(folder / "strokes" / "000159.png"), strokes)
    return open_clip(folder), labels


def test_ten_strokes_outline_the_organs_and_know_how_sure_they_are(stroked):
    clip, labels = stroked
    assert (clip.strokes(0) != UNLABELLED).mean() < 0.015
    teacher = StrokeTeacher(clip, EmbeddedEncoder())
    answers = dict(teacher.compute([0, 23]))
    vectors, index = answers[0]
    likely = np.array(teacher.classes)[(vectors @ teacher.vectors.T).argmax(1)]
    said = np.where(index >= 0, likely[index], UNLABELLED)
    inside = clip.valid(0)
    for name, floor in FLOOR.items():
        mine, true = (maps == clip.classes.index(name) for maps in (said, labels))
        assert (mine & true & inside).sum() / ((mine | true) & inside).sum() > floor, name

    right = (said == labels)[inside & (index >= 0)]
    sure = (vectors @ teacher.vectors.T).max(1)[index[inside & (index >= 0)]]
    assert right[sure > 0.95].mean() > 0.95
    assert right[sure < 0.85].mean() < 0.85

    _, later = answers[23]  # a second on, the camera has moved
    assert (later >= 0)[clip.valid(23)].mean() > 0.9

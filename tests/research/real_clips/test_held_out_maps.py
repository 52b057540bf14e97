"""Maps of further frames: read as drawn, scored as IoU of each class, never taken from what is trained on."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.cli.main import main
from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import ClipError, DegenseError
from degense.engine.research.real_clips.held_out_maps import read_held_out_maps, score_first_map
from tests.conftest import ROOT

DRAWN = ROOT / "docs" / "benchmarks" / "held-out-maps"
LEFT, UNKNOWN = [[0, 0], [20, 0], [20, 48], [0, 48]], [[0, 0], [64, 0], [64, 8], [0, 8]]  # corners (x, y)


@pytest.fixture(scope="module")
def clip_folder(tmp_path_factory) -> Path:
    """A phantom of which the first frame alone is labelled: its left half class 1, its right half class 2."""
    folder = tmp_path_factory.mktemp("maps") / "one"
    make_phantom(folder, PhantomOptions(frames=10, width=64, height=48))
    for name in ("gt.npz", "depth", "labels"):
        shutil.rmtree(folder / name) if (folder / name).is_dir() else (folder / name).unlink()
    (folder / "labels").mkdir()
    first = np.full((48, 64), 2, np.uint8)
    first[:, :32] = 1
    cv2.imwrite(str(folder / "labels" / "000000.png"), first)
    return folder


def coco(clip_folder: Path, out: Path, frames: tuple[str, ...] = ("000005", "000009")) -> Path:
    """A file that says of some frames: class 2 everywhere, class 1 in the 20 columns on the left, and nobody knows of the upper 8 rows."""
    classes = [*open_clip(clip_folder).classes, "not to be told"]
    everywhere = [[0, 0], [64, 0], [64, 48], [0, 48]]
    shapes = [(2, everywhere), (1, LEFT), (len(classes) - 1, UNKNOWN)]
    outlines = [(k, value, np.ravel(corners).tolist()) for k in range(len(frames)) for value, corners in shapes]
    out.write_text(
        json.dumps(
            {
                "images": [{"id": k, "file_name": f"{name}.png", "width": 64, "height": 48} for k, name in enumerate(frames)],
                "categories": [{"id": value, "name": name} for value, name in enumerate(classes)],
                "annotations": [{"image_id": k, "category_id": value, "segmentation": [outline]} for k, value, outline in outlines],
            }
        )
    )
    return out


def test_maps_are_read_and_the_first_one_is_scored(clip_folder, tmp_path):
    clip = open_clip(clip_folder)
    maps = read_held_out_maps(coco(clip_folder, tmp_path / "one.json"), clip)
    assert list(maps) == [5, 9]
    edge = 1  # an outline's edge belongs to it
    assert (maps[5][: 8 + edge // 2] == UNLABELLED).all()
    assert (maps[5][12:, :18] == 1).all()
    assert (maps[5][12:, 24:] == 2).all()
    found = score_first_map(clip, maps)["first label map, copied"]["held_out_maps"]
    ones = int((maps[9] == 1).sum())  # all within the 32 columns that the first map calls so
    known = maps[9] != UNLABELLED
    assert set(found) == {"5", "9"}
    assert found["9"][clip.classes[1]] == pytest.approx(ones / known[:, :32].sum())
    assert found["9"][clip.classes[2]] == pytest.approx(known[:, 32:].sum() / (known.sum() - ones))
    assert found["9"][clip.classes[3]] is None  # in neither


def test_maps_that_do_not_fit_are_refused(clip_folder, tmp_path):
    clip = open_clip(clip_folder)
    with pytest.raises(DegenseError, match="a map of frame 0, which one is trained with"):
        read_held_out_maps(coco(clip_folder, tmp_path / "one.json", ("000000",)), clip)
    with pytest.raises(ClipError, match="no frame of this clip"):
        read_held_out_maps(coco(clip_folder, tmp_path / "one.json", ("000077",)), clip)


def test_a_bench_scores_scenes_beside_the_first_map(clip_folder, tmp_path, capsys):
    coco(clip_folder, tmp_path / "one.json")
    command = ["bench", "clips", "--clip", str(clip_folder), "--held-out-maps", str(tmp_path), "--methods", "degense", "--out"]
    small = ["--iterations", "12", "--max-gaussians", "300", "--slots", "1", "--seeds", "1", "--device", "cpu"]
    assert main([*command, str(tmp_path / "out"), *small]) == 0
    capsys.readouterr()
    table = json.loads((tmp_path / "out" / "clips-one-maps-cpu.json").read_text())
    assert [(row["method"], row["frame"]) for row in table["rows"]] == [
        (name, frame)
        for name in ("degense", "baseline: first label map, copied", "baseline: first label map along chained flow")
        for frame in (5, 9)
    ]
    name = open_clip(clip_folder).classes[2]
    assert all(0 <= row[name][0] <= 1 for row in table["rows"])
    assert "--held-out-maps" in table["command"]


def test_the_maps_of_the_project_are_outlines_of_the_classes_they_name():
    """Coordinates inside of the picture, and no pixels."""
    for path in DRAWN.glob("*.json"):
        data = json.loads(path.read_text(encoding="utf-8"))
        assert set(data) == {"info", "images", "categories", "annotations"}
        size = {image["id"]: (image["width"], image["height"]) for image in data["images"]}
        for item in data["annotations"]:
            [outline] = item["segmentation"]
            assert (np.array(outline).reshape(-1, 2) >= 0).all()
            assert (np.array(outline).reshape(-1, 2) <= size[item["image_id"]]).all()
    assert list(DRAWN.glob("*.json"))

"""Exports can be read by others, and by ourselves."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from PIL import Image

from degense.app.cli.terminal import Bar, run_steps
from degense.app.features.export.formats import FORMATS, ExportOptions, get_format
from degense.engine.annotation.formats.map_set import mask_of_runs
from degense.engine.errors import DegenseError
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import NO_PROMPTS, PromptSet
from tests.fakes import ply_columns


def export(name, scene, out, **options):
    return run_steps(get_format(name).export(scene, out, ExportOptions(**{"prompt_set": NO_PROMPTS} | options)), Bar())


def test_ply_comes_back(scene, tmp_path):
    export("ply", scene, tmp_path / "deep" / "x.ply", frame=3)
    assert np.allclose(ply_columns(tmp_path / "deep" / "x.ply")[:, :3], scene.splats(3).means)


def test_ply_sequence_has_every_frame(scene, tmp_path):
    export("ply-sequence", scene, tmp_path / "x")
    assert len(list((tmp_path / "x").glob("*.ply"))) == scene.frames
    assert np.allclose(ply_columns(tmp_path / "x" / "000007.ply")[:, :3], scene.splats(7).means)


def test_masks_are_label_maps_of_clips(scene, tmp_path):
    export("masks-png", scene, tmp_path / "x", prompt_set=PromptSet(("liver", "gallbladder"), decoder="argmax"))
    assert json.loads((tmp_path / "x" / "classes.json").read_text()) == {"classes": ["liver", "gallbladder"]}
    labels = np.array(Image.open(tmp_path / "x" / "labels" / "000004.png"))
    assert np.array_equal(labels, decode_frame(scene, PromptSet(("liver", "gallbladder"), decoder="argmax"), 4).labels)


def test_coco_holds_the_masks(scene, tmp_path):
    export("coco", scene, tmp_path / "x.json", prompt_set=PromptSet(decoder="argmax"))
    data = json.loads((tmp_path / "x.json").read_text())
    assert [category["name"] for category in data["categories"]] == list(scene.classes)
    labels = decode_frame(scene, PromptSet(scene.classes, decoder="argmax"), 6).labels
    found = [entry for entry in data["annotations"] if entry["image_id"] == 6]
    assert {entry["category_id"] - 1 for entry in found} == set(np.unique(labels)) - {255}
    whole = np.zeros((len(scene.classes), *labels.shape), int)
    for entry in found:
        part = mask_of_runs(entry["segmentation"]["counts"], labels.shape)
        whole[entry["category_id"] - 1] += part
        x, y, width, height = entry["bbox"]
        assert part[y : y + height, x : x + width].sum() == entry["area"] == part.sum()
    assert np.array_equal(whole, labels == np.arange(len(whole))[:, None, None])


def test_movie_has_every_frame(scene, tmp_path):
    export("movie", scene, tmp_path / "x.mp4", layer="displacement")
    movie = cv2.VideoCapture(str(tmp_path / "x.mp4"))
    assert int(movie.get(cv2.CAP_PROP_FRAME_COUNT)) == scene.frames
    movie.release()


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in ("ply", "spz", "gltf", "cholecseg8k", "endovis18")])
def test_a_stopped_export_leaves_no_half_file(scene, tmp_path, name):
    out = tmp_path / f"x{FORMATS[name].suffix}"
    steps = get_format(name).export(scene, out, ExportOptions(NO_PROMPTS))
    next(steps)
    next(steps)
    steps.close()
    if FORMATS[name].suffix:
        assert list(tmp_path.iterdir()) == []
    else:
        assert not list(out.rglob(".*"))


def test_a_full_folder_is_not_touched(scene, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(DegenseError, match="not empty"):
        export("masks-png", scene, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_frames_of_the_command_line(run, tmp_path, capsys):
    """A range, the labelled frames, and the annotations of a clip without a run."""
    from degense.app.cli.main import main

    clip = run.parent / "clip"
    assert main(["export", str(run), "--format", "coco", "--out", str(tmp_path / "a.json"), "--prompt", "liver", "--frames", "2:4"]) == 0
    assert [image["id"] for image in json.loads((tmp_path / "a.json").read_text())["images"]] == [2, 3]
    assert main(["export", str(clip), "--format", "nifti", "--out", str(tmp_path / "a.nii.gz"), "--frames", "labelled"]) == 0
    assert "10 label maps of 8 classes" in capsys.readouterr().out
    assert main(["export", str(clip), "--format", "ply", "--out", str(tmp_path / "a.ply")]) == 2
    assert "is no run, so only its annotations can be exported" in capsys.readouterr().err
    assert not (tmp_path / "a.ply").exists()

"""What is handed over with --anonymise holds no name of a patient: not in file names, texts, metadata or pictures."""

from __future__ import annotations

import base64
import json
import re
import shutil
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from degense.app.cli.main import main
from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import open_clip
from degense.engine.scene import Scene
from degense.engine.scene.anonymous import anonymised
from degense.engine.training import TrainConfig, train

NAME = "Roentgen-Anna-1895"
COVERED = (slice(0, 10), slice(0, 40))


@pytest.fixture(scope="module")
def named(tiny_clip, tmp_path_factory) -> Path:
    """A run whose clip, frames and folders bear a name, with white text burnt into its frames; `cover.png` marks it."""
    home = tmp_path_factory.mktemp("named") / NAME
    clip = home / f"{NAME}-clip"
    shutil.copytree(tiny_clip, clip)
    for file in (clip / "images").iterdir():
        picture = cv2.imread(str(file))
        picture[COVERED] = 0
        cv2.putText(picture, "ANNA", (1, 9), cv2.FONT_HERSHEY_PLAIN, 0.8, (255, 255, 255), 1)
        cv2.imwrite(str(file.with_name(f"{NAME}_{file.name}")), picture)
        file.unlink()
    for folder in ("depth", "labels"):
        for file in (clip / folder).iterdir():
            file.rename(file.with_name(f"{NAME}_{file.name}"))
    config = TrainConfig.preset_of("quick", iterations=40, max_gaussians=800, device="cpu")
    train(open_clip(clip), home / f"{NAME}-run", config, events=lambda event: None, stop=lambda: False)
    cover = np.zeros((80, 96), np.uint8)
    cover[COVERED] = 255
    cv2.imwrite(str(home / "cover.png"), cover)
    return home / f"{NAME}-run"


def assert_nameless(out: Path) -> None:
    """No file below has the name in its own name or its bytes, plain, in UTF-16 or unpacked."""
    files = [out] if out.is_file() else [path for path in out.rglob("*") if path.is_file()]
    assert files
    for path in files:
        assert NAME not in path.name
        parts = [path.read_bytes()]
        if zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as packed:
                parts += [name.encode() + packed.read(name) for name in packed.namelist()]
        for data in parts:
            for secret in (NAME, "Roentgen"):
                assert secret.encode() not in data, path
                assert secret.encode("utf-16-le") not in data, path


def report_pictures(folder: Path) -> list[np.ndarray]:
    """The pictures of a report of scores but those of the true labels, which are painted over the frame."""
    page = (folder / "report.html").read_text(encoding="utf-8")
    found = re.findall(r"alt=\"(?!truth)[^\"]+\" src=\"data:image/\w+;base64,([^\"]+)\"", page)
    return [cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR) for data in found]


LABELS = ("coco", "cvat", "cvat-video", "label-studio", "yolo", "nifti", "seg-nrrd", "dicom-seg", "masks-png")
ENDINGS = {"coco": ".json", "cvat": ".xml", "cvat-video": ".xml", "label-studio": ".json", "nifti": ".nii.gz", "seg-nrrd": ".seg.nrrd"}
ENDINGS |= {"dicom-seg": ".dcm", "ply": ".ply", "spz": ".spz", "gltf": ".glb", "movie": ".mp4"}


@pytest.mark.parametrize("name", [*LABELS, "ply", "ply-sequence", "spz", "gltf", "movie"])
def test_exports(name, named, tmp_path):
    out = tmp_path / f"out{ENDINGS.get(name, '')}"
    assert main(["export", str(named), "--format", name, "--out", str(out), "--anonymise"]) == 0
    assert_nameless(out)


def test_annotations_of_a_clip_have_the_names_of_its_frames_without_it(named, tmp_path):
    clip = next(named.parent.glob("*-clip"))
    for words, hidden in (([], False), (["--anonymise"], True)):
        out = tmp_path / f"{len(words)}.json"
        assert main(["export", str(clip), "--format", "coco", "--out", str(out), *words]) == 0
        assert (NAME not in out.read_text(encoding="utf-8")) is hidden
    assert [image["file_name"] for image in json.loads(out.read_text(encoding="utf-8"))["images"]][:2] == ["000000.png", "000001.png"]


def test_a_page_and_a_report(named, tmp_path):
    assert main(["share", str(named), "--out", str(tmp_path / "page.html"), "--anonymise"]) == 0
    assert_nameless(tmp_path / "page.html")
    cover = ["--cover", str(named.parent / "cover.png")]
    assert main(["eval", str(named), "--report", str(tmp_path / "report"), "--anonymise", *cover]) == 0
    assert_nameless(tmp_path / "report")
    assert main(["eval", str(named), "--report", str(tmp_path / "uncovered"), "--anonymise"]) == 0
    for folder, light in (("report", False), ("uncovered", True)):
        pictures = report_pictures(tmp_path / folder)
        assert len(pictures) >= 4
        assert all(bool(picture[:8, :38].max() > 60) is light for picture in pictures)  # JPEG blurs next to the border
        assert all(picture[12:].max() > 100 for picture in pictures)
    assert main(["eval", str(named), "--report", str(tmp_path / "plain")]) == 0
    assert NAME in (tmp_path / "plain" / "report.html").read_text(encoding="utf-8")  # so that the test would find it


def test_burnt_in_text_is_black_in_pictures_and_movies(named, tmp_path):
    cover = ["--anonymise", "--cover", str(named.parent / "cover.png")]
    assert Scene.open(named, device="cpu").render_rgb(3)[COVERED].max() > 60
    assert main(["render", str(named), "--frame", "3", "--out", str(tmp_path / "frame.png"), *cover]) == 0
    assert cv2.imread(str(tmp_path / "frame.png"))[COVERED].max() == 0
    assert main(["movie", str(named), "--layers", "recording,rgb", "--out", str(tmp_path / "movie.mp4"), *cover]) == 0
    film = cv2.VideoCapture(str(tmp_path / "movie.mp4"))
    ok, picture = film.read()
    film.release()
    assert ok
    for left in (0, 96):  # the recording, and the scene
        assert picture[0:8, left : left + 38].max() < 40  # next to the border of the cover a codec blurs
    assert picture.max() > 100


def test_masks_and_raw_values_hold_nothing_under_the_cover(named, tmp_path):
    """Neither a name nor a pixel: of one frame, of all frames in a folder, and of layers as numbers."""
    cover = ["--anonymise", "--cover", str(named.parent / "cover.png")]
    prompts = ["--prompt", "liver", "--prompt", "gallbladder", "--prompt", "fat"]
    for words, empty in ((cover, True), (["--anonymise"], False)):
        out = tmp_path / ("covered" if empty else "open")
        out.mkdir()
        assert main(["segment", str(named), "--frame", "3", "--out", str(out / "masks.npy"), *prompts, *words]) == 0
        assert main(["segment", str(named), "--frame", "3", "--out", str(out / "masks.png"), *prompts, *words]) == 0
        assert main(["segment", str(named), "--frames", "all", "--out", str(out / "all"), *prompts, *words]) == 0
        maps = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((out / "all" / "masks").rglob("*.png"))]
        assert len(maps) == 30
        maps += [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) != UNLABELLED for path in (out / "all" / "labels").iterdir()]
        maps += [np.load(out / "masks.npy").any(0), cv2.imread(str(out / "masks.png"), cv2.IMREAD_UNCHANGED)]
        under = [bool(picture[COVERED].any()) for picture in maps]
        assert any(picture[12:].any() for picture in maps)
        assert any(under) is not empty
        for layer in ("rgb", "depth", "displacement", "similarity", "features"):
            asked = ["--prompt", "liver"] if layer == "similarity" else []
            assert (
                main(["render", str(named), "--frames", "2:4", "--layer", layer, "--out", str(out / f"{layer}.npy"), *asked, *words]) == 0
            )
            values = np.load(out / f"{layer}.npy").astype(float)
            assert bool(np.ptp(np.nan_to_num(values[:, COVERED[0], COVERED[1]]), (0, 1, 2)).any()) is not empty, (
                layer
            )  # one value: that of nothing
            assert np.nan_to_num(values).any()
        assert_nameless(out)


def test_what_cannot_be_covered_is_refused(named, tmp_path, capsys):
    cover = ["--cover", str(named.parent / "cover.png")]
    out = ["--out", str(tmp_path / "x.ply")]
    assert main(["export", str(named), "--format", "ply", *out, "--anonymise", *cover]) == 2
    assert "Gaussians cannot be covered" in capsys.readouterr().err
    assert main(["share", str(named), "--out", str(tmp_path / "x.html"), "--anonymise", *cover]) == 2
    assert main(["render", str(named), "--frame", "1", *out, *cover]) == 2
    assert "give --anonymise too" in capsys.readouterr().err
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((4, 4), np.uint8))
    assert main(["render", str(named), "--frame", "1", *out, "--anonymise", "--cover", str(tmp_path / "small.png")]) == 2
    assert "4 × 4 pixels" in capsys.readouterr().err
    assert not any(tmp_path.glob("x.*"))


def test_without_a_cover_pictures_are_the_same(scene):
    other = anonymised(scene)
    np.testing.assert_array_equal(other.render_rgb(2), scene.render_rgb(2))
    assert (other.name, other.clip.name, other.clip.path) == ("run", "clip", Path("clip"))
    assert str(scene.run.path.parent) not in json.dumps(other.run.info)


def test_what_a_report_of_scores_and_masks_of_questions_hold(named, tmp_path, capsys):
    scores, out = tmp_path / "scores.json", tmp_path / "masks"
    capsys.readouterr()
    assert main(["eval", str(named), "--json", str(scores), "--anonymise"]) == 0
    assert_nameless(scores)
    assert main(["query", str(named), "liver", "--json", str(tmp_path / "query.json"), "--out", str(out), "--anonymise"]) == 0
    assert_nameless(tmp_path / "query.json")
    assert_nameless(out)
    assert NAME not in capsys.readouterr().out
    assert main(["query", str(named), "liver", "--out", str(tmp_path / "plain")]) == 0
    assert NAME in (tmp_path / "plain" / "01-liver" / "query.json").read_text(encoding="utf-8")
    assert main(["track", str(named), "--grid", "2", "--json", str(tmp_path / "tracks.json")]) == 0  # names nothing without asking
    assert_nameless(tmp_path / "tracks.json")


def test_a_search_numbers_its_runs(named, tmp_path, capsys):
    """Also those that do not answer from the index, or that cannot be indexed; the folder itself bears the name."""
    (named.parent / f"{NAME}-broken").mkdir()
    (named.parent / f"{NAME}-broken" / "run.json").write_text("{}", encoding="utf-8")
    shutil.copy(named / "model.safetensors", named.parent / f"{NAME}-broken")
    said = tmp_path / "said.json"
    words = ["search", str(named.parent), "liver", "liver inside grasper or fat", "--json", str(said), "--thumbnails", str(tmp_path / "p")]
    assert main(words) == 0
    assert NAME in capsys.readouterr().out
    assert NAME in said.read_text(encoding="utf-8")
    assert main([*words, "--anonymise"]) == 0
    shown = capsys.readouterr().out
    assert_nameless(said)
    assert NAME not in shown
    first, second = json.loads(said.read_text(encoding="utf-8"))["questions"]
    assert {row["run"] for row in first["moments"]} == {"run-2"}
    assert [row["run"] for row in second["unanswered"]] == ["run-2"]
    assert [row["run"] for row in first["broken"]] == ["run-1"]


def test_a_batch_numbers_its_jobs(named, tmp_path, capsys):
    """Its report and exports; the folder itself knows the clips, as a key to the numbers."""
    clip, out = named.parent / f"{NAME}-clip", tmp_path / "batch"
    small = ["--preset", "quick", "--iterations", "20", "--max-gaussians", "300", "--device", "cpu", "--slots", "1", "--no-eval"]
    exports = ["--export", "coco", "--export", "masks-png", "--export", "movie"]
    cover = ["--anonymise", "--cover", str(named.parent / "cover.png")]
    absent = named.parent / f"{NAME}-absent"
    assert main(["batch", str(clip), str(absent), "--out", str(out), *small, *exports, *cover, "--prompt", "liver"]) == 1
    assert_nameless(out / "exports")
    for kind in ("json", "csv", "md"):
        assert_nameless(out / f"report.{kind}")
    rows = json.loads((out / "report.json").read_text(encoding="utf-8"))["jobs"]
    assert [(row["job"], row["state"], row["clip"], row["failure"]) for row in rows] == [
        ("clip-0001", "done", "", ""),
        ("clip-0002", "failed", "", "jobs/clip-0002.json says why."),
    ]
    assert str(absent) in (out / "jobs" / "clip-0002.json").read_text(encoding="utf-8")
    film = cv2.VideoCapture(str(out / "exports" / "movie" / "clip-0001.mp4"))
    ok, picture = film.read()
    film.release()
    assert ok
    assert picture[0:8, 0:38].max() < 40  # next to the border of the cover a codec blurs
    assert picture.max() > 100
    capsys.readouterr()
    for words, sentence in ((["--cover", "x.png"], "anonymise too"), ([*cover, "--export", "ply"], "Gaussians cannot be covered")):
        assert main(["batch", str(clip), "--out", str(tmp_path / "other"), *words]) == 2
        assert sentence in capsys.readouterr().err

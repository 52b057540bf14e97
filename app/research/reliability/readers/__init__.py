"""Everything that reads a file which may come from elsewhere: what it reads, and how a program would go on with it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from degense.app.batch.folder import BatchFolder, JobRecord
from degense.app.batch.plan_file import read_plan
from degense.app.batch.report import write_report
from degense.app.features.cameras.state import Stop, load_path, save_path
from degense.app.research.reliability import samples
from degense.app.research.reliability.readers.reader import Reader, under
from degense.app.research.reliability.readers.runs import run_readers
from degense.app.research.reliability.readers.sessions import session_readers
from degense.app.research.reliability.readers.teachers import teacher_readers
from degense.app.research.reliability.samples import data_sets
from degense.app.shell.settings import SettingsFile
from degense.engine.annotation import folder as annotation_folder
from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.archive.index_file import INDEX, open_index
from degense.engine.archive.indexing import update_index
from degense.engine.archive.search import search
from degense.engine.camera import Camera
from degense.engine.data.files.point_files import read_points
from degense.engine.data.files.stored import describe, fingerprint
from degense.engine.data.readers import open_clip
from degense.engine.progress import finish
from degense.engine.scene.anonymous import read_cover


def readers() -> list[Reader]:
    """All of them."""
    small = (samples.SHAPE, samples.NAMES)
    clips = {
        "frames": samples.phantom,
        "jpeg": samples.jpeg_clip,
        "endonerf": samples.endonerf,
        "nerfstudio": samples.nerfstudio,
        "colmap-text": samples.colmap_text,
        "colmap-binary": samples.colmap_binary,
        "servct": data_sets.servct,
        "c3vd": data_sets.c3vd,
        "cholecseg8k": data_sets.cholecseg8k,
        "endovis18": data_sets.endovis18,
        "stir": data_sets.stir,
        "surgt": data_sets.surgt,
    }
    # pictures are the most, and need not be
    seldom = ("**/*.json", "**/*.json", "**/*.np[yz]", "**/*.bin", "**/*.txt", "**/*.yaml", "**/*.png", "**/*")
    found = [Reader(f"clip {name}", under(make), _use_clip, seldom) for name, make in clips.items()]
    found += [Reader("clip video", lambda folder: samples.video(folder / "clip.mp4"), _use_clip)]
    found += [Reader(f"labels {name}", partial(samples.labels, name), partial(_use_labels, name, *small)) for name in LABEL_FORMATS]
    found += [Reader(f"points {kind}", partial(samples.points, kind), _use_points) for kind in ("json", "csv", "npz")]
    trees = {"stir": data_sets.stir, "vl-surgpt": data_sets.vl_surgpt, "surgt": data_sets.surgt}
    of_points = ("**/*seg.png", "**/labels.json", "**/*.yaml")
    found += [Reader(f"points {name}", under(make), _use_points, of_points) for name, make in trees.items()]
    found += run_readers() + teacher_readers() + session_readers()
    found += [
        Reader("annotations", samples.annotated, _use_annotations),
        Reader("cover", _cover, lambda path: read_cover(path, (samples.WIDTH, samples.HEIGHT))),
        Reader("camera path", _camera_path, load_path),
        Reader("settings", _settings, lambda path: SettingsFile(path).value),
        Reader("plan", _plan, read_plan),
        Reader("batch folder", _batch, _use_batch, ("**/batch.json", "**/jobs/*.json")),
        Reader("index", _index, _use_index, ("**/*.sqlite",)),
    ]
    return found


def _use_clip(path: Path) -> None:
    clip = open_clip(path)
    describe(clip), fingerprint(clip), clip.truth()
    for i in {0, len(clip) - 1}:
        clip.frame(i), clip.depth(i), clip.valid(i), clip.labels(i), clip.strokes(i)


def _use_labels(name: str, shape: tuple[int, int], names: tuple[str, ...], path: Path) -> None:
    maps = LABEL_FORMATS[name].read(path, shape, names)
    for frame in maps.frames:
        maps.read(frame)


def _use_points(path: Path) -> None:
    _ = read_points(path, samples.FRAMES, (samples.WIDTH, samples.HEIGHT)).queries


def _use_annotations(path: Path) -> None:
    found = annotation_folder.load(path, samples.SHAPE, samples.FRAMES, lambda frame: None)
    assert found is not None
    for frame in range(samples.FRAMES):
        found.shown(frame)
    found.review_queue()


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def _cover(folder: Path) -> Path:
    cv2.imwrite(str(folder / "cover.png"), np.where(samples.label_map(3) == 0, 255, 0).astype(np.uint8))
    return folder / "cover.png"


def _camera_path(folder: Path) -> Path:
    camera = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
    save_path(folder / "path.json", (Stop("a", camera, 0.0, 1.0), Stop("b", camera, 3.0, 2.0)))
    return folder / "path.json"


def _settings(folder: Path) -> Path:
    return _written(folder / "settings.json", json.dumps({"text_size": 1.0, "recent": ["a", "b"], "theme": "dark", "speed": 1.0}))


def _plan(folder: Path) -> Path:
    lines = ('clips = ["a", "b"]', 'preset = "quick"', "iterations = 20", 'prompts = ["liver"]', 'exports = ["ply"]', "scores = true")
    tables = ("[[clip]]", 'path = "c"', 'name = "third"', "seed = 3", "[variant.long]", "iterations = 40", "settings = { flow = 7.0 }")
    return _written(folder / "plan.toml", "\n".join((*lines, *tables)) + "\n")


def _batch(folder: Path) -> Path:
    batch = BatchFolder(folder / "batch")
    jobs = batch.begin(read_plan(_plan(folder)))
    for job in jobs:
        batch.keep(job, JobRecord({"train": job.stages()["train"]}, {"train": 1.5}))
    return batch.path


def _use_batch(path: Path) -> None:
    batch = BatchFolder(path)
    jobs = batch.jobs()
    for job in jobs:
        batch.record(job), batch.left(job)
    batch.begin(jobs)
    write_report(batch, jobs)


def _index(folder: Path) -> Path:
    samples.run(folder / "runs" / "one")
    finish(update_index(folder / "runs"))
    return folder / "runs"


def _use_index(path: Path) -> None:
    with open_index(path / INDEX) as index:
        for run in index.runs():
            index.picture(run.id, 0)
        search(index, "grasper touching gallbladder")

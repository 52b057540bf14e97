"""Everything that reads a file which may come from elsewhere: what it reads, and how a program would go on with it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from degense.app.batch.folder import BatchFolder
from degense.app.batch.plan_file import read_plan
from degense.app.features.annotate.state import AnnotationState
from degense.app.features.cameras.state import CameraBook, load_path
from degense.app.features.documents.fact_rows import run_facts
from degense.app.features.events.state import Events
from degense.app.features.measure.state import Measures
from degense.app.features.prompts.mask_statistics import AreaCurves
from degense.app.features.runs.run_summaries import summary, training_answers
from degense.app.features.tracks.state import TrackedPoints
from degense.app.research.reliability import data_sets, samples
from degense.app.session.session import Session
from degense.app.shell.settings import SettingsFile
from degense.engine.annotation import folder as annotation_folder
from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.archive.index_file import open_index
from degense.engine.archive.indexing import update_index
from degense.engine.archive.search import search
from degense.engine.data.files.point_files import read_points
from degense.engine.data.files.stored import describe, fingerprint
from degense.engine.data.readers import open_clip
from degense.engine.events import read_progress
from degense.engine.progress import finish
from degense.engine.scene import Scene
from degense.engine.semantics.models.model_folder import read_config
from degense.engine.semantics.teachers.precomputed import PrecomputedTeacher
from degense.engine.semantics.text.text_vectors import TextVectors, write_vectors
from degense.engine.training.checkpoint import load_checkpoint


@dataclass(frozen=True)
class Reader:
    """`make(folder)` writes a sound input there and returns its path; `read(path)` uses it; `spoilt` are patterns of files to damage."""

    name: str
    make: Callable[[Path], Path]
    read: Callable[[Path], object]
    spoilt: tuple[str, ...] = ("**/*",)


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
    seldom = (
        "**/*.json",
        "**/*.json",
        "**/*.np[yz]",
        "**/*.bin",
        "**/*.txt",
        "**/*.yaml",
        "**/*",
    )  # pictures are the most, and need not be
    found = [Reader(f"clip {name}", _under(make), _use_clip, seldom) for name, make in clips.items()]
    found += [Reader("clip video", lambda folder: samples.video(folder / "clip.mp4"), _use_clip)]
    found += [Reader(f"labels {name}", partial(samples.labels, name), partial(_use_labels, name, *small)) for name in LABEL_FORMATS]
    found += [Reader(f"points {kind}", partial(samples.points, kind), _use_points) for kind in ("json", "csv", "npz")]
    trees = {"stir": data_sets.stir, "vl-surgpt": data_sets.vl_surgpt, "surgt": data_sets.surgt}
    of_points = ("**/*seg.png", "**/labels.json", "**/*.yaml")
    found += [Reader(f"points {name}", _under(make), _use_points, of_points) for name, make in trees.items()]
    run = _under(samples.run)
    found += [
        Reader("annotations", samples.annotated, _use_annotations),
        Reader("run", run, _use_scene, ("**/run.json", "**/run.json", "input/*")),
        Reader("run in the list", run, lambda path: (summary(path), training_answers(path)), ("**/*.json", "**/*.jsonl")),
        Reader("metrics.jsonl", run, lambda path: read_progress(path / "metrics.jsonl"), ("**/*.jsonl",)),
        Reader("checkpoint", _checkpoint, load_checkpoint),
        Reader("features of a teacher", _features, _use_features, ("**/features/*",)),
        Reader("text vectors", _vectors, lambda path: TextVectors.read(path).with_classes(samples.CLASSES[:1])),
        Reader("model configuration", _config, read_config),
        Reader("session", _session, _use_session, ("**/session.json",)),
        Reader("journal", _journal, _use_session, ("**/session.journal",)),
        Reader("camera path", _camera_path, load_path),
        Reader("settings", _settings, lambda path: SettingsFile(path).value),
        Reader("plan", _plan, read_plan),
        Reader("batch folder", _batch, _use_batch, ("**/batch.json", "**/jobs/*.json")),
        Reader("index", _index, _use_index, ("**/*.sqlite",)),
    ]
    return found


def _under(make: Callable[[Path], Path]) -> Callable[[Path], Path]:
    return lambda folder: make(folder / "input")


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


def _use_scene(path: Path) -> None:
    scene = Scene.open(path, device="cpu")
    run_facts(scene)
    scene.camera(0), scene.clip_size, scene.fps, scene.unit


def _checkpoint(folder: Path) -> Path:
    import torch

    from degense.engine.training.checkpoint import PARTS, save_checkpoint

    parts = {part: {"a": torch.ones(4), "disagreement": torch.zeros(())} for part in PARTS}
    save_checkpoint(folder, {**parts, "generator": torch.zeros(16, dtype=torch.uint8), "plain": {"iteration": 7, "rate_scale": 1.0}})
    return folder


def _vectors(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    write_vectors(folder / "vectors.safetensors", {name: rng.normal(size=16) for name in samples.CLASSES}, "sample")
    return folder / "vectors.safetensors"


def _features(folder: Path) -> Path:
    """Features of a frame's segments beside a clip."""
    rng, clip = np.random.default_rng(0), samples.phantom(folder / "input")
    (clip / "features").mkdir()
    names = json.loads((clip / "classes.json").read_text(encoding="utf-8"))["classes"]
    write_vectors(clip / "features" / "text_vectors.safetensors", {name: rng.normal(size=8) for name in names}, "sample")
    np.save(clip / "features" / "000000_s.npy", np.maximum(samples.label_map(3), 1)[None].astype(np.int32) % 3)
    np.save(clip / "features" / "000000_f.npy", rng.normal(size=(3, 8)).astype(np.float32))
    return clip


def _use_features(path: Path) -> None:
    PrecomputedTeacher(open_clip(path), path / "features").targets(0)


def _config(folder: Path) -> Path:
    text = {"model_type": "clip", "text_config": {"hidden_size": 32, "layers": 2}, "vision_config": {"image_size": 32}}
    return _written(folder / "config.json", json.dumps(text))


def _states() -> tuple[Session, AnnotationState]:
    """A session without a window, with all states that are saved."""
    session = Session()
    annotations = AnnotationState(session)
    undone = {"cameras": CameraBook, "events": Events, "measures": Measures, "tracks": TrackedPoints}
    states = {"annotations": annotations, "areas": AreaCurves()} | {name: kind(session.undo) for name, kind in undone.items()}
    for name, state in states.items():
        session.register(name, state)
    return session, annotations


def opened_session(folder: Path) -> tuple[Session, AnnotationState]:
    """A session in which a run of the sample's size is open; its state folder lies beside it."""
    import os

    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    session, annotations = _states()
    run = SimpleNamespace(path=folder, info={})
    scene: Any = SimpleNamespace(name="sample", frames=samples.FRAMES, clip_size=(samples.WIDTH, samples.HEIGHT), clip=None, run=run)
    scene.classes, scene.labels, scene.question, scene.has_semantics = samples.CLASSES, lambda frame: None, lambda text: None, False
    session.open_scene(scene)
    return session, annotations


def paint(folder: Path) -> None:
    session, annotations = opened_session(folder)
    annotations.begin("Brush")
    for x in range(4, 20, 4):
        from degense.engine.annotation.painting import brush

        annotations.dab(brush((x, 10), (x + 4, 12), 3, samples.SHAPE))
    annotations.end()
    annotations.add_class("spleen")
    session.close()


def _session(folder: Path) -> Path:
    paint(folder)
    session, _ = opened_session(folder)
    session.recover()
    session.save()
    session.close()
    return folder


def _journal(folder: Path) -> Path:
    paint(folder)
    return folder


def _use_session(folder: Path) -> None:
    session, annotations = opened_session(folder)
    if session.store.unsaved:
        session.recover()
    if annotations.work is not None:
        annotations.labels(0)
    session.save()
    session.close()


def _written(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def _camera_path(folder: Path) -> Path:
    from degense.app.features.cameras.state import Stop, save_path
    from degense.engine.camera import Camera

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
    from degense.app.batch.folder import JobRecord

    for job in jobs:
        batch.keep(job, JobRecord({"train": job.stages()["train"]}, {"train": 1.5}))
    return batch.path


def _use_batch(path: Path) -> None:
    from degense.app.batch.report import write_report

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
    from degense.engine.archive.index_file import INDEX

    with open_index(path / INDEX) as index:
        for run in index.runs():
            index.picture(run.id, 0)
        search(index, "grasper touching gallbladder")

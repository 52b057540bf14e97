"""Camera poses from the frames: how far off they are, what "auto" decides, and what they do to a reconstruction."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.poses import find_cameras
from degense.engine.data.poses.tracks import PIXELS
from degense.engine.data.readers import ClipOptions, open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.metrics.evaluate import evaluate
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Column, Table
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train

MOTION = 8.0  # mm: amplitude of the camera's path in the trainings
SIZES = {"cpu": (40, 240, 192), "cuda": (60, 640, 512)}  # frames, width, height
TRAINED = {"cpu": ("quick", 800), "cuda": ("balanced", 3000)}  # preset, iterations
CAMERAS = {"true": ClipOptions(poses="auto"), "estimated": ClipOptions(poses="estimate"), "still": ClipOptions(poses="still")}


def run(options: BenchOptions, progress: Progress = silent) -> Iterator[Table]:
    """Two tables: poses against truth, and trainings with true, estimated and no camera motion."""
    size = _size(options)
    phantoms = {
        (motion, seed): _phantom(options.scratch / f"camera-{motion:g}-{seed}", PhantomOptions(*size, seed, motion))
        for motion in (0.0, 3.0, MOTION, 12.0)
        for seed in options.seeds
    }
    yield _accuracy(phantoms, options, progress)
    yield _trainings({seed: phantoms[MOTION, seed] for seed in options.seeds}, options, progress)


def _size(options: BenchOptions) -> tuple[int, int, int]:
    return (24, 160, 128) if options.quick else SIZES[options.device]


def _words(options: BenchOptions) -> str:
    frames, width, height = _size(options)
    return f"{frames} frames, {width} × {height}, seeds {', '.join(map(str, options.seeds))}"


def _phantom(path: Path, wanted: PhantomOptions) -> Path:
    make_phantom(path, wanted)
    return path


def _accuracy(phantoms: dict[tuple[float, int], Path], options: BenchOptions, progress: Progress) -> Table:
    table = Table(
        "cameras-accuracy",
        "Camera poses from the frames, against exact ones",
        f"Phantoms that breathe and are pulled, {_words(options)}, exact depth; poses estimated from training frames only, errors over all "
        f"frames; nothing is aligned. Frames are matched at {PIXELS:,} pixels. Real clips have no truth.",
        [
            Column("clip", "clip"),
            Column("seconds", "s"),
            Column("place", "mean error, mm", middle="mean"),
            Column("worst", "largest error, mm", middle="mean"),
            Column("turn", "mean error, degrees", 3, middle="mean"),
            Column("auto", "what `auto` decides"),
        ],
    )
    for motion in dict.fromkeys(motion for motion, _ in phantoms):
        seconds, place, worst, turn, decided = [], [], [], [], []
        for seed in options.seeds:
            path = phantoms[motion, seed]
            progress(0.1, f"finding the camera of {path.name}")
            begin = time.perf_counter()
            found = find_cameras(open_clip(path, ClipOptions(poses="estimate")))
            seconds.append(time.perf_counter() - begin)
            distances, degrees = pose_errors(found.cameras, open_clip(path).cameras)
            place.append(float(distances.mean()))
            worst.append(float(distances.max()))
            turn.append(float(degrees.mean()))
            decided.append(_decided(path))
        table.rows.append(
            {
                "clip": f"phantom, camera path {motion:g} mm",
                "seconds": seconds,
                "place": place,
                "worst": worst,
                "turn": turn,
                "auto": "; ".join(dict.fromkeys(decided)),
            }
        )
    for path in options.clips:
        begin = time.perf_counter()
        words = _decided(path)
        table.rows.append({"clip": path.name, "seconds": [time.perf_counter() - begin], "auto": words})
    return table


def _decided(path: Path) -> str:
    """What "auto" makes of a clip, in its own words, whatever poses the clip brings."""
    clip = open_clip(path, ClipOptions(poses="estimate"))
    clip.poses = "auto"
    return find_cameras(clip).provenance["poses"]


def _trainings(clips: dict[int, Path], options: BenchOptions, progress: Progress) -> Table:
    preset, iterations = ("quick", 400) if options.quick else TRAINED[options.device]
    config = TrainConfig.preset_of(preset, device=options.device, iterations=iterations)
    scores = ("psnr_mask", "displacement_error", "displacement_correlation", "recovered_share", "spurious_displacement")
    table = Table(
        "cameras-training",
        "What the cameras do to a reconstruction",
        f"Phantom with a camera path of {MOTION:g} mm, {_words(options)}, {config.preset} preset, {config.iterations} steps, no semantics; "
        "held-out frames. Displacement against truth in world axes, over all frames.",
        [
            Column("cameras", "cameras"),
            Column("psnr_mask", "`psnr_mask` dB", middle="mean"),
            Column("displacement_error", "mean error of displacement, mm", 3, middle="mean"),
            Column("displacement_correlation", "correlation", 3, middle="mean"),
            Column("recovered_share", "recovered share", 3, middle="mean"),
            Column("spurious_displacement", "spurious, mm", 3, middle="mean"),
            Column("true_displacement", "true, mm", 3, middle="mean"),
        ],
    )
    for name, answers in CAMERAS.items():
        cells: dict[str, list[float]] = {key: [] for key in (*scores, "true_displacement")}
        for seed, path in clips.items():
            progress(0.2, f"training with {name} cameras")
            result = _score(
                open_clip(path, answers),
                options.scratch / f"cameras-{name}-{seed}",
                TrainConfig.from_json(config.to_json() | {"seed": seed}),
            )
            for key, values in cells.items():
                values.append(float(result[key]))
        table.rows.append({"cameras": name, **cells})
    return table


def _score(clip: Clip, out: Path, config: TrainConfig) -> dict:
    train(clip, out, config, teacher="none", events=lambda event: None, stop=lambda: False)
    return evaluate(Scene.open(out, device=config.device, clip=clip), clip)


def pose_errors(estimated: Sequence[Camera], true: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
    """Distance between the centres and angle between the rotations of every frame's cameras, float64 [T] each, clip units and degrees.

    Both start from the same first camera; nothing is aligned, neither place nor scale.
    """
    ours, theirs = (np.stack([camera.viewmat for camera in cameras]) for cameras in (estimated, true))
    centres = [-np.einsum("tji,tj->ti", views[:, :3, :3], views[:, :3, 3]) for views in (ours, theirs)]
    turns = Rotation.from_matrix(ours[:, :3, :3] @ theirs[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return np.linalg.norm(centres[0] - centres[1], axis=1), np.degrees(turns)

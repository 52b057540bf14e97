"""Prompts asked of a whole clip: how long it takes, and that doing all at once changes nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from statistics import median

import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.scenes import trained_scene, with_count
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import encode_prompts, query_clip
from degense.engine.semantics.prompts import PromptSet

#: Gaussians, picture and frames of the clips; a GPU has the larger scene too.
STAGES = {"cpu": ((30_000, 854, 480, 81),), "cuda": ((30_000, 854, 480, 81), (100_000, 854, 480, 81))}
QUICK_STAGES = ((3_000, 160, 128, 9),)
PROMPTS = ("liver", "gallbladder", "fat", "grasper", "hook")
ROUNDS = 3  # of a whole clip
ALONE = 6  # frames on which prompts are asked one by one


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    trained, words = trained_scene(options, lambda fraction, message: progress(0.6 * fraction, message))
    table = Table(
        "query-clip",
        "A whole clip asked in words",
        f"{words[0].upper()}{words[1:]}, drawn at the size named. Prompts: {', '.join(PROMPTS)}; decoder rnse; all classes of the scene "
        "compete. States are baked before, nothing else: each frame is drawn, its superpixels and similarities found, its "
        f"masks decoded and read into memory. The middle of {ROUNDS} rounds and, in brackets, the least and the greatest. CPU time is of "
        f"all threads. One by one: {ALONE} frames spread over the clip, drawn anew for each prompt.",
        [
            Column("scene", "scene"),
            Column("what", "what"),
            Column("frames", "frames", 0),
            Column("seconds", "time, s", 2),
            Column("cpu", "CPU time, s", 2),
            Column("time", "a frame, ms", 1),
            Column("differ", "pixels unlike one by one", 0),
        ],
    )
    stages = QUICK_STAGES if options.quick else STAGES[options.device]
    for done, (count, width, height, frames) in enumerate(stages):
        progress(0.6 + 0.4 * done / len(stages), f"asking a clip of {frames} frames")
        scene = long_scene(with_count(trained, count), width, height, frames)
        for frame in range(frames):
            scene.splats(frame, semantics=True)
        some = np.unique(np.linspace(0, frames - 1, ALONE).round().astype(int)).tolist()
        one_by_one = {frame: _alone(scene, frame) for frame in some}  # compiles and loads what the first call needs, too
        for what, prompts in ((f"{len(PROMPTS)} prompts in one pass", PROMPTS), ("1 prompt", PROMPTS[:1])):
            table.rows.append(_timed(scene, what, prompts, one_by_one, options))
        row = _clocked(lambda scene=scene, some=some: [_alone(scene, frame) for frame in some], len(some), options)  # type: ignore[misc]
        table.rows.append({"what": f"{len(PROMPTS)} prompts one by one", **row})
        for added in table.rows[-3:]:
            added["scene"] = f"{count:,} Gaussians, {width} × {height}"
    yield table


def long_scene(scene: Scene, width: int, height: int, frames: int) -> Scene:
    """The same scene as a clip of so many frames of such a size; as wide as before, cut or extended above and below."""
    camera = scene.camera(0)
    factor = width / camera.width
    resized = Camera(width, height, camera.fx * factor, camera.fy * factor, width / 2, height / 2, camera.viewmat)
    other = Scene(scene.run, scene.model, scene.basis, scene.encoder, None)
    other.cameras = [resized] * frames
    return other


def _alone(scene: Scene, frame: int) -> np.ndarray:
    """The mask of each prompt, bool [n, H, W], with nothing kept from one to the next."""
    asked = [encode_prompts(scene, PromptSet((text,))) for text in PROMPTS]
    return np.concatenate([scene.renderer.new_query(frame, scene.camera(frame)).decode(of_text).masks for of_text in asked])


def _timed(scene: Scene, what: str, prompts: Sequence[str], one_by_one: dict[int, np.ndarray], options: BenchOptions) -> dict[str, Cell]:
    differ = 0

    def ask() -> None:
        nonlocal differ
        scene.renderer.forget()
        found = {frame: answer.masks for frame, answer in query_clip(scene, PromptSet(tuple(prompts))) if frame in one_by_one}
        differ = sum(int((masks != one_by_one[frame][: len(prompts)]).sum()) for frame, masks in found.items())

    return {"what": what, **_clocked(ask, scene.frames, options), "differ": differ}


def _clocked(work: Callable[[], object], frames: int, options: BenchOptions) -> dict[str, Cell]:
    """Wall and CPU time of some rounds."""
    wall, cpu = [], []
    for _ in range(min(ROUNDS, options.repeats)):
        begin, used = time.perf_counter(), time.process_time()
        work()
        if options.device == "cuda":
            torch.cuda.synchronize()
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - used)
    return {"frames": frames, "seconds": wall, "cpu": cpu, "time": 1e3 * median(wall) / frames}

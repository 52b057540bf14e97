"""Looking and asking: how fast a scene plays, and how soon a prompt is answered."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from statistics import median

import numpy as np
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.progress import Progress
from degense.engine.raster import rasterize
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.scenes import trained_scene, with_count
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.timing import measure, percentile, throughput
from degense.engine.research.benchmarks.raster import back_ends
from degense.engine.scene import Scene
from degense.engine.semantics.prompts import PromptVectors
from degense.engine.splats import Splats

#: Gaussians and picture of what is played.
STAGES = ((30_000, 640, 512), (100_000, 854, 480))
QUICK_STAGES = ((3_000, 160, 128),)
ROUNDS = 5  # of playing: raw drawing and the others take turns, so that a busy machine slows them alike
SECONDS = {"cpu": 1.0, "cuda": 0.25}  # one round takes about so long


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    trained, words = trained_scene(options, lambda fraction, message: progress(0.5 * fraction, message))
    stages = QUICK_STAGES if options.quick else STAGES
    yield _playback(trained, stages, words, options, lambda fraction, message: progress(0.5 + 0.3 * fraction, message))
    yield _prompts(trained, stages, words, options, lambda fraction, message: progress(0.8 + 0.2 * fraction, message))


def _playback(trained: Scene, stages: tuple[tuple[int, int, int], ...], words: str, options: BenchOptions, progress: Progress) -> Table:
    rounds = 2 if options.quick else ROUNDS
    table = Table(
        "viewing-playback",
        "Playing a scene",
        f"{words[0].upper()}{words[1:]}. Colour only, frame after frame, from the surgeon's view. Frames a second: {rounds} rounds in "
        "which all rows take turns, the GPU's queue (if any) awaited at the end of a round only, as a player does; the middle round and, "
        f"in brackets, the least and the greatest. Milliseconds: {options.repeats} single frames, each awaited. Raw drawing has the states "
        f"of all frames at hand and calls the back end alone. Latents: {trained.model.config.rank} a Gaussian.",
        [
            Column("scene", "scene"),
            Column("what", "what"),
            Column("rate", "frames a second", 0),
            Column("share", "of the first row, %", 0),
            Column("time", "one frame: median, ms", 2),
            Column("late", "95th percentile, ms", 2),
        ],
    )
    for done, (count, width, height) in enumerate(stages):
        progress(done / len(stages), f"playing {count:,} Gaussians")
        scene = with_count(trained, count)
        works = _players(scene, _view(scene, width, height))
        rates: dict[str, list[float]] = {what: [] for what in works}
        for _ in range(rounds):
            for what, work in works.items():
                pace = throughput(work, 3, options.device)
                rates[what].append(throughput(work, max(5, int(pace * SECONDS[options.device])), options.device, warm=0))
        first = rates[next(iter(works))]
        for what, work in works.items():
            turn = iter(range(1_000_000))
            times = measure(lambda work=work, turn=turn: work(next(turn)), options.repeats, options.device)  # type: ignore[misc]
            row: dict[str, Cell] = {"scene": f"{count:,}, {width} × {height}", "what": what, "rate": rates[what]}
            row |= {"share": 100 * median(rates[what]) / median(first), "time": median(times), "late": percentile(times, 95)}
            table.rows.append(row)
    return table


def _players(scene: Scene, camera: Camera) -> dict[str, Callable[[int], object]]:
    """Draws frame i, by name; raw drawing first."""
    frames = scene.frames
    states = [scene.splats(i) for i in range(frames)]

    def splats_drawn(splats: Splats) -> Tensor:
        return rasterize(splats, splats.colors, camera, clean=True).image

    def raw(i: int, name: str) -> Tensor:
        state = states[i % frames]
        return draws[name](replace(state, semantics=state.colors), camera)

    def live(i: int, *, semantics: bool = False) -> Splats:
        return scene.states.live(scene.time(i % frames), semantics=semantics)

    draws = back_ends(scene.model.bounds.device.type)
    works: dict[str, Callable[[int], object]] = {
        f"raw: {name}": lambda i, name=name: raw(i, name)  # type: ignore[misc]
        for name in reversed(draws)  # gsplat's own first, where there is one
    }
    return works | {
        "baked states, drawn": lambda i: splats_drawn(scene.splats(i % frames)),
        "baked states, drawn and fetched as an array": lambda i: scene.renderer.draw(i % frames, camera, ("rgb",)),
        "live field, drawn": lambda i: splats_drawn(live(i)),
        "live field alone": live,
        "live field with latents, drawn": lambda i: splats_drawn(live(i, semantics=True)),
        "live field with latents, alone": lambda i: live(i, semantics=True),
    }


def _view(scene: Scene, width: int, height: int) -> Camera:
    """The surgeon's view with a picture of another size: as wide as before, cut or extended above and below."""
    camera = scene.camera(0)
    factor = width / camera.width
    return Camera(width, height, camera.fx * factor, camera.fy * factor, width / 2, height / 2, camera.viewmat)


def _prompts(trained: Scene, stages: tuple[tuple[int, int, int], ...], words: str, options: BenchOptions, progress: Progress) -> Table:
    table = Table(
        "viewing-prompts",
        "Asking in words",
        f"{words[0].upper()}{words[1:]}. From the prompt's vector to the binary mask (decoder rnse); states are baked, everything else "
        f"that a new frame needs is computed: drawing of colour and {trained.model.config.rank} semantic channels, superpixels, "
        f"similarities, filter. {options.repeats} repeats after one that warms up.",
        [
            Column("scene", "scene"),
            Column("what", "what"),
            Column("time", "median, ms", 1),
            Column("late", "95th percentile, ms", 1),
            Column("rate", "a second", 0),
        ],
    )
    vectors = trained.vectors(trained.classes)
    for done, (count, width, height) in enumerate(stages):
        progress(done / len(stages), "asking")
        scene = with_count(trained, count)
        for what, work in _questions(scene, _view(scene, width, height), vectors).items():
            turn = iter(range(1_000_000))
            times = measure(lambda work=work, turn=turn: work(next(turn)), options.repeats, options.device, warm=1)  # type: ignore[misc]
            row: dict[str, Cell] = {"scene": f"{count:,}, {width} × {height}", "what": what, "time": median(times)}
            table.rows.append(row | {"late": percentile(times, 95), "rate": 1e3 / median(times)})
    return table


def _questions(scene: Scene, camera: Camera, vectors: np.ndarray) -> dict[str, Callable[[int], object]]:
    """Answers prompt i, by name."""
    for i in range(scene.frames):
        scene.splats(i, semantics=True)
    kept = scene.renderer.new_query(scene.frames // 2, camera)
    kept.decode(PromptVectors((vectors[0],), classes=vectors))
    random = np.random.default_rng(0)

    def fresh(row: int) -> np.ndarray:
        # a direction near a class that was not asked before, so that nothing is answered from kept maps
        return vectors[row] + random.normal(0, 1e-6, vectors.shape[1])

    return {
        "first prompt on a new frame, all other classes competing": lambda i: scene.renderer.new_query(i % scene.frames, camera).decode(
            PromptVectors((vectors[0],), classes=vectors)
        ),
        "another prompt on that frame": lambda i: kept.decode(PromptVectors((fresh(1),))),
        "another prompt, all other classes competing": lambda i: kept.decode(PromptVectors((fresh(2),), classes=vectors)),
        "another threshold": lambda i: kept.decode(PromptVectors((vectors[0],), threshold=0.3 + 0.001 * (i % 400))),
    }

"""Whether the displayed uncertainty of displacement is right: how often its bound is kept, and whether it sorts the errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.surgeries import DEVELOP
from degense.engine.scene import Scene
from degense.engine.scene.uncertainty import DOUBTFUL, RELATIVE, SURE, is_guess
from degense.engine.training import TrainConfig, train

#: Surgeries of the family on which neither the bound nor what counts as a guess was chosen, and nothing is reported.
FIRST, SCENES = 41, 5
STEPS = 10  # points of the curve


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """Two tables: a row for each surgery, and the errors of the surest share of all of them."""
    frames, width, height = (12, 96, 80) if options.quick else (40, 160, 128)
    scenes = DEVELOP[FIRST : FIRST + (1 if options.quick else SCENES)]
    changes = {"iterations": 60, "max_gaussians": 1500} if options.quick else {}
    told, rows = [], []
    for done, seed in enumerate(scenes):
        progress(done / len(scenes), f"surgery {seed}")
        folder = options.scratch / f"surgery-{seed}"
        make_phantom(folder, PhantomOptions(frames, width, height, seed, kind="family"), lambda fraction, words: None)
        clip, out = open_clip(folder), options.scratch / f"run-{seed}"
        config = TrainConfig.preset_of("quick", device=options.device, **changes)
        train(clip, out, config, teacher="labels", events=lambda event: None, stop=lambda: False)
        scene = Scene.open(out, device=options.device, clip=clip)
        told.append(errors(scene, clip))
        rows.append({"surgery": str(seed), **figures(told[-1])})
    words = f"Surgeries {scenes[0]} to {scenes[-1]} of the family, {frames} frames, {width} × {height}, preset quick, exact depth. "
    yield bounds_table(words, [*rows, {"surgery": "all", **figures(np.concatenate(told, 1))}])
    yield curve_table(words, np.concatenate(told, 1))


def errors(scene: Scene, clip: Clip) -> np.ndarray:
    """Error of the displacement, its bound and itself as shares of the scene's depth, float32 [3, n]; tissue of every third frame."""
    truth, found = clip.truth(), []
    if truth is None:
        raise DegenseError(f"{clip.name} has no exact truth.")
    for frame in range(0, len(clip), 3):
        if frame != scene.reference_frame:
            drawn = scene.render(frame, None, ("displacement", "uncertainty"))
            off = np.abs(drawn["displacement"] - np.linalg.norm(truth.displacement[frame].astype(np.float64), axis=-1))
            counted = np.isfinite(off) & clip.valid(frame)
            found.append(np.stack([values[counted] for values in (off, drawn["uncertainty"], drawn["displacement"])]) / scene.states.depth)
    return np.concatenate(found, 1).astype(np.float32)


def figures(told: np.ndarray) -> dict[str, Cell]:
    """The columns of a row of the first table, from what `errors` returns."""
    off, bound, moved = told
    guess, good = is_guess(bound, moved, 1.0), off <= SURE
    by_chance, best = float(off.mean()), risk(off, off).mean()
    return {
        "error": 1000 * by_chance,
        "kept": 100 * float((off <= bound).mean()),
        "kept_sure": _percent(good[~guess]),
        "guesses": 100 * float(guess.mean()),
        "good_guesses": _percent(guess[good]),
        "error_sure": 1000 * float(off[~guess].mean()) if not guess.all() else None,
        "error_guess": 1000 * float(off[guess].mean()) if guess.any() else None,
        "order": 100 * float((by_chance - risk(off, bound).mean()) / max(by_chance - best, 1e-12)),
    }


def risk(off: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """Mean error of the 1, 2, … n values that are doubted least, [n]."""
    return np.cumsum(off[np.argsort(doubt, kind="stable")].astype(np.float64)) / np.arange(1, len(off) + 1)


def bounds_table(words: str, rows: list[dict[str, Cell]]) -> Table:
    """The first table."""
    return Table(
        "observability-bounds",
        "The bound on the error of displacement, and what counts as a guess",
        f"{words}Tissue pixels of every third frame; lengths as thousandths of the scene's depth. A bound of more than {1000 * DOUBTFUL:g} "
        f"and {RELATIVE:.0%} of the displacement is a guess; an error of at most {1000 * SURE:g} is good. Order: mean error of the surest "
        "share, over all shares (the curve below), 0 by chance, 100 at best.",
        [
            Column("surgery", "surgery"),
            Column("error", "mean error"),
            Column("kept", "bound kept, %", 1),
            Column("kept_sure", "good where sure, %", 1),
            Column("guesses", "guesses, %", 1),
            Column("good_guesses", "guesses among the good, %", 1),
            Column("error_sure", "mean error where sure"),
            Column("error_guess", "mean error of guesses"),
            Column("order", "order, %", 1),
        ],
        rows,
    )


def curve_table(words: str, told: np.ndarray) -> Table:
    """The second table: risk against coverage."""
    off, bound, _ = told
    curves = {"uncertainty": risk(off, bound), "best": risk(off, off), "chance": np.full(len(off), off.mean())}
    ends = [round(len(off) * step / STEPS) - 1 for step in range(1, STEPS + 1)]
    rows: list[dict[str, Cell]] = [
        {"share": 100 * step / STEPS, **{name: 1000 * float(curve[end]) for name, curve in curves.items()}}
        for step, end in enumerate(ends, 1)
    ]
    return Table(
        "observability-risk",
        "Mean error of the surest pixels",
        f"{words}Tissue pixels of every third frame, all surgeries pooled; errors as thousandths of the scene's depth.",
        [
            Column("share", "surest share of the pixels, %", 0),
            Column("uncertainty", "sorted by the uncertainty shown"),
            Column("chance", "by chance"),
            Column("best", "by the errors themselves"),
        ],
        rows,
        curves=("share", "uncertainty", "chance", "best"),
    )


def _percent(values: np.ndarray) -> float | None:
    return 100 * float(values.mean()) if values.size else None

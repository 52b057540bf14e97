"""Training on clips that nobody wants, and scoring what comes out."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from functools import partial
from pathlib import Path

from degense.engine.data.readers import ClipOptions, open_clip
from degense.engine.errors import DegenseError
from degense.engine.events import Event, Rollback, TrainingProgress
from degense.engine.metrics.evaluate import evaluate
from degense.engine.progress import Progress, silent
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Table
from degense.engine.research.stress.clip_cases import ClipCase, clip_cases
from degense.engine.research.stress.outcome import COLUMNS, StressFinding, non_finite, row
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train

STEPS = 120  # past the first densification and the first look at whether all is finite


def table(options: BenchOptions, progress: Progress = silent) -> Table:
    """All clips."""
    rows, cases = [], clip_cases()
    steps = STEPS if not options.quick else 20
    for i, case in enumerate(cases):
        progress(i / len(cases), case.name)
        rows.append(row(case.name, partial(clip_finding, case, options.scratch / "clip", options.device, steps)))
    return Table(
        "stress-clips",
        "Hostile clips",
        f"A phantom of 12 frames of 64 × 48 pixels, spoilt; opened, trained for {steps} steps (preset quick, 400 Gaussians, seed 0) "
        "and scored as `degense eval` does. Counted as numbers out: all tensors of the model, every score, colour, alpha and latents "
        "drawn of the first and the last frame. Refused: the sentence that the user reads.",
        [column for column in COLUMNS if column.key in ("case", "outcome", "bad", "seconds")],
        rows,
    )


def clip_finding(case: ClipCase, folder: Path, device: str, steps: int) -> StressFinding:
    """One clip, from its files to its scores. `folder` is made and taken away again."""
    try:
        return try_clip(case, folder, device, steps)
    except DegenseError as error:
        message = str(error).replace(str(folder), "…")
        return StressFinding(outcome=f"{'refused' if case.refused else 'REFUSED'}: {message}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def try_clip(case: ClipCase, folder: Path, device: str, steps: int) -> StressFinding:
    """`clip_finding` that lets sentences through and leaves its files."""
    clip = open_clip(case.make(folder / "clip"), ClipOptions(mask_means="tool"))
    config = TrainConfig.preset_of("quick", iterations=steps, max_gaussians=400, resolution=8, channels=8, device=device)
    events: list[Event] = []
    run = train(clip, folder / "run", config, events=events.append, stop=lambda: False)
    assert run is not None
    scene = Scene.open(run.path, device=device, clip=clip)
    what = ("rgb", "latent") if scene.has_semantics else ("rgb",)
    out: list[object] = [dict(scene.model.state_dict()), evaluate(scene, clip), *(scene.render(i, what=what) for i in {0, len(clip) - 1})]
    out.append([asdict(event) for event in events if isinstance(event, TrainingProgress)])
    if case.refused:
        return StressFinding(non_finite(out), "TRAINED, THOUGH IT CANNOT HAVE LEARNT ANYTHING")
    rollbacks = sum(isinstance(event, Rollback) for event in events)
    return StressFinding(non_finite(out), f"ok, after {rollbacks} rollbacks" if rollbacks else "ok")

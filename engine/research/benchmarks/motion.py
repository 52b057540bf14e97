"""Each ingredient of motion on and off, against exact displacement. Only weights change: 0 is off."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from degense.engine.data.readers import open_clip
from degense.engine.progress import Progress
from degense.engine.research.baselines import ClipFlow
from degense.engine.research.baselines.motion import motion_baselines
from degense.engine.research.bench.baseline_rows import add_baselines
from degense.engine.research.bench.run import BenchOptions
from degense.engine.research.bench.table import Cell, Column, Table
from degense.engine.research.bench.trainings import BenchTraining, base_config, phantoms, protocol, score_all

#: What is taken away, and the settings that do it.
INGREDIENTS: dict[str, dict[str, Any]] = {
    "default": {},
    "no optical flow": {"flow": 0.0},
    "no depth supervision": {"depth": 0.0},
    "no rigidity": {"rigidity": 0.0},
    "no displacement sparsity": {"displacement": 0.0},
    "no Ψ_app": {"appearance": False},
    "no temporal windows": {"persistent": True},
    "no velocities": {"velocities": False},
    "no plane smoothness": {"plane_space": 0.0, "plane_time": 0.0, "plane_static": 0.0},
    "none of them": {
        "flow": 0.0,
        "depth": 0.0,
        "rigidity": 0.0,
        "displacement": 0.0,
        "appearance": False,
        "persistent": True,
        "velocities": False,
        "plane_space": 0.0,
        "plane_time": 0.0,
        "plane_static": 0.0,
    },
}
COLUMNS = [
    Column("what", "training"),
    Column("displacement_correlation", "correlation", 3, "mean"),
    Column("recovered_share", "recovered share", 3, "mean"),
    Column("relative", "mean error / mean true motion", 3, "mean"),
    Column("displacement_error", "mean error, mm", 3, "mean"),
    Column("spurious_displacement", "spurious, mm", 3, "mean"),
    Column("spurious_displacement_revealed", "… not marked as a guess, mm", 3, "mean"),
    Column("spurious_share", "spurious / largest true motion", 4, "mean"),
    Column("false_motion", "false motion, mm", 3, "mean"),
    Column("psnr_mask", "PSNR, dB", 2, "mean"),
    Column("ssim", "SSIM", 3, "mean"),
    Column("train_seconds", "training, s", 0, "mean"),
]

#: Columns that optical flow has too, and whether larger is better.
COMPARED = {
    "displacement_correlation": ("displacement_correlation", True),
    "recovered_share": ("recovered_share", True),
    "relative": ("relative", False),
    "displacement_error": ("displacement_error", False),
}


def run(options: BenchOptions, progress: Progress) -> Iterator[Table]:
    """A table for each phantom."""
    clips = phantoms(options, lambda fraction, words: progress(0.03 * fraction, words))
    for number, (kind, clip) in enumerate(clips.items()):
        trainings = [
            BenchTraining(clip, options.scratch / f"motion-{kind}-{i}-{seed}", base_config(options, seed=seed, **changes), "none")
            for i, changes in enumerate(INGREDIENTS.values())
            for seed in options.seeds
        ]

        def tell(fraction: float, words: str, n: int = number) -> None:
            progress(0.03 + 0.97 * (n + fraction) / len(clips), words)

        scores = score_all(trainings, options, tell, f"{kind}: trainings")
        count = len(options.seeds)
        found = {name: scores[i * count : (i + 1) * count] for i, name in enumerate(INGREDIENTS)}
        ingredients = table(kind, found, options)
        add_baselines(ingredients, {"chained optical flow": [flow_scores(clip)]}, COMPARED)
        yield ingredients


def flow_scores(clip: Path) -> dict[str, Any]:
    """Motion scores of optical flow, lifted with the clip's depth."""
    opened = open_clip(clip)
    scores = motion_baselines(opened, ClipFlow(opened))["chained optical flow"]
    return scores | {"relative": scores["displacement_error"] / scores["true_displacement"]}


def table(kind: str, found: dict[str, list[dict[str, Any]]], options: BenchOptions) -> Table:
    """One row an ingredient, and the answer “nothing moves”."""
    rows: list[dict[str, Cell]] = []
    for name, runs in found.items():
        for r in runs:
            r["relative"] = r["displacement_error"] / r["true_displacement"]
            r["spurious_share"] = r["spurious_displacement"] / r["largest_displacement"]
        rows.append({"what": name} | {c.key: [r[c.key] for r in runs if r[c.key] is not None] for c in COLUMNS[1:]})
    truth = next(iter(found.values()))[0]
    nothing = {"recovered_share": 0.0, "relative": 1.0, "displacement_error": truth["true_displacement"], "spurious_displacement": 0.0}
    rows.append({"what": "floor: nothing moves"} | nothing | {"spurious_share": 0.0, "false_motion": 0.0})
    words = (
        f"{protocol(options)} No teacher. Spurious: motion beyond the true one where tissue changes its look. False: on other tissue "
        f"that stands still. True motion: mean {truth['true_displacement']:.2f}, largest {truth['largest_displacement']:.1f} mm. "
        "“No temporal windows”: transient Gaussians are left out at the start."
    )
    return Table(f"motion-{kind}", f"Ingredients of motion, phantom “{kind}”", words, COLUMNS, rows)

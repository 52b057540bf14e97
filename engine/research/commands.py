"""What `bench`, `compare` and the report of `eval` do. The command line reaches them by name and imports no research."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from degense.engine.clip import Clip
from degense.engine.data.readers import open_clip
from degense.engine.errors import DegenseError
from degense.engine.progress import Progress, silent
from degense.engine.research.baselines import score_baselines
from degense.engine.research.bench.report import plain_section, save_table, write_report
from degense.engine.research.bench.run import BENCHES, CLIPS, Benches, BenchOptions, check_names, run
from degense.engine.research.comparison import SystemComparison
from degense.engine.research.report import MethodScores, pictures_of
from degense.engine.research.report import write_report as write_scores
from degense.engine.research.report.pictures import truths_of
from degense.engine.research.report.tables import tables_of
from degense.engine.research.systems import SYSTEMS, as_system
from degense.engine.scene import Scene
from degense.engine.training.config import TrainConfig, choose_device

SEEDS, REPEATS = 3, 15
QUICK_SEEDS, QUICK_REPEATS = 1, 5


def list_benchmarks(others: Benches) -> str:
    """The names of all benchmarks and what they answer, one a line."""
    benches = BENCHES | others
    width = max(map(len, benches))
    lines = [f"  {name:<{width}}  {text}" for name, (_, text) in benches.items()]
    return "\n".join(["Benchmarks; run some by name, or all of them with: degense bench all\n", *lines])


def run_benchmarks(
    names: Sequence[str],
    others: Benches,
    show: Callable[[str], None],
    progress: Progress,
    *,
    device: str = "auto",
    seeds: int | None = None,
    repeats: int | None = None,
    quick: bool = False,
    clips: Sequence[Path] = (),
    out: Path | None = None,
    sweep: Mapping[str, Any] | None = None,
) -> None:
    """Run benchmarks one after the other; each table is shown, and written to `out`, as soon as it is there.

    Parameters
    ----------
    names : sequence of str
        Of `BENCHES` and `others`, or "all" alone for those of `BENCHES` but `clips`.
    sweep : dict, optional
        What `surgeries` and `clips` are told beside the rest (`BenchOptions.sweep`).
    """
    benches = BENCHES | others
    chosen = [name for name in BENCHES if name != CLIPS] if list(names) == ["all"] else list(dict.fromkeys(names))
    check_names(chosen, benches)
    if out is not None and out.exists() and not out.is_dir():
        raise DegenseError(f"{out} is a file; name a folder for the tables and plots.")
    for clip in clips:
        open_clip(clip)  # a clip that cannot be read is said before an hour of measuring
    seeds = seeds or (QUICK_SEEDS if quick else SEEDS)
    repeats = repeats or (QUICK_REPEATS if quick else REPEATS)
    with tempfile.TemporaryDirectory(prefix="degense-bench-") as scratch:
        options = BenchOptions(
            choose_device(device).type, tuple(range(seeds)), repeats, quick, Path(scratch), tuple(clips), out, sweep or {}
        )
        for done, name in enumerate(chosen):

            def tell(fraction: float, message: str, done: int = done, name: str = name) -> None:
                progress((done + fraction) / len(chosen), f"{name}: {message}")

            for table in run(name, options, tell, benches):
                show(plain_section(table))
                if out is not None:
                    save_table(table, out)


def report_benchmarks(folders: Sequence[str], out: Path | None) -> str:
    """Make the page of a folder of tables; what was written."""
    if len(folders) != 1 or out is None:
        raise DegenseError("A report is made of one folder into one file: degense bench report FOLDER --out FILE.")
    return f"{out}: {write_report(Path(folders[0]), out)} tables"


def compare(
    clip: Callable[[], Clip],
    out: Path,
    config: TrainConfig,
    methods: str | None,
    seeds: Sequence[int],
    teacher: str | None,
    progress: Progress,
    stop: Callable[[], bool],
) -> str:
    """Train and score systems on one clip, and write the report; the table of classes, and the paths of the report.

    Parameters
    ----------
    clip : callable
        Opens the clip, after `methods` were found to be systems.
    methods : str, optional
        Names of `SYSTEMS`, separated by commas; None: all.

    Raises
    ------
    Cancelled
        When `stop()` asked to leave; what is trained is kept.
    """
    chosen = list(SYSTEMS) if methods is None else list(dict.fromkeys(filter(None, methods.split(","))))
    if not chosen:
        raise DegenseError(f"--methods names none; choose from {', '.join(SYSTEMS)}.")
    for method in chosen:
        as_system(method, config)
    opened = clip()
    comparison = SystemComparison.open(opened, out, config, teacher)
    baselines = comparison.baselines(lambda fraction, words: progress(0.02 * fraction, words))
    scores = comparison.run(chosen, seeds, lambda fraction, words: progress(0.02 + 0.98 * fraction, words), stop)
    pictures = comparison.pictures(scores, seeds[0])
    facts = _clip_facts(opened, scores[0].runs[0]) | {
        "teacher": comparison.teacher,
        "budget": f"preset {config.preset}, {config.iterations:,} steps, at most {config.max_gaussians:,} Gaussians, the same for all"
        + "; degensegs has as many steps more, in which its deformation is frozen" * ("degensegs" in chosen),
        "seeds": ", ".join(map(str, seeds)),
    }
    paths = write_scores(out, f"Systems on {opened.name}", facts, scores, opened.classes, pictures, baselines)
    return "\n".join([tables_of(scores, baselines)[0].markdown(), "", *map(str, paths)])


def report_run(scene: Scene, clip: Clip, scores: dict[str, Any], folder: Path, progress: Progress = silent) -> str:
    """Write the report of one run's scores, beside baselines of its teacher; its paths. DegenseError for a run without masks to score."""
    if "masks" not in scores:
        raise DegenseError(f"{scene.name} or its clip has no labels, so there are no masks to report; the scores are on standard output.")
    entry = MethodScores(scene.name, f"{scores['preset']} preset, {scores['routing']} routing", [scores])
    frames = scores["mask_frames"]
    pictures = truths_of(clip, frames) + pictures_of(scene, clip, frames, entry.decoder, scene.name)
    teacher = scene.run.info["teacher"]
    facts = _clip_facts(clip, scores) | {"teacher": teacher["provenance"], "cameras": str(scores["poses"])}
    try:
        baselines = score_baselines(clip, teacher["name"], progress)
    except DegenseError as error:  # what the teacher read may be gone, and its name may not say where it was
        facts["baselines"] = f"those of masks are left out: {error}"
        baselines = score_baselines(clip, "none", progress)
    return "\n".join(map(str, write_scores(folder, f"Scores of {scene.name}", facts, [entry], clip.classes, pictures, baselines)))


def _clip_facts(clip: Clip, scores: dict[str, Any]) -> dict[str, str]:
    width, height = clip.size
    frames, trained = scores["mask_frames"], scores["mask_frames_trained"]
    return {
        "clip": f"{clip.name}: {len(clip)} frames, {width} × {height}",
        "masks scored on": f"{len(frames)} frame{'s' * (len(frames) != 1)} ({', '.join(map(str, frames))})"
        + (f"; of these, trained on: {', '.join(map(str, trained))}" if trained else ", none trained on"),
    }

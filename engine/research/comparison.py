"""Several systems on one clip with one teacher and one budget: trained, scored and kept, one run after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from degense.engine.clip import Clip
from degense.engine.data.poses import find_cameras
from degense.engine.data.readers import fingerprint
from degense.engine.errors import Cancelled, DegenseError
from degense.engine.events import Event, Step, TrainingProgress
from degense.engine.metrics.evaluate import evaluate
from degense.engine.progress import Progress, silent
from degense.engine.research.baselines import score_baselines
from degense.engine.research.report import MethodScores, ReportPicture, pictures_of
from degense.engine.research.report.pictures import truths_of
from degense.engine.research.systems import as_system, words_of
from degense.engine.scene import Scene
from degense.engine.semantics.teachers import default_teacher
from degense.engine.store import Run
from degense.engine.store.files import read_json, write_json
from degense.engine.training import TrainConfig, train

FORMAT = 1
#: Settings that may differ from one start of a comparison to the next.
FREE = ("device", "seed", "checkpoint_seconds", "given")


@dataclass(frozen=True)
class SystemComparison:
    """What is compared, and where it is kept.

    Attributes
    ----------
    clip : Clip
    out : Path
        Holds `comparison.json` (the settings), `baselines.json`, `runs/` and `scores/`, each by method and seed.
    config : TrainConfig
        The budget of all.
    teacher : str
    """

    clip: Clip
    out: Path
    config: TrainConfig
    teacher: str

    @classmethod
    def open(cls, clip: Clip, out: Path, config: TrainConfig, teacher: str | None = None) -> SystemComparison:
        """Begin a comparison in `out`, or go on with the one that is there.

        Raises
        ------
        DegenseError
            If the clip has no label maps, or `out` holds something else or a comparison with other settings.
        """
        if not clip.labelled_frames:
            raise DegenseError(f"{clip.path} has no label maps, so masks cannot be scored; add labels/ and classes.json")
        found = cls(clip, out, config, teacher or default_teacher(clip))
        if found.teacher == "none":
            raise DegenseError("systems are compared by their masks, which need a teacher; name one with --teacher")
        path = out / "comparison.json"
        if path.exists():
            if (there := read_json(path)) != (wanted := found.settings()):
                other = _difference(there, wanted)
                raise DegenseError(f"{out} holds a comparison with {other}; go on with the same settings, or choose another folder")
        elif out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise DegenseError(f"{out} is not empty and holds no comparison; choose another folder")
        else:
            write_json(path, found.settings())
        return found

    def settings(self) -> dict[str, Any]:
        """What must stay the same for scores to be compared."""
        budget = {name: value for name, value in self.config.to_json().items() if name not in FREE}
        return {"format": FORMAT, "clip": fingerprint(self.clip), "teacher": self.teacher, "budget": budget}

    def run(
        self, methods: Sequence[str], seeds: Sequence[int], progress: Progress = silent, stop: Callable[[], bool] = lambda: False
    ) -> list[MethodScores]:
        """Train and score what has not been; the scores of all, in the order of `methods`.

        Raises
        ------
        Cancelled
            When `stop()` asked to leave. The training that was under way goes on from there the next time.
        """
        clip = find_cameras(self.clip, progress, labelled=self.teacher == "labels") if self.clip.poses != "given" else self.clip
        jobs = [(method, seed) for method in methods for seed in seeds]
        scores: dict[str, list[dict[str, Any]]] = {method: [] for method in methods}
        for done, (method, seed) in enumerate(jobs):

            def tell(fraction: float, words: str, done: int = done, what: str = f"{method}, seed {seed}") -> None:
                progress((done + fraction) / len(jobs), f"{what}: {words}")

            path = self.out / "scores" / f"{method}-{seed}.json"
            if not path.exists():
                write_json(path, self._score(clip, method, seed, tell, stop))
            scores[method].append(_scores(path))
        return [MethodScores(method, words_of(method), scores[method]) for method in methods]

    def _score(self, clip: Clip, method: str, seed: int, progress: Progress, stop: Callable[[], bool]) -> dict[str, Any]:
        """Train one run, or go on with it, and score it."""

        def scoring(fraction: float, words: str) -> None:
            progress(0.85 + 0.15 * fraction, words)
            if stop():
                raise Cancelled

        folder = self.out / "runs" / f"{method}-{seed}"
        begun = (folder / "run.json").exists()
        if not begun or Run.open(folder).info["state"] != "finished":
            config = replace(as_system(method, self.config), seed=seed)

            def tell(event: Event) -> None:
                if isinstance(event, TrainingProgress) and event.psnr is not None:
                    progress(0.85 * event.iteration / event.iterations, f"{event.psnr:.1f} dB")
                elif isinstance(event, Step):
                    progress(0.85 if event.stage == "semantics" else 0.0, event.message)

            if train(clip, folder, config, teacher=self.teacher, resume=begun, events=tell, stop=stop) is None:
                raise Cancelled
        scene = Scene.open(folder, device=self.config.device if self.config.device != "auto" else None, clip=clip)
        return evaluate(scene, clip, scoring)

    def baselines(self, progress: Progress = silent) -> dict[str, dict[str, Any]]:
        """Scores of what needs no scene, kept beside those of the methods."""
        path = self.out / "baselines.json"
        if not path.exists():
            write_json(path, score_baselines(self.clip, self.teacher, progress))
        return read_json(path)

    def pictures(self, entries: Sequence[MethodScores], seed: int) -> list[ReportPicture]:
        """The shown frames as recorded, with their true labels, and as each method has them."""
        frames = entries[0].runs[0]["mask_frames"]
        found = truths_of(self.clip, frames)
        for entry in entries:
            scene = Scene.open(self.out / "runs" / f"{entry.name}-{seed}", clip=self.clip)
            found += pictures_of(scene, self.clip, frames, entry.decoder, entry.name)
        return found


def _scores(path: Path) -> dict[str, Any]:
    """Scores that were kept. DegenseError when the file holds something else."""
    found = read_json(path)
    needed = {"miou": dict, "masks": dict, "calibration": dict, "flicker": dict, "mask_frames": list}
    if not isinstance(found, dict) or not all(isinstance(found.get(name), kind) for name, kind in needed.items()):
        raise DegenseError(f"{path} does not hold scores; delete it, and the run is scored again")
    return found


def _difference(there: Any, wanted: dict[str, Any]) -> str:
    """In what kept settings differ from the wanted ones, in words."""
    if not isinstance(there, dict) or not isinstance(there.get("budget"), dict):
        return "settings that cannot be read"
    if there.get("clip") != wanted["clip"]:
        return "another clip"
    if there.get("teacher") != wanted["teacher"]:
        return f"the teacher {there.get('teacher')}"
    for name, value in wanted["budget"].items():
        if (other := there["budget"].get(name)) != value:
            return f"{name.replace('_', ' ')} {other} instead of {value}"
    return "settings of another version"

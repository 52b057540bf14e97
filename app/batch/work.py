"""What is done for one job, in this process: train, score, ask, export, each unless it is done."""

from __future__ import annotations

import gc
import json
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from degense.app.batch.folder import ANSWERS, BatchFolder
from degense.app.batch.plan import BatchJob
from degense.app.features.runs.run_summaries import SCORES
from degense.engine.errors import Cancelled, DegenseError, is_out_of_memory
from degense.engine.files import move, write_text
from degense.engine.progress import Progress, Steps, finish

if TYPE_CHECKING:
    from degense.engine.clip import Clip
    from degense.engine.scene import Scene

TELL_SECONDS = 0.5
#: Speed is not scored: others use the machine at the same time.
SCORED = ("masks", "flicker", "motion")


@dataclass
class Work:
    """A job while it is done."""

    folder: BatchFolder
    job: BatchJob
    progress: Progress  # of the stage; raises Cancelled when the job is to stop
    stop: Callable[[], bool]
    _trained: float = 0.0  # the share of the training's steps that are made

    @cached_property
    def clip(self) -> Clip:
        from degense.engine.data.readers import ClipOptions, open_clip

        return open_clip(self.job.training.clip, ClipOptions(**self.job.training.clip_options()))

    @cached_property
    def scene(self) -> Scene:
        from degense.engine.scene import Scene
        from degense.engine.training.config import choose_device

        device = choose_device(self.job.training.config().device)
        return Scene.open(self.folder.run(self.job), device=device, clip=self.clip)

    def train(self) -> None:
        """Train, or go on from the last checkpoint; nothing where the run is finished."""
        from degense.engine.store import Run
        from degense.engine.training import train

        out, training = self.folder.run(self.job), self.job.training
        resume = (out / "run.json").is_file()
        if resume and Run.open(out).info["state"] == "finished":
            return
        if not resume and all(path.is_dir() or path.name.startswith(".") for path in out.rglob("*")):
            shutil.rmtree(out, ignore_errors=True)  # begun, but killed before its first file was written
        run = train(self.clip, out, training.config(), teacher=training.teacher, resume=resume, events=self._tell, stop=self.stop)
        if run is None:
            raise Cancelled

    def score(self) -> None:
        from degense.engine.metrics.evaluate import evaluate

        scores = evaluate(self.scene, self.clip, self.progress, parts=SCORED)
        write_text(self.folder.run(self.job) / SCORES, json.dumps(scores, indent=2, allow_nan=False))

    def ask(self) -> None:
        from degense.engine.scene.moments import answers_json, ask_clip

        answers = finish(ask_clip(self.scene, self._prompts()), self.progress)
        write_text(self.folder.run(self.job) / ANSWERS, json.dumps(answers_json(answers, self.scene.fps), ensure_ascii=False))

    def export(self, name: str) -> None:
        """Write a format; under its own name only when it is whole."""
        from degense.app.features.export.formats import FORMATS, ExportOptions

        out = self.folder.export(self.job, name)
        draft = out.parent / f".{out.name}.draft"
        _take_away(draft)
        draft.mkdir(parents=True)
        steps: Steps[str] = FORMATS[name].export(self._shown(), draft / out.name, ExportOptions(self._prompts(), source="masks"))
        finish(steps, self.progress)
        _take_away(out)
        move(draft / out.name, out)
        _take_away(draft)

    def _shown(self) -> Scene:
        """The scene as exports show it. DegenseError for a cover that is not there or has another size."""
        from degense.engine.scene.anonymous import anonymised, read_cover

        if not self.job.anonymise:
            return self.scene
        return anonymised(self.scene, read_cover(Path(self.job.cover), self.scene.clip_size) if self.job.cover else None)

    def _prompts(self) -> Any:
        from degense.engine.semantics.prompts import PromptSet

        return PromptSet.chosen(list(self.job.prompts), self.job.decoder, self.job.threshold)

    def _tell(self, event: object) -> None:
        from degense.engine.events import Stage, Step, TrainingProgress

        match event:
            case TrainingProgress():
                self._trained = event.iteration / event.iterations
                self._say(f"{event.iteration} of {event.iterations}" + (f", {event.psnr:.1f} dB" if event.psnr is not None else ""))
            case Step(stage, fraction):
                self._say(f"{stage} {fraction:.0%}")
            case Stage(stage):
                self._say(stage)

    def _say(self, words: str) -> None:
        """Tell how far the training is. It stops by itself, with a checkpoint: an exception would take the steps since the last one."""
        if not self.stop():
            self.progress(self._trained, words)


def do_job(folder: BatchFolder, job: BatchJob, tell: Callable[[str, float, str], None], stop: Callable[[], bool]) -> None:
    """Do what is left of a job; `tell(stage, fraction, words)` hears how far it is.

    Raises
    ------
    Cancelled
        When `stop()` turned true; what is done is kept.
    DegenseError
        When the job cannot be done; the record says why too.
    """
    with folder.hold(job):
        try:
            for stage in folder.left(job):
                _do_stage(folder, job, stage, tell, stop)
            _keep_failure(folder, job, "")
        except Exception as error:
            if not isinstance(error, (DegenseError, OSError)) and not is_out_of_memory(error):
                raise
            sentence = _sentence(error)
            _keep_failure(folder, job, sentence)
            raise DegenseError(sentence) from error
        finally:
            _free_memory()


def _do_stage(folder: BatchFolder, job: BatchJob, stage: str, tell: Callable[[str, float, str], None], stop: Callable[[], bool]) -> None:
    last = float("-inf")

    def progress(fraction: float, words: str) -> None:
        nonlocal last
        if stop():
            raise Cancelled
        if (now := time.monotonic()) - last >= TELL_SECONDS:
            last = now
            tell(stage, fraction, words)

    work, begun = Work(folder, job, progress, stop), time.perf_counter()
    progress(0.0, "")
    kind, _, name = stage.partition(" ")
    record = folder.record(job)
    if kind == "train":
        folder.keep(job, replace(record, done={}, failure=""))  # what the training begins with, which the next call must want too
    steps = {"train": work.train, "eval": work.score, "query": work.ask, "export": lambda: work.export(name)}
    steps[kind]()
    record = folder.record(job)
    spent = record.seconds.get(stage, 0.0) * (kind == "train") + time.perf_counter() - begun
    folder.keep(job, replace(record, done=record.done | {stage: job.stages()[stage]}, seconds=record.seconds | {stage: round(spent, 2)}))


def _keep_failure(folder: BatchFolder, job: BatchJob, sentence: str) -> None:
    record = folder.record(job)
    if record.failure != sentence:
        try:
            folder.keep(job, replace(record, failure=sentence))
        except DegenseError:
            if not sentence:
                raise  # on a full disk the failure is told, though it is not kept


def _sentence(error: BaseException) -> str:
    """What went wrong, in one sentence for the user."""
    if is_out_of_memory(error):
        return "There is not enough memory; take fewer --slots or a smaller preset."
    if isinstance(error, OSError):
        return f"{error.filename or 'A file'} cannot be read or written: {error.strerror or error}."
    return " ".join(str(error).split())


def _take_away(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _free_memory() -> None:
    """Before the next job: a GPU's memory is for all slots."""
    import torch

    gc.collect()
    if torch.cuda.is_available():
        torch.cuda.empty_cache()

"""From a clip to a run folder: prepare, build, run the trainer, distil semantics, save."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import torch

from degense.engine.clip import Clip
from degense.engine.data.readers import fingerprint
from degense.engine.errors import Cancelled, DegenseError, RunError
from degense.engine.events import Done, Events, Preview, Reliability, Stage, Stopped, TrainingProgress, read_progress
from degense.engine.field import SceneModel
from degense.engine.field.static_gaussians import find_moving, keep_still
from degense.engine.files import replacing
from degense.engine.processes.heap import kept_heap
from degense.engine.profile import part
from degense.engine.semantics import TextEncoder, open_encoder, save_encoder
from degense.engine.store import Run
from degense.engine.store.migrations import current_settings
from degense.engine.store.run import hardware
from degense.engine.threads import one_torch_thread
from degense.engine.training.checkpoint import load_checkpoint, save_checkpoint
from degense.engine.training.config import TrainConfig, choose_device
from degense.engine.training.flow.observability import motion_observability
from degense.engine.training.flow.supervision import LEAST_ERROR
from degense.engine.training.passes import draw
from degense.engine.training.preparation import Inputs, begin_stage, build_model, prepare
from degense.engine.training.semantic.confidence import confidence_of
from degense.engine.training.semantic.distillation import DISTILLATIONS, steps_of
from degense.engine.training.semantic.label_support import label_support
from degense.engine.training.trainer import Diverged, Trainer

REPORT_EVERY = 25  # steps
PREVIEW_SECONDS = 5.0
STATIC_MOMENTS = 64  # at most, at which Gaussians are tested for motion
STATIC_SHARE = 0.05  # static Gaussians that must be found before leaving them out is worth the bookkeeping


@kept_heap()
def train(
    clip: Clip,
    out: Path,
    config: TrainConfig,
    *,
    teacher: str | None = None,
    encoder: TextEncoder | None = None,
    resume: bool = False,
    events: Events,
    stop: Callable[[], bool],
) -> Run | None:
    """Train a scene of `clip` into the run folder `out`.

    Returns the finished run, or None when `stop()` asked to leave; the run can then be resumed.

    Cameras that the clip does not bring are found first (`engine.data.poses`); the run keeps them.

    Parameters
    ----------
    teacher : str or None
        A name that `engine.semantics.teacher_by_name` knows, "none", or None for the clip's default.
    encoder : TextEncoder or None
        Whose text vectors a teacher by label maps or strokes gives the classes; None for the embedded one's.
    resume : bool
        Continue the training in `out` with the settings it started with.
    """
    started, run = time.perf_counter(), None
    if resume:
        run = Run.open(out)
        config = TrainConfig.from_json(current_settings(run.info["config"]) | {"device": config.device})
        teacher, encoder = _teacher_of(run, encoder)
        _refuse_to_resume(run, clip, config)
    elif (out / "run.json").exists():
        raise DegenseError(f"{out} already holds a run; choose another folder or add --resume")
    if config.distillation not in DISTILLATIONS:
        raise DegenseError(f"there is no distillation {config.distillation!r}; choose one of {', '.join(DISTILLATIONS)}")
    checkpoint = load_checkpoint(out / "checkpoints") if resume and (out / "checkpoints" / "last.json").exists() else None
    torch.manual_seed(config.seed)
    try:
        inputs = prepare(clip, run, config, teacher, encoder, choose_device(config.device), events, stop)
    except Cancelled:
        return None
    with part("initialise"):
        model = build_model(inputs, config)
    if run is None:
        run = _create(out, inputs, config, model)
    training = TrainingRun(run, inputs, model, config, events, stop, started)
    if checkpoint is not None:
        try:
            training.trainer.restore(checkpoint)
        except (LookupError, TypeError, ValueError, RuntimeError) as error:
            reason = str(error).partition("\n")[0]
            raise RunError(
                f"{out / 'checkpoints'} does not fit this training ({type(error).__name__}: {reason}); start a new run"
            ) from error
    return training()


def _teacher_of(run: Run, encoder: TextEncoder | None) -> tuple[str, TextEncoder | None]:
    """The teacher that a run began with, and the encoder of its classes; an encoder that is given must be the same."""
    teacher = run.info["teacher"]["name"]
    if teacher == "none" or teacher.partition(":")[0] in ("precomputed", "vlm"):
        return teacher, encoder
    return teacher, open_encoder(run.info["encoder"], run.info["classes"], run.path, encoder)


def _refuse_to_resume(run: Run, clip: Clip, config: TrainConfig) -> None:
    """DegenseError when the run is of another clip, or finished."""
    if run.info["clip"]["fingerprint"] != fingerprint(clip):
        raise DegenseError(f"{clip.path} is not the clip that {run.path} was trained on; resume with that clip or start a new run")
    if run.info["state"] == "finished":
        raise DegenseError(f"{run.path} has finished its {config.iterations} iterations; start a new run to train longer")


def _create(out: Path, inputs: Inputs, config: TrainConfig, model: SceneModel) -> Run:
    """The folder of a new run, with all that is known before its first step."""
    clip, teacher = inputs.clip, inputs.teacher
    info = {
        "clip": {"path": portable(clip.path, out), "name": clip.name, "fingerprint": fingerprint(clip), "options": clip.options},
        "config": config.to_json(),
        "field": model.config.to_json(),
        "unit": inputs.frames.unit,
        "reference_frame": clip.train_frames[0],
        "train_frames": clip.train_frames,
        "test_frames": clip.test_frames,
        "teacher": {"name": inputs.teacher_name, "provenance": inputs.semantic_provenance},
        "encoder": teacher.encoder.name if teacher is not None else None,
        "train_seconds": 0.0,
    }
    run = Run.create(out, clip, info)
    if teacher is not None and inputs.semantics is not None:
        run.save_basis(inputs.semantics.basis)
        save_encoder(teacher.encoder, out)
    return run


class TrainingRun:
    """A training and its run folder: call it to train `model` to the end. `started` is `time.perf_counter()` when all of it began."""

    def __init__(
        self, run: Run, inputs: Inputs, model: SceneModel, config: TrainConfig, events: Events, stop: Callable[[], bool], started: float
    ):
        self.run, self.inputs, self.config, self.events, self.stop, self.started = run, inputs, config, events, stop, started
        # isolated: no semantic gradient reaches geometry, which need not wait for semantics
        self.distils = config.routing == "isolated" and inputs.semantics is not None
        self.trainer = Trainer(model, inputs.frames, None if self.distils else inputs.semantics, inputs.flow, config, events)
        self._stage = ""
        self._begun = self._last_preview = self._last_checkpoint = started

    @one_torch_thread()
    def __call__(self) -> Run | None:
        """Train; the finished run, or None when `stop()` asked to leave and a checkpoint is saved."""
        run, spent = self.run, float(self.run.info["train_seconds"])
        run.info |= {"state": "training", "hardware": hardware()}
        run.save()
        self._begun = self._last_preview = self._last_checkpoint = time.perf_counter()
        past = [report for report in read_progress(run.path / "metrics.jsonl") if report.iteration <= self.trainer.iteration]
        self._begun -= (past[-1].seconds or 0.0) if past else 0.0
        finished = self._steps() and self._distil()
        if self.trainer.device.type == "cuda":
            torch.cuda.synchronize()
        made = {"iteration": self.trainer.iteration, "rollbacks": self.trainer.rollbacks, "gaussians": len(self.trainer.model)}
        run.info |= {"train_seconds": spent + time.perf_counter() - self.started, **made}
        if not finished:
            self._leave("stopped")
            self.events(Stopped(self.trainer.iteration))
            return None
        with part("save"):
            self._finish()
        self.events(Done(str(run.path)))
        return run

    def _steps(self) -> bool:
        """Run the trainer to its end; False when `stop()` asked to leave. DegenseError when it diverges again and again."""
        trainer, total = self.trainer, self.config.iterations
        first, last, begin = trainer.iteration, trainer.iteration, time.perf_counter()
        steps = total + self.distils * steps_of(self.config)
        try:
            while trainer.iteration < total:
                if self.stop():
                    return False
                with part("joint" if trainer.deforms else "coarse"):
                    trainer.step()
                now = trainer.iteration
                last = min(last, now)  # steps that are taken again are counted anew
                if now - last >= REPORT_EVERY or now == total:
                    clock = time.perf_counter()
                    eta = (clock - begin) / max(1, now - first) * (steps - now)
                    self._report(TrainingProgress(now, steps, **trainer.report(now - last), seconds=clock - self._begun, eta=eta))
                    last = now
        except Diverged as error:
            trainer.restore(trainer.last_finite)
            self._leave("diverged")
            raise DegenseError(f"{error}; {self.run.path} keeps it. Try a smaller preset or check the clip's depth and masks") from error
        return True

    def _report(self, progress: TrainingProgress) -> None:
        """Log and send what a stretch of steps found; a preview and a checkpoint when it is time."""
        stage = "coarse" if progress.iteration <= self.config.coarse_iterations else "joint"
        if stage != self._stage:
            self._stage = stage
            self.events(Stage(stage))
        self.run.log(asdict(progress))
        self.events(progress)
        now = time.perf_counter()
        if now - self._last_preview > PREVIEW_SECONDS or progress.iteration == self.config.iterations:
            with part("preview"):
                self.events(write_preview(self.run, self.trainer))
            self._last_preview = now
        if now - self._last_checkpoint > self.config.checkpoint_seconds:
            with part("save"):
                save_checkpoint(self.run.path / "checkpoints", self.trainer.state())
            self._last_checkpoint = time.perf_counter()

    def _distil(self) -> bool:
        """Semantics for the finished geometry, where they were not trained with it; False when `stop()` asked to leave."""
        if not self.distils or self.inputs.semantics is None:
            return True
        tell = begin_stage("semantics", self.events)
        begin, made = time.perf_counter(), self.config.iterations

        def report(step: int, steps: int, loss: float, losses: dict[str, float]) -> None:
            now = time.perf_counter()
            eta, seconds = (now - begin) / step * (steps - step), now - self._begun
            progress = TrainingProgress(made + step, made + steps, loss, None, len(self.trainer.model), seconds, eta, losses)
            self.run.log(asdict(progress))
            self.events(progress)

        fit = DISTILLATIONS[self.config.distillation]
        with part("semantics"):
            return fit(self.trainer.model, self.inputs.semantics, self.inputs.frames, self.config, self.stop, tell, report)

    def _leave(self, state: str) -> None:
        """Save what can be resumed."""
        save_checkpoint(self.run.path / "checkpoints", self.trainer.state())
        self.run.info["state"] = state
        self.run.save()

    def _finish(self) -> None:
        """Save the model and what is known of its motion; checkpoints go."""
        run, trainer = self.run, self.trainer
        with part("static Gaussians"):
            run.info["moving"] = settle(trainer)
        if self.inputs.semantics is not None:
            with part("confidence"):
                curve = confidence_of(trainer.model, self.inputs.semantics, self.inputs.frames)
            run.info["confidence"] = None if curve is None else curve.to_json()
        if self.inputs.semantics is not None and (share := self.inputs.semantics.disagreement) is not None:
            words = f"this teacher calls the same place differently in {share:.0%} of the frames"
            run.info["teacher"] |= {"disagreement": share, "provenance": f"{run.info['teacher']['provenance']}; {words}"}
            self.events(Reliability(words))
        if (semantics := self.inputs.semantics) is not None and semantics.sparse:
            with part("label support"):
                run.save_label_support(label_support(trainer.model, semantics, self.inputs.frames))
        run.save_model(trainer.model)
        if trainer.flow is not None:
            with part("observability"):
                run.save_observability(motion_observability(trainer.model, trainer.frames, trainer.flow))
        run.info["state"] = "finished"
        run.save()
        for file in (run.path / "checkpoints").iterdir():
            file.unlink()


def settle(trainer: Trainer) -> int:
    """Let Gaussians keep their place whose motion flow cannot tell from none, and let those that the field never changes visibly stay out
    of it for good; how many stay in it."""
    model, clip, flow, focal = trainer.model, trainer.frames.clip, trainer.flow, trainer.frames.cameras[0].fx
    times = [clip.time(i) for i in np.linspace(0, len(clip) - 1, min(len(clip), STATIC_MOMENTS))]
    if flow is not None and trainer.config.stillness:
        keep_still(model, times, focal * flow.size[0] / trainer.frames.size[0], LEAST_ERROR)
    moving = find_moving(model, times, focal)
    if len(model) - len(moving) >= STATIC_SHARE * len(model):
        model.set_moving(moving)
    return len(model) if model.moving is None else len(moving)


@torch.no_grad()
def write_preview(run: Run, trainer: Trainer) -> Preview:
    """Draw the first held-out frame (or the first frame) as `previews/last.png`."""
    clip = trainer.frames.clip
    frame = (clip.test_frames or [0])[0]
    splats = trainer.model.at(clip.time(frame), deform=trainer.deforms, semantics=False).splats
    pixels = (draw(splats, trainer.frames.cameras[frame]).image[..., :3].clamp(0, 1) * 255).byte().cpu().numpy()
    path = run.path / "previews" / "last.png"
    with replacing(path) as temporary:
        temporary.write_bytes(cv2.imencode(".png", pixels[..., ::-1])[1].tobytes())
    return Preview(str(path), frame)


def portable(path: Path, start: Path) -> str:
    """`path` relative to the run when they share a folder, so that both can be moved together; else absolute."""
    path, start = path.resolve(), start.resolve()
    return os.path.relpath(path, start) if path.is_relative_to(start.parent) else str(path)

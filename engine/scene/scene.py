"""A trained run, ready to be looked at: its facts, its states over time and its frames. Lengths are in the clip's own unit."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.errors import DegenseError, PromptError, RunError
from degense.engine.field import SceneModel
from degense.engine.gpu import gpu_usable
from degense.engine.motion.observed import ObservedMotion
from degense.engine.scene.labelled import LabelledPlaces
from degense.engine.scene.renderer import COVERED, NEEDS_TEACHER, Renderer
from degense.engine.scene.states import States
from degense.engine.semantics import Basis, TextEncoder, open_encoder
from degense.engine.semantics.examples import Example, split_examples
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.semantics.masks.confidence import ConfidenceCurve
from degense.engine.store import Run
from degense.engine.store.run import LabelSupport
from degense.engine.vocabulary.questions import Question, heads, nouns_of, read_question

KEPT_PROMPTS = 1000


class Scene:
    """One opened run."""

    def __init__(
        self,
        run: Run,
        model: SceneModel,
        basis: Basis | None,
        encoder: TextEncoder | None,  # that made the run's features; no other may answer prompts
        clip: Clip | None,  # the recording, when it is still where it was
        clip_missing: str = "",  # why it is not, in one sentence
        observability: Tensor | None = None,
        label_support: LabelSupport | None = None,
    ):
        self.run, self.basis, self.encoder, self.clip, self.clip_missing = run, basis, encoder, clip, clip_missing
        self.has_semantics = basis is not None
        self.name, self.classes, self.reference_frame = run.path.name, tuple(run.info["classes"]), int(run.info["reference_frame"])
        self.cameras = run.cameras
        self._asked: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._vectors: dict[tuple[str, ...], np.ndarray] = {}  # of the last texts: those of the classes, again and again
        self._draw_from(model, observability, label_support)

    def _draw_from(self, model: SceneModel, observability: Tensor | None, label_support: LabelSupport | None) -> None:
        """Be drawn from a model, on its device."""
        self.model = model
        self.states = States(model, self.run.info["unit"], self.frames, self.reference_frame, observability)
        self.time, self.splats = self.states.time, self.states.splats
        self.renderer = Renderer(self.name, self.states, self.basis, self.camera)
        if (points := self.run.info.get("confidence")) is not None:
            self.renderer.curve = _curve_of(points, self.run)
        if label_support is not None:
            self.renderer.labelled = LabelledPlaces(self.states, label_support, self.cameras)
        self.render, self.render_rgb = self.renderer.render, self.renderer.render_rgb

    @classmethod
    def open(
        cls,
        path: Path | str,
        *,
        device: str | torch.device | None = None,
        clip: Clip | None = None,
        encoder: TextEncoder | None = None,
    ) -> Scene:
        """Open a run folder. RunError when it is damaged, or `encoder` did not make its features.

        `device` None takes a GPU when there is one that can be used; `encoder` None takes what the run keeps of its own.
        """
        run = Run.open(path)
        if device is None:
            device = "cuda" if gpu_usable() else "cpu"
        model, observability, label_support = _load(run, device)
        name = run.info.get("encoder")
        if encoder is not None and name is None:
            raise RunError(f"{run.path.name} was trained without semantics, so no encoder can answer prompts; {NEEDS_TEACHER}")
        encoder_of_run, basis = open_encoder(name, tuple(run.info["classes"]), run.path, encoder) if name else None, run.load_basis()
        if encoder_of_run is not None and (basis is None or basis.dimension != encoder_of_run.dimension):
            length = "no length" if basis is None else f"length {basis.dimension}"
            raise RunError(
                f"{run.path.name} has features of {length}, and text vectors of length {encoder_of_run.dimension}; one of them is damaged"
            )
        missing = ""
        if clip is None:
            clip, missing = _find_clip(run)
        return cls(run, model, basis, encoder_of_run, clip, missing, observability, label_support)

    def move_to(self, device: str | torch.device) -> None:
        """Be drawn on another device from now on, where the memory of this one is not enough; what was drawn and kept is forgotten."""
        self._draw_from(*_load(self.run, device))

    @property
    def device(self) -> torch.device:
        """Where it is drawn."""
        return self.model.bounds.device

    @property
    def frames(self) -> int:
        """How many there are; displacement is measured from `reference_frame`."""
        return len(self.cameras)

    @property
    def clip_size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return self.cameras[0].width, self.cameras[0].height

    @property
    def observability(self) -> Tensor | None:
        return self.states.observability

    @property
    def unit(self) -> str:
        return self.run.info["unit_name"]

    @property
    def fps(self) -> float:
        return float(self.run.info["fps"])

    def camera(self, frame: float) -> Camera:
        """The surgeon's camera at a frame (the nearest one for fractions)."""
        return self.cameras[int(np.clip(round(frame), 0, self.frames - 1))]

    def observed(self, frame: int) -> np.ndarray | None:
        """The recorded frame, uint8 [H, W, 3]; None without the clip."""
        return self.clip.frame(frame) if self.clip is not None else None

    def labels(self, frame: int) -> np.ndarray | None:
        """The clip's label map, uint8 [H, W]; None where there is none."""
        return self.clip.labels(frame) if self.clip is not None else None

    def query(self, frame: float, camera: Camera | None = None) -> FrameSemantics:
        """The semantics of a frame, see `Renderer.query`."""
        return self.renderer.query(frame, camera)

    def vectors(self, prompts: tuple[str, ...]) -> np.ndarray:
        """Unit text vectors [n, D]. DegenseError without semantics, PromptError for an unknown word."""
        if self.encoder is None:
            raise DegenseError(f"{self.name} was trained without semantics, so it cannot be prompted; {NEEDS_TEACHER}")
        if prompts not in self._vectors:
            self._vectors = {prompts: self.encoder.encode(list(prompts))}
        return self._vectors[prompts]

    def question(self, prompt: str) -> Question:
        """What a prompt asks; nothing is drawn. Raises as `vectors` does, and where a question or an example cannot be read."""
        self.vectors(())
        question = read_question(prompt, self.classes)
        for text in nouns_of(question):
            self._read(text)
        return question

    def included(self, prompt: str) -> np.ndarray:
        """Unit vectors [m, D] of what a prompt includes: one row, or one for each class of a kind ("tool"). Raises as `question` does.

        Of a question those of the nouns whose pixels its masks hold. A visual example adds the feature that is drawn at its place;
        PromptError where nothing is reconstructed there.
        """
        rows: list[np.ndarray] = []
        for text in heads(self.question(prompt).what):
            rows += self._read(text)[0], *map(self._seen, split_examples(text)[1])
        return np.concatenate(rows)

    def excluded(self, prompt: str) -> np.ndarray:
        """Unit vectors [k, D], k ≥ 0, of what a plain prompt excludes ("tool, not grasper"). Raises as `vectors` does."""
        self.vectors(())
        return self._read(prompt)[1]

    def _read(self, prompt: str) -> tuple[np.ndarray, np.ndarray]:
        """What a plain prompt includes and excludes; cached."""
        if prompt not in self._asked:
            assert self.encoder is not None
            words, examples = split_examples(prompt)
            width, height = self.clip_size
            for example in examples:
                if example.frame >= self.frames or example.x >= width or example.y >= height:
                    raise PromptError(
                        f"There is no place {example}: frames go from 0 to {self.frames - 1}, pixels to {width - 1},{height - 1}."
                    )
            none = np.zeros((0, self.encoder.dimension), np.float32)
            only_seen = examples and not words
            self._asked[prompt] = (none, none) if only_seen else (self.encoder.expand(words), self.encoder.exclude(words))
            while len(self._asked) > KEPT_PROMPTS:
                del self._asked[next(iter(self._asked))]
        return self._asked[prompt]

    def _seen(self, example: Example) -> np.ndarray:
        """The feature that is drawn at a place, as a unit vector [1, D]."""
        assert self.basis is not None
        drawn = self.render(example.frame, None, ("latent", "alpha"))
        latent = drawn["latent"][example.y, example.x].astype(np.float64)
        length = float(np.linalg.norm(latent))
        if drawn["alpha"][example.y, example.x] < COVERED or not (np.isfinite(length) and length > 0):
            raise PromptError(f"Nothing is reconstructed at {example}, so it is no example; choose a place inside of the scene.")
        return (self.basis.matrix @ (latent / length))[None].astype(np.float32)

    @cached_property
    def observed_motion(self) -> ObservedMotion:
        """What the recording shows of motion since the reference frame. DegenseError without the clip."""
        if self.clip is None:
            raise DegenseError(f"warp compares the scene with the recording, which is missing: {self.clip_missing}")
        return ObservedMotion(self.clip, self.reference_frame)


def _load(run: Run, device: str | torch.device) -> tuple[SceneModel, Tensor | None, LabelSupport | None]:
    """The model of a run, what the recording shows of the motion of its Gaussians, and what labels show of them."""
    model = run.load_model(device).eval().requires_grad_(False)
    return model, run.load_observability(len(model)), run.load_label_support(len(model))


def _curve_of(points: Any, run: Run) -> ConfidenceCurve:
    """The run's curve of confidence; RunError where it is none."""
    try:
        return ConfidenceCurve.from_json(points)
    except ValueError as error:
        raise RunError(f"{run.path / 'run.json'} is damaged: {error}") from error


def _find_clip(run: Run) -> tuple[Clip | None, str]:
    """The run's clip, or None and why not."""
    from degense.engine.data.readers import ClipOptions, fingerprint, open_clip

    recorded = run.info["clip"]
    path = (run.path / recorded["path"]).resolve()
    try:
        clip = open_clip(path, ClipOptions(**recorded.get("options", {})))
        if fingerprint(clip) != recorded["fingerprint"]:
            return None, f"{path} has changed since the training"
    except TypeError:
        return None, f"{run.path / 'run.json'} names options for its clip that this version does not know"
    except DegenseError as error:
        return None, str(error)
    return clip, ""

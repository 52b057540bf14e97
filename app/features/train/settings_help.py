"""The choices of a training in words; those of its settings stand in `TrainConfig`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from degense.engine.semantics.teachers import TeacherChoice
from degense.engine.training.config import TrainConfig

PRESET_WORDS = {
    "quick": ("Quick", "A first look: a minute or two, small details missing."),
    "balanced": ("Balanced", "Good renders and masks in a reasonable time."),
    "best": ("Best", "For results: longest, most Gaussians."),
}
ROUTING_WORDS = {
    "isolated": ("Isolated", "Semantics are distilled after geometry and can never move tissue. Best renders and masks."),
    "paper": ("Paper", "Geometry and semantics share an encoder and decode it independently, as the paper describes."),
    "coupled": ("Coupled", "The rigid baseline: semantic gradients reach geometry. For comparison."),
}
TEACHER_WORDS = {
    "labels": ("Label maps", "The clip's annotated frames say what is where."),
    "strokes": ("Strokes", "A few scribbles spread over their frame and along the motion over the clip."),
    "precomputed": ("Feature files", "Language features computed elsewhere, beside the clip."),
    "vlm": ("Vision-language model", "A model from a folder of this machine."),
    "none": ("None", "Geometry and colour only; the scene answers no prompts."),
}
TEACHER_FOLDER_WORDS = "Of the feature files, or of the model; the others need none."
DEVICE_WORDS = {
    "auto": ("Automatic", "The GPU where there is one, else the processor."),
    "cpu": ("Processor", "Works everywhere; slower."),
    "cuda": ("CUDA GPU", "Fails when there is none."),
}
POSES_WORDS = {
    "auto": ("As the clip says", "Where it does not say, the frames are looked at first."),
    "still": ("Stands still", "The endoscope does not move; all motion is tissue's and tools'."),
    "estimate": ("Moves", "Its path is estimated from the frames before training."),
}
ITERATION_WORDS = "Steps of training. More are slower and finer, up to a point."
GAUSSIAN_WORDS = "Cap on the number of Gaussians: it bounds memory and time."
SEED_WORDS = "Another seed, another random start: how much of a result is luck."
OUT_WORDS = "Everything of the run goes into this folder: settings, model, curves, previews."


@dataclass(frozen=True)
class Setting:
    """A field of `TrainConfig`: what it does, and its value."""

    name: str
    words: str
    value: Any
    changed: bool


def settings_of(config: TrainConfig) -> list[Setting]:
    """Every setting with its value, and whether the preset has another."""
    preset, found = TrainConfig.preset_of(config.preset), []
    for item in fields(TrainConfig):
        if item.name not in ("preset", "given"):
            value = getattr(config, item.name)
            found.append(Setting(item.name, item.metadata["words"], value, value != getattr(preset, item.name)))
    return found


def teacher_words(choices: Iterable[TeacherChoice]) -> dict[str, tuple[str, str]]:
    """Title and explanation of each teacher: what it is, and what the clip has for it or lacks."""
    return {
        choice.name: (TEACHER_WORDS[choice.name][0], f"{TEACHER_WORDS[choice.name][1]} {sentence(choice.reason)}") for choice in choices
    }


def sentence(text: str) -> str:
    """With a capital letter and a full stop."""
    return text[:1].upper() + text[1:].rstrip(".") + "."

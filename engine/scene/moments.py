"""Questions asked of a whole clip: in which frames they are answered, and with how large a mask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from degense.engine.progress import Steps
from degense.engine.scene.clip_query import decode_frames, encode_expressions
from degense.engine.scene.scene import Scene
from degense.engine.semantics.moments import Moment, expressions, frames_of, moments
from degense.engine.semantics.prompts import PromptSet


@dataclass(frozen=True)
class Answer:
    """What a clip says to a question."""

    text: str
    kept: np.ndarray  # bool [frames]; those that answer it
    areas: np.ndarray  # float64 [frames]; share of the picture that its mask covers, whether the frame is kept or not
    moments: tuple[Moment, ...]


def ask_clip(scene: Scene, prompts: PromptSet) -> Steps[tuple[Answer, ...]]:
    """Answer each prompt on all frames of a clip, as `decode_frame` would.

    PromptError where a prompt is not understood, DegenseError without semantics.
    """
    questions = [scene.question(text) for text in prompts.prompts]
    parts = list(dict.fromkeys(part for question in questions for part in expressions(question)))
    areas = np.zeros((len(parts), scene.frames))
    for frame, found in decode_frames(scene, encode_expressions(scene, parts, prompts), range(scene.frames)):
        areas[:, frame] = found.areas
        yield (frame + 1) / scene.frames, f"frame {frame}"
    by_part = dict(zip(parts, areas, strict=True))
    kept = [frames_of(question, by_part) for question in questions]
    return tuple(
        Answer(text, of_text, by_part[question.what], moments(of_text, by_part[question.what]))
        for text, question, of_text in zip(prompts.prompts, questions, kept, strict=True)
    )


def answers_json(answers: Sequence[Answer], fps: float) -> dict[str, Any]:
    """Moments, kept frames and areas of each question, as JSON values."""

    def values(answer: Answer) -> dict[str, Any]:
        numbers = {"kept": answer.kept.tolist(), "areas": answer.areas.round(6).tolist()}
        return {"question": answer.text, "moments": [vars(moment) for moment in answer.moments], **numbers}

    return {"fps": fps, "questions": [values(answer) for answer in answers]}


__all__ = ["Answer", "Moment", "answers_json", "ask_clip"]

"""All baselines of a clip, and which methods lie below them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from degense.engine.clip import Clip
from degense.engine.progress import Progress, silent
from degense.engine.research.baselines.clip_flow import ClipFlow
from degense.engine.research.baselines.images import image_baselines
from degense.engine.research.baselines.masks import mask_baselines
from degense.engine.research.baselines.motion import motion_baselines

Scores = Mapping[str, Any]


def score_baselines(clip: Clip, teacher: str, progress: Progress = silent, flow: ClipFlow | None = None) -> dict[str, dict[str, Any]]:
    """Scores by name of baseline, under the keys and by the protocol of `engine.metrics.evaluate`.

    A baseline has the scores of what it predicts and no others. Masks: for a teacher, where the clip has label maps on held-out frames; a
    closed-set label map takes the place of the masks of a decoder (`miou`: {"labels": …}). Motion: where the clip brings exact truth.

    Parameters
    ----------
    teacher : str
        As `teacher_by_name` takes it; "none" leaves masks out.
    flow : ClipFlow, optional
        Of the same clip, where it was measured already.
    """
    followed = flow or ClipFlow(clip, lambda fraction, words: progress(0.5 * fraction, words))
    found = dict(image_baselines(clip))
    progress(0.6, "comparing motion")
    found |= motion_baselines(clip, followed)
    if teacher != "none":
        found |= mask_baselines(clip, teacher, followed, lambda fraction, words: progress(0.7 + 0.3 * fraction, words))
    return found


def number(scores: Scores, key: str) -> float | None:
    """A score by its key; of one by decoder, the best. None where there is none."""
    value = scores.get(key)
    if isinstance(value, Mapping):
        value = max((v for v in value.values() if v is not None), default=None)
    return value


def below_baseline(
    rows: Mapping[str, Scores], baselines: Mapping[str, Scores], key: str, larger_is_better: bool = True
) -> dict[str, list[str]]:
    """The names of rows that lie below a baseline, each with the baselines that are better by this score, the best first."""
    sign = 1 if larger_is_better else -1
    marks = {name: sign * value for name, scores in baselines.items() if (value := number(scores, key)) is not None}
    order = sorted(marks, key=lambda name: -marks[name])
    values = {name: number(scores, key) for name, scores in rows.items()}
    below = {name: [other for other in order if marks[other] > sign * value] for name, value in values.items() if value is not None}
    return {name: better for name, better in below.items() if better}


def note(below: Mapping[str, list[str]], score: str) -> str:
    """The words under a table whose rows are marked with †; empty when none is."""
    if not below:
        return ""
    return f"† {score} below " + "; ".join(f"{' and '.join(better)} ({name})" for name, better in below.items()) + "."

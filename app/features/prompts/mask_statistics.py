"""Statistics of the masks of prompts: area, confidence and similarities in a frame, and areas over time, which are saved. No Qt."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.session.state import PersistentState
from degense.app.session.view_state import ViewState
from degense.engine.errors import RunError, what_is_wrong

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: Steps of a histogram of similarities from 0 to 1; what is smaller or larger falls into the first or last.
BINS = 50
#: Curves kept; the oldest go first.
KEPT = 64
LONGEST = 1_000_000

Key = tuple[str, str, float, tuple[str, ...]]


@dataclass(frozen=True)
class MaskStatistics:
    """The mask of a prompt in one frame."""

    text: str
    area: float  # share of the frame that the mask covers
    confidence: float  # the share of the mask that is expected to be right, in [0, 1] (`FrameSemantics.confidence`)
    histogram: np.ndarray  # int [BINS]; pixels by the similarity that the decoder compares with the threshold


def measure_masks(
    scene: Scene, frame: int, view_state: ViewState
) -> Generator[tuple[MaskStatistics, ...], None, tuple[MaskStatistics, ...]]:
    """The statistics of each visible prompt; yields those that are known."""
    from degense.engine.scene.clip_query import decode_frame
    from degense.engine.semantics.prompts import kind_of

    query, prompts = scene.query(frame), view_state.prompt_set
    classes = scene.vectors((*scene.classes, *prompts.negatives))
    known: tuple[MaskStatistics, ...] = ()
    for text in prompts.prompts:
        included = scene.included(text)
        [mask] = decode_frame(scene, replace(prompts, prompts=(text,)), frame).masks
        counts, _ = np.histogram(np.clip(query.read(included, kind_of(prompts.decoder)), 0.0, 1.0), BINS, (0.0, 1.0))
        known = (*known, MaskStatistics(text, float(mask.mean()), query.confidence(included, mask, classes), counts))
        yield known
    return known


def key_of(text: str, view_state: ViewState) -> Key:
    """What the area of a prompt depends on: its words, and how masks are decided."""
    return text.casefold(), view_state.decoder, round(view_state.threshold, 4), view_state.negative_texts


class AreaCurves(PersistentState):
    """Curves of area by prompt and way to decide; NaN where a frame has not been computed."""

    counts = False  # they can be computed anew

    def __init__(self) -> None:
        super().__init__()
        self._curves: dict[Key, np.ndarray] = {}

    def curve(self, text: str, view_state: ViewState, frames: int) -> np.ndarray:
        """The curve of a prompt, float [frames]; what is written into it is kept."""
        key = key_of(text, view_state)
        if key not in self._curves or len(self._curves[key]) != frames:
            self._curves[key] = np.full(frames, np.nan)
            while len(self._curves) > KEPT:
                del self._curves[next(iter(self._curves))]
        return self._curves[key]

    def missing(self, view_state: ViewState, frames: int, around: int) -> list[int]:
        """Frames at which the area of a visible prompt is not known yet, those near `around` first."""
        unknown = np.zeros(frames, bool)
        for prompt in view_state.visible_prompts:
            unknown |= np.isnan(self.curve(prompt.text, view_state, frames))
        return sorted(map(int, np.flatnonzero(unknown)), key=lambda frame: abs(frame - around))

    def clear(self) -> None:
        self._curves.clear()

    def to_json(self) -> Any:
        """Only whole curves; a piece is soon computed."""
        whole = {key: values for key, values in self._curves.items() if np.isfinite(values).all()}
        return [[*key[:3], list(key[3]), [round(float(value), 6) for value in values]] for key, values in whole.items()]

    def from_json(self, data: Any, source: str) -> None:
        try:
            curves = {}
            for text, decoder, threshold, negatives, values in data[-KEPT:]:
                curve = np.array(values, float)
                if curve.ndim != 1 or len(curve) > LONGEST or not np.isfinite(curve).all():
                    raise ValueError("not a curve")
                curves[(str(text), str(decoder), float(threshold), tuple(map(str, negatives)))] = curve
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise RunError(f"{source} does not hold areas of masks ({what_is_wrong(error)}).") from error
        self._curves = curves


def areas(scene: Scene, view_state: ViewState, frames: list[int]) -> Generator[tuple[int, dict[str, float]], None, None]:
    """Areas (share of the frame) of the visible prompts' masks in these frames. Yields (frame, {text: area})."""
    from degense.engine.scene.clip_query import query_clip

    prompts = view_state.prompt_set
    for frame, found in query_clip(scene, prompts, frames):
        yield frame, dict(zip(prompts.prompts, found.areas.tolist(), strict=True))

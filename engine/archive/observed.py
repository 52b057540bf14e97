"""What an index keeps of a run: the facts of all frames as columns, and small pictures."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field

import cv2
import numpy as np

from degense.engine.archive.frame_facts import PERCENTILES, Key, frame_facts
from degense.engine.archive.layout import FORMATS, OF_FRAMES
from degense.engine.archive.names import Things
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps
from degense.engine.scene import Scene
from degense.engine.scene.clip_query import encode_expressions
from degense.engine.semantics.prompts import PromptSet
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from degense.engine.vocabulary.questions import Noun

#: Small pictures of a run: so many evenly spaced ones, beside that of the frame in which each thing is largest.
PICTURES, LONGER_SIDE, JPEG_QUALITY = 32, 128, 70


@dataclass
class Observed:
    """A run as an index has it. Columns that hold nothing but zeros are left out."""

    frames: int
    size: tuple[int, int]  # (width, height), pixels
    fps: float
    unit: str
    things: Things
    columns: dict[Key, np.ndarray] = field(default_factory=dict)
    pictures: dict[int, bytes] = field(default_factory=dict)  # frame → JPEG


def observe(scene: Scene) -> Steps[Observed]:
    """Look through a run, with the default decoder. DegenseError without semantics or classes."""
    things = Things.of(scene.classes, scene.run.info.get("encoder") == EmbeddedEncoder.name)
    if not scene.has_semantics or not things.classes:
        raise DegenseError(f"{scene.name} has no classes to look for, because it was trained without semantics.")
    found = Observed(scene.frames, scene.clip_size, scene.fps, scene.unit, things)
    asked = encode_expressions(scene, [Noun(name) for name in things.names], PromptSet())
    spread = {round(place) for place in np.linspace(0, scene.frames - 1, min(PICTURES, scene.frames))}
    table = ColumnTable(scene.frames)
    for frame in range(scene.frames):
        semantics = scene.renderer.new_query(frame, scene.camera(frame))
        masks = dict(zip(things.names, semantics.decode(asked).masks, strict=True))
        facts = frame_facts(masks, things.classes)
        moved = scene.render(frame, what=("displacement",))["displacement"]
        for name, vectors in zip(things.names, asked.included, strict=True):
            if (mask := masks[name]).any():
                facts["confidence", name] = np.array([semantics.confidence(vectors, mask, asked.classes)])
                facts["displacement", name] = _percentiles(moved[mask])[None]
        table.add(frame, facts)
        if frame in spread:
            found.pictures[frame] = small_jpeg(scene.render_rgb(frame))
        yield (frame + 1) / scene.frames, f"{scene.name}, frame {frame}"
    found.columns = table.columns()
    for key, values in found.columns.items():
        if key[0] == "pixels" and (peak := int(values.argmax())) not in found.pictures:
            found.pictures[peak] = small_jpeg(scene.render_rgb(peak))
    return found


class ColumnTable:
    """Facts of frames, put together to columns."""

    def __init__(self, frames: int) -> None:
        self._frames = frames
        self._rows: dict[Key, list[tuple[int, np.ndarray]]] = defaultdict(list)

    def add(self, frame: int, facts: dict[Key, np.ndarray]) -> None:
        """Frames come in order, each once."""
        for key, values in facts.items():
            self._rows[key].append((frame, values))

    def columns(self) -> dict[Key, np.ndarray]:
        """Values of all frames [frames, …], or of the objects of all frames in their order [objects, …]."""
        made: dict[Key, np.ndarray] = {}
        counts = {key[1]: self._of_frames(key, rows) for key, rows in self._rows.items() if key[0] == "counts"}
        for key, rows in self._rows.items():
            if key[0] in OF_FRAMES:
                made[key] = self._of_frames(key, rows)
                continue
            first = np.concatenate([[0], counts[key[1]].astype(np.int64).cumsum()])
            made[key] = _zeros(key, int(first[-1]))
            for frame, values in rows:
                made[key][first[frame] : first[frame + 1]] = values
        return made

    def _of_frames(self, key: Key, rows: list[tuple[int, np.ndarray]]) -> np.ndarray:
        values = _zeros(key, self._frames)
        for frame, value in rows:
            values[frame] = value[0]
        return values


def _zeros(key: Key, length: int) -> np.ndarray:
    kind, axes = FORMATS[key[0]]
    return np.zeros((length, *axes), kind)


def _percentiles(values: np.ndarray) -> np.ndarray:
    known = values[np.isfinite(values)]
    return np.percentile(known, PERCENTILES) if len(known) else np.zeros(len(PERCENTILES))


def small_jpeg(rgb: np.ndarray) -> bytes:
    """A picture uint8 [H, W, 3] as an index keeps it."""
    scale = min(1.0, LONGER_SIDE / max(rgb.shape[:2]))
    small = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return data.tobytes()

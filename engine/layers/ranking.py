"""Where a layer of motion is worst: frames and places worth a look, the worst first."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.layers.layer import Layer, LayerRequest
from degense.engine.scene import Scene

#: Per cent of a frame's known pixels that lie below its value: one stray pixel is no finding.
PERCENTILE = 99.0
#: A place is as wide as this share of the frame; its value is the mean over it, where at least half of it is known.
PLACE = 1 / 24
KNOWN = 0.5
#: Candidates a frame, and how near (in widths of a place, in frames) a worse one swallows a lesser one.
PEAKS, NEAR, NEAR_FRAMES = 8, 2.0, 4


@dataclass(frozen=True)
class Finding:
    """A frame, or a place in it: x, y in pixels (of a frame, its worst place), and its value in the layer's unit.

    The value of a frame is the 99th percentile over its known pixels, that of a place the mean over it. Signed layers are ranked by size
    and keep their sign.
    """

    frame: int
    x: float
    y: float
    value: float


@dataclass(frozen=True)
class Ranking:
    """The worst frames (one finding each) and places of a layer, the worst first; `done` of `frames` have been looked at."""

    layer: str
    unit: str
    frames: tuple[Finding, ...] = ()
    places: tuple[Finding, ...] = ()
    done: int = 0


def rank(scene: Scene, layer: Layer, request: LayerRequest, count: int = 50) -> Generator[Ranking, None, Ranking]:
    """Look through all frames; yields the ranking so far after each, and returns that of all.

    Pixels whose value is a guess, or not known, do not count. DegenseError when the layer is none of motion.
    """
    if not layer.of_motion:
        raise DegenseError(f"{layer.title} has no worst places; choose a layer of motion, such as displacement or warp.")
    found, peaks = [], []
    ranking = Ranking(layer.name, layer.unit(scene))
    for frame in range(scene.frames):
        image = layer.image(scene, LayerRequest(frame, prompt_set=request.prompt_set))
        values = image.values if image.uncertain is None else np.where(image.uncertain, np.nan, image.values)
        here = [Finding(frame, *peak) for peak in places(values)]
        peaks += here
        if here:
            known = np.abs(values[np.isfinite(values)])
            sign = np.sign(here[0].value) if layer.signed else 1.0
            found.append(Finding(frame, here[0].x, here[0].y, float(sign * np.percentile(known, PERCENTILE))))
        near = NEAR * PLACE * scene.clip_size[0]
        ranking = Ranking(layer.name, ranking.unit, tuple(_worst(found)[:count]), tuple(apart(peaks, near)[:count]), frame + 1)
        yield ranking
    return ranking


def places(values: np.ndarray) -> list[tuple[float, float, float]]:
    """Up to `PEAKS` places of a frame, float [H, W] with NaN where nothing is known: (x, y, mean over the place), the largest first."""
    size = max(3, round(PLACE * values.shape[1]) | 1)
    known = np.isfinite(values)
    share = cv2.blur(known.astype(np.float32), (size, size), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.blur(np.where(known, values, 0).astype(np.float32), (size, size), borderType=cv2.BORDER_CONSTANT) / np.maximum(share, KNOWN)
    strength = np.where(share >= KNOWN, np.abs(mean), 0.0)
    peaks = []
    for _ in range(PEAKS):
        y, x = np.unravel_index(int(strength.argmax()), strength.shape)
        if strength[y, x] <= 0:
            break
        peaks.append((float(x) + 0.5, float(y) + 0.5, float(mean[y, x])))
        strength[max(0, y - size) : y + size + 1, max(0, x - size) : x + size + 1] = 0
    return peaks


def apart(findings: Iterable[Finding], near: float) -> list[Finding]:
    """The findings, the worst first, without those within `near` pixels and `NEAR_FRAMES` frames of a worse one."""
    kept: list[Finding] = []
    for finding in _worst(findings):
        if not any(
            abs(finding.frame - worse.frame) <= NEAR_FRAMES and np.hypot(finding.x - worse.x, finding.y - worse.y) <= near for worse in kept
        ):
            kept.append(finding)
    return kept


def _worst(findings: Iterable[Finding]) -> list[Finding]:
    return sorted(findings, key=lambda finding: -abs(finding.value))

"""A scene at sampled times as quantised numbers: what the viewer of a shared page reads."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.engine.progress import Steps
from degense.engine.raster.limits import MIN_ALPHA

if TYPE_CHECKING:
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet
    from degense.engine.splats import Splats

#: Most bytes of a page's numbers before they are compressed. Longer or larger scenes are sampled at fewer times.
MOST_BYTES = 256 << 20
#: Bytes of a Gaussian at one time: 14 numbers of 2 bytes for place, shape, opacity and colour, 2 for its displacement, 1 for its mask.
BYTES_OF_ONE = 31


@dataclass
class Samples:
    """Numbers as integers, and how to read them."""

    #: For each array: name, width (components), times, bytes a number, and low and high, which 0 and the largest integer stand for.
    arrays: list[dict[str, Any]] = field(default_factory=list)
    parts: list[bytes] = field(default_factory=list)

    def add(self, name: str, values: np.ndarray) -> None:
        """Store floats [T, N, c] as 16-bit integers between their smallest and largest."""
        low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
        scaled = (values.astype(np.float64) - low) * (65535 / (high - low) if high > low else 0.0)
        self._store(name, scaled.round().astype(np.uint16), low, high)

    def add_numbers(self, name: str, values: np.ndarray) -> None:
        """Store uint8 [T, N, c] as they are."""
        self._store(name, values, 0.0, 255.0)

    def _store(self, name: str, values: np.ndarray, low: float, high: float) -> None:
        """Differences from one time to the next, the low bytes of all numbers before the high ones: what hardly changes compresses well."""
        size = values.itemsize
        changes = np.diff(values, axis=0, prepend=np.zeros_like(values[:1]))  # wraps around, and so does the sum that undoes it
        planes = np.ascontiguousarray(changes).reshape(-1, 1).view(np.uint8).reshape(-1, size)
        self.parts.append(np.ascontiguousarray(planes.T).tobytes())
        times, _, width = values.shape
        self.arrays.append({"name": name, "width": width, "times": times, "size": size, "low": low, "high": high})


def sampled_frames(frames: int, gaussians: int) -> np.ndarray:
    """Frames at which a scene is sampled, float64 [T]: all, or as many, evenly spread, as `MOST_BYTES` hold; two at least."""
    most = max(2, MOST_BYTES // (BYTES_OF_ONE * max(1, gaussians)))
    return np.linspace(0, frames - 1, min(frames, most))


def sample(scene: Scene, prompts: PromptSet | None) -> Steps[tuple[np.ndarray, Samples]]:
    """The sampled frames and the Gaussians at them; without `prompts` there are no masks. PromptError for a word that is not understood."""
    from degense.engine.scene.clip_query import decode_splats

    frames = sampled_frames(scene.frames, len(scene.splats(0.0)))
    states, moved, certain, owners = [], [], [], []
    for done, frame in enumerate(frames):
        yield 0.9 * done / len(frames), f"frame {frame:g}"
        states.append(_numbers(scene.splats(frame)))
        moved.append(scene.states.displacement(frame).cpu().numpy())
        certain.append(_certain(scene, frame))
        if prompts is not None:
            owners.append(decode_splats(scene, prompts, frame).numbers)
    yield 0.9, "packing"
    samples = Samples()
    gathered = {name: np.stack([state[name] for state in states]) for name in states[0]}
    _hold_the_invisible(gathered)
    _align_signs(gathered["quats"])
    base = gathered["means"][0]
    samples.parts.append(base.astype("<f4").tobytes())
    gathered["means"] -= base
    for name, values in gathered.items():
        samples.add(name, values)
    samples.add("displacement", np.stack(moved)[..., None])
    if prompts is not None:
        samples.add_numbers("owners", np.stack(owners)[..., None])
    samples.add_numbers("certain", np.stack(certain)[..., None])
    return frames, samples


def _numbers(splats: Splats) -> dict[str, np.ndarray]:
    """What is drawn of the Gaussians at one time, float32 [N, c] each; scales as logarithms."""
    tensors = {
        "means": splats.means,
        "quats": splats.quats / splats.quats.norm(dim=1, keepdim=True).clamp_min(1e-12),
        "scales": splats.scales.clamp_min(1e-6).log(),
        "opacities": splats.opacities[:, None],
        "colors": splats.colors,
    }
    return {name: tensor.cpu().numpy().copy() for name, tensor in tensors.items()}


def _hold_the_invisible(values: dict[str, np.ndarray]) -> None:
    """Give a Gaussian that is not seen at a time the place and shape that it had when it last was: what went far away takes no range."""
    seen = values["opacities"][..., 0] >= MIN_ALPHA
    ever = seen.any(0)
    last = np.where(ever, seen.argmax(0), 0)  # before the first time that it is seen: as then
    for time in range(len(seen)):
        last = np.where(seen[time], time, last)
        for name in ("means", "quats", "scales", "colors"):
            values[name][time] = values[name][last, np.arange(len(last))]
    values["means"][:, ~ever] = values["means"][:, ever].mean((0, 1)) if ever.any() else 0.0


def _align_signs(quats: np.ndarray) -> None:
    """q and −q are one rotation: take, in place, the one nearer to that of the time before, so that one can interpolate. [T, N, 4]."""
    for time in range(1, len(quats)):
        quats[time] *= np.where((quats[time] * quats[time - 1]).sum(-1, keepdims=True) < 0, -1, 1)


def _certain(scene: Scene, frame: float) -> np.ndarray:
    """1 for Gaussians whose displacement is no guess (`States.guesses`), uint8 [N]; all where the run does not tell."""
    if scene.observability is None:
        return np.ones(len(scene.model), np.uint8)
    return (~scene.states.guesses(frame)).cpu().numpy().view(np.uint8)

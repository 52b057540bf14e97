"""What can be followed through time: a spot, a region, or everything that a prompt finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from degense.engine.scene import Scene

#: Corners of an outline, at most; a hand draws some hundreds.
MOST_CORNERS = 100_000


@dataclass(frozen=True)
class Spot:
    """The tissue seen at pixel position (x, y) of a frame."""

    frame: int
    x: float
    y: float

    def __str__(self) -> str:
        return f"spot at ({int(self.x)}, {int(self.y)}) of frame {self.frame}"  # the pixel, as the probe names it


@dataclass(frozen=True)
class Region:
    """The tissue seen inside an outline of a frame; corners (x, y) in pixels."""

    frame: int
    outline: tuple[tuple[float, float], ...]

    def __str__(self) -> str:
        xs, ys = zip(*self.outline, strict=True)
        size = f"{max(xs) - min(xs):.0f} × {max(ys) - min(ys):.0f} px"
        return f"region of {size} at ({np.mean(xs):.0f}, {np.mean(ys):.0f}) of frame {self.frame}"


@dataclass(frozen=True)
class Found:
    """What a prompt finds, in each frame anew."""

    prompt: str

    def __str__(self) -> str:
        return f"mask of {self.prompt}"


Target = Spot | Region | Found


def target_to_json(target: Target | None) -> Any:
    """JSON values from which `target_from_json` makes the target again."""
    match target:
        case Spot():
            return {"frame": target.frame, "spot": [target.x, target.y]}
        case Region():
            return {"frame": target.frame, "outline": [list(corner) for corner in target.outline]}
        case Found():
            return {"prompt": target.prompt}
    return None


def target_from_json(data: Any) -> Target | None:
    """The target that `target_to_json` wrote. ValueError, KeyError or TypeError for anything else."""
    if data is None:
        return None
    if "prompt" in data:
        return Found(str(data["prompt"])[:200])
    corners = tuple((float(x), float(y)) for x, y in ([data["spot"]] if "spot" in data else data["outline"]))
    if not np.isfinite(corners).all() or len(corners) == 2 or len(corners) > MOST_CORNERS:
        raise ValueError("what was followed is nowhere")
    frame = max(0, int(data["frame"]))
    return Spot(frame, *corners[0]) if len(corners) == 1 else Region(frame, corners)


def material(scene: Scene, place: Spot | Region) -> tuple[np.ndarray, np.ndarray]:
    """Indices [k] and weights [k] (sum 1) of the Gaussians that make the visible surface at a place.

    DegenseError when nothing is reconstructed there.
    """
    from degense.engine.scene.material import material_at, material_inside

    if isinstance(place, Spot):
        return material_at(scene, place.frame, place.x, place.y)
    return material_inside(scene, place.frame, inside_of(place.outline, *scene.clip_size))


def inside_of(outline: tuple[tuple[float, float], ...], width: int, height: int) -> np.ndarray:
    """Pixels whose middle lies inside a closed outline, bool [height, width]."""
    from skimage.draw import polygon2mask

    corners = np.asarray(outline, float)[:, ::-1] - 0.5
    return polygon2mask((height, width), corners)

"""What is known of one spot: its values at this instant, and how it went on over time."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from app.pictures import get_layer
from app.terminal import Steps
from engine.errors import DegenseError

if TYPE_CHECKING:
    from engine.scene import Scene

#: Gaussians that a spot is followed by, and how far (pixels) their centres may lie from it.
FOLLOWED, REACH = 32, 12.0


@dataclass(frozen=True)
class ProbeMaps:
    """Values of every pixel of one frame, so that hovering only looks them up. What is not drawn yet is None.

    Attributes
    ----------
    scalars : dict of str to float [H, W]
        Of `depth`, `displacement` and `warp`.
    uncertain : dict of str to bool [H, W]
        Where one of them is a guess.
    best : uint8 [H, W]
        Index into `classes`, 255 for none.
    """

    frame: int
    rgb: np.ndarray
    units: dict[str, str]
    classes: tuple[str, ...]
    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    uncertain: dict[str, np.ndarray] = field(default_factory=dict)
    best: np.ndarray | None = None

    def colour(self, x: int, y: int) -> tuple[int, int, int]:
        red, green, blue = (int(channel) for channel in self.rgb[y, x])
        return red, green, blue

    def rows(self, x: int, y: int) -> list[tuple[str, str]]:
        """Label and text of each value at a pixel, for the probe panel."""
        rows = [("position", f"{x}, {y} px"), ("colour", "{} {} {}".format(*self.colour(x, y)))]
        for name, values in self.scalars.items():
            value = float(values[y, x])
            guess = " (a guess)" if name in self.uncertain and self.uncertain[name][y, x] else ""
            rows.append((name, f"{value:.3g} {self.units[name]}".strip() + guess if np.isfinite(value) else "not known here"))
        if self.best is not None:
            index = int(self.best[y, x])
            rows.append(("best class", self.classes[index] if index < len(self.classes) else "none"))
        return rows


def probe_maps(scene: Scene, frame: int) -> Generator[ProbeMaps, None, ProbeMaps]:
    """The maps of a frame. Yields what is there as it grows; returns all."""
    from engine.layers import LayerRequest

    request = LayerRequest(frame=frame)
    maps = ProbeMaps(frame, scene.picture(frame), {}, tuple(scene.classes))
    yield maps
    for name in ("depth", "displacement", "warp"):
        if get_layer(name).missing(scene, ()):
            continue
        image = get_layer(name).image(scene, request)
        maps = replace(maps, scalars=maps.scalars | {name: image.values}, units=maps.units | {name: image.unit})
        if image.uncertain is not None:
            maps = replace(maps, uncertain=maps.uncertain | {name: image.uncertain})
        yield maps
    if scene.has_semantics and scene.classes:
        maps = replace(maps, best=scene.query(frame).label_map(scene.vectors(scene.classes), "argmax"))
    return maps


@dataclass(frozen=True)
class Curves:
    """How a spot went on.

    Attributes
    ----------
    frames : int [T]
    displacement : float [T]
        Distance from its place at the reference frame.
    similarity : dict of str to float [T]
        Cosine to each prompt.
    where : str
        Which spot, in words.
    """

    frames: np.ndarray
    displacement: np.ndarray
    unit: str
    similarity: dict[str, np.ndarray]
    where: str


def follow(scene: Scene, frame: int, x: float, y: float, prompts: tuple[str, ...]) -> Steps[Curves]:
    """Follow the tissue seen at pixel (x, y) of `frame` through the whole sequence.

    The spot is the weighted mean of the nearest Gaussians that lie on the visible surface there; as Gaussians keep their identity in
    time, this follows the material, not the pixel. Yields (fraction, words).

    Raises
    ------
    DegenseError
        When nothing is drawn at that pixel.
    """
    yield 0.0, "finding the spot"
    indices, weights = spot(scene, frame, x, y)
    reference = scene.splats(scene.reference_frame).means[indices].cpu().numpy()
    basis = scene.basis
    meanings = [basis.project(scene.meanings(prompt)) for prompt in prompts] if basis is not None else []
    displacement = np.zeros(scene.frames)
    similarity = np.zeros((len(meanings), scene.frames))
    for index in range(scene.frames):
        yield index / scene.frames, f"frame {index}"
        splats = scene.splats(index)
        displacement[index] = weights @ np.linalg.norm(splats.means[indices].cpu().numpy() - reference, axis=1)
        if meanings:
            latent = weights @ splats.semantics[indices].cpu().numpy()
            latent /= max(1e-12, float(np.linalg.norm(latent)))
            similarity[:, index] = [(meaning @ latent).max() for meaning in meanings]
    where = f"spot at ({x:.0f}, {y:.0f}) of frame {frame}"
    named = dict(zip(prompts, similarity, strict=False))  # none without semantics
    return Curves(np.arange(scene.frames), displacement, scene.unit, named, where)


def spot(scene: Scene, frame: int, x: float, y: float) -> tuple[np.ndarray, np.ndarray]:
    """Indices [k] and weights [k] (sum 1) of the Gaussians that make the visible surface at a pixel."""
    splats = scene.splats(frame)
    pixels, depth = scene.camera(frame).project(splats.means.cpu().numpy().astype(np.float64))
    surface = float(scene.render(frame, what=("depth",))["depth"][int(y), int(x)])  # NaN where nothing is drawn: then nothing is near
    distance = np.hypot(pixels[:, 0] - x, pixels[:, 1] - y)
    near = np.flatnonzero((distance < REACH) & (np.abs(depth - surface) < 0.1 * surface))
    weights = splats.opacities.cpu().numpy()[near] * np.exp(-((distance[near] / (REACH / 3)) ** 2) / 2)
    best = np.argsort(weights)[-FOLLOWED:]
    if not len(best) or weights[best].sum() < 1e-6:
        raise DegenseError("Nothing is reconstructed at this spot; click on tissue.")
    return near[best], weights[best] / weights[best].sum()

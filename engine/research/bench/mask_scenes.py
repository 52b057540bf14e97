"""Frames with exact label maps for mask benchmarks: phantoms, hand-made instruments, latents spoilt as a teacher and a field do."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.data.synthetic.anatomy import CLASSES
from degense.engine.data.synthetic.scene import PhantomScene
from degense.engine.raster import Render, rasterize
from degense.engine.semantics.basis import fit_basis
from degense.engine.semantics.masks.query import FrameSemantics, query_of
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from degense.engine.splats import Splats

#: Of the hand-made scene: widths of its instruments, pixels; two tissues, an organ, and the instruments.
WIDTHS = (1, 2, 3, 4, 5, 6)
HAND_CLASSES = ("liver", "fat", "gallbladder", "grasper")
SENSOR_NOISE = 1.5  # grey levels


@dataclass(frozen=True)
class MaskFrame:
    """One picture and what it shows.

    Attributes
    ----------
    rgb : uint8 [H, W, 3]
    labels : uint8 [H, W]
    classes : tuple of str
    """

    rgb: np.ndarray
    labels: np.ndarray
    classes: tuple[str, ...]


@dataclass(frozen=True)
class LatentDegradation:
    """How latents differ from the text vectors of the true labels.

    Attributes
    ----------
    blur : float
        Standard deviation, pixels: Gaussians are wider than the things they show.
    noise : float
        Length of the error of a latent, relative to its own, of correlation length `grain` pixels.
    grain : float
    confused : float
        Share of the picture where blobs of `grain` to 4 `grain` pixels across have another class.
    """

    blur: float = 0.0
    noise: float = 0.0
    grain: float = 1.0
    confused: float = 0.0

    @property
    def words(self) -> str:
        """The same in words."""
        parts = [
            f"blurred by {self.blur:g} px" if self.blur else "",
            f"errors of {100 * self.noise:g} % of grain {self.grain:g} px" if self.noise else "",
            f"{100 * self.confused:g} % of the picture another class" if self.confused else "",
        ]
        return ", ".join(part for part in parts if part) or "unchanged"

    def apply(self, labels: np.ndarray, vectors: np.ndarray, seed: int) -> np.ndarray:
        """Latents, float32 [H, W, d], of a label map uint8 [H, W] and the classes' latents [n, d]."""
        rng = np.random.default_rng(seed)
        spoilt, size = labels.copy(), labels.size
        present = np.unique(labels)
        confused = 0.0
        while confused < self.confused * size:
            radius = 0.5 * self.grain * rng.uniform(1.0, 4.0)
            centre = int(rng.integers(labels.shape[1])), int(rng.integers(labels.shape[0]))
            cv2.circle(spoilt, centre, round(radius), int(rng.choice(present)), -1)
            confused += np.pi * radius**2
        latent = vectors[spoilt].astype(np.float32)
        if self.blur:
            latent = cv2.GaussianBlur(latent, (0, 0), self.blur).reshape(latent.shape)
        if self.noise:
            error = rng.standard_normal(latent.shape).astype(np.float32)
            if self.grain > 1:
                error = cv2.GaussianBlur(error, (0, 0), self.grain / 2).reshape(latent.shape)
            latent = latent + self.noise * error / np.sqrt(np.square(error).mean() * latent.shape[2])
        return latent


#: From exact to worse than any trained scene seen so far.
DEGRADATIONS = {
    "exact": LatentDegradation(),
    "blurred": LatentDegradation(blur=1.5),
    "noisy": LatentDegradation(blur=0.7, noise=0.5, grain=1.0),
    "confused": LatentDegradation(blur=0.7, grain=3.0, confused=0.03),
    "all": LatentDegradation(blur=1.0, noise=0.5, grain=3.0, confused=0.03),
}


def phantom_frame(width: int, height: int, seed: int, time: float) -> MaskFrame:
    """A frame of the phantom "cautery" at clip time `time` in [0, 1]."""
    view = PhantomScene("cautery", width, height, seed, 0.0).view(time)
    noise = np.random.default_rng(seed).normal(0, SENSOR_NOISE, view.rgb.shape)
    return MaskFrame(np.clip(np.rint(view.rgb * 255 + noise), 0, 255).astype(np.uint8), view.labels, tuple(CLASSES))


def hand_frame(width: int, height: int, seed: int, widths: tuple[int, ...] = WIDTHS, contrast: float = 1.0) -> MaskFrame:
    """Instruments of these widths, pixels, over two tissues and an organ, with highlights on instruments and tissue.

    Parameters
    ----------
    widths : tuple of int
        One straight instrument each, ending in a tip that narrows to a pixel.
    contrast : float
        Of the instruments against the mean colour of the tissue: 0 hides them from the superpixels.
    """
    rng = np.random.default_rng(seed)
    labels = np.zeros((height, width), np.uint8)
    labels[:, width // 2 :] = 1
    cv2.ellipse(labels, (width // 3, int(0.6 * height)), (width // 5, height // 6), 0, 0, 360, 2, -1)
    shine = np.zeros((height, width), np.float32)
    for thickness in widths:
        angle, length = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.4) * min(width, height)
        centre = rng.uniform([0.2, 0.25], [0.8, 0.75]) * (width, height)
        way = np.array([np.cos(angle), np.sin(angle)])
        start, end = centre - way * length / 2, centre + way * length / 2
        _line(labels, start, end, 3, thickness)
        for narrower in range(thickness - 1, 0, -1):
            _line(labels, end, end + 3 * way, 3, narrower)
            end = end + 3 * way
        if thickness >= 3:
            _line(shine, start + 0.2 * length * way, start + 0.7 * length * way, 1.0, 1)
    for _ in range(12):  # wet tissue
        spot = int(rng.integers(width)), int(rng.integers(height))
        cv2.ellipse(shine, spot, (int(rng.integers(1, 6)), int(rng.integers(1, 4))), rng.uniform(0, 180), 0, 360, 1.0, -1)
    tissue = np.array([[150, 60, 50], [190, 120, 80], [110, 110, 60]], np.float32)
    steel = tissue.mean(0) + contrast * (np.array([150, 150, 160], np.float32) - tissue.mean(0))
    texture = cv2.GaussianBlur(rng.normal(0, 120, (height, width, 3)).astype(np.float32), (0, 0), 5)
    image = np.vstack([tissue, steel[None]])[labels] + texture
    image = cv2.GaussianBlur(image + shine[..., None] * (250 - image), (0, 0), 0.6)
    image += rng.normal(0, SENSOR_NOISE, image.shape)
    return MaskFrame(np.clip(image, 0, 255).astype(np.uint8), labels, HAND_CLASSES)


def _line(canvas: np.ndarray, start: np.ndarray, end: np.ndarray, value: float, thickness: int) -> None:
    ends = tuple(tuple(int(v) for v in np.rint(point)) for point in (start, end))
    cv2.line(canvas, *ends, value, thickness)


class MaskScene:
    """Gaussians on the pixels of a phantom frame, each with the latent of its class: what prompts cost, whatever was trained.

    Parameters
    ----------
    width, height : int
    gaussians : int
    device : str
    """

    def __init__(self, width: int, height: int, gaussians: int, device: str):
        frame = phantom_frame(width, height, 0, 0.45)
        rng = np.random.default_rng(0)
        self.vectors = EmbeddedEncoder(frame.classes).encode(frame.classes)
        self.basis = fit_basis(self.vectors, np.ones(len(self.vectors)))
        self._camera = Camera(width, height, float(width), float(width), width / 2, height / 2, np.eye(4))
        place = rng.uniform(0, (width, height), (gaussians, 2))
        column, row = place.astype(int).T
        means = np.column_stack([(place - (width / 2, height / 2)) / width, rng.uniform(0.99, 1.01, gaussians)])
        scale = 0.7 * np.sqrt(width * height / gaussians) / width
        latents = self.basis.project(self.vectors)[frame.labels[row, column]]
        values = (
            means,
            np.tile([1.0, 0, 0, 0], (gaussians, 1)),
            np.full((gaussians, 3), scale) * rng.uniform(0.7, 1.4, (gaussians, 3)),
            rng.uniform(0.5, 1.0, gaussians),
            frame.rgb[row, column] / 255.0,
            latents,
        )
        tensors = (torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=device) for array in values)
        self._splats = Splats(*tensors)

    def draw(self) -> Render:
        return rasterize(self._splats, torch.cat([self._splats.colors, self._splats.semantics], 1), self._camera)

    def query(self) -> FrameSemantics:
        """As `Scene.new_query` from a baked state."""
        return query_of(self.draw(), self.basis)

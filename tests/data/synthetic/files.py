"""Reads a phantom's files without the project's readers."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image


@dataclass
class Phantom:
    images: np.ndarray
    labels: np.ndarray
    depth: np.ndarray
    displacement: np.ndarray
    cautery: np.ndarray
    viewmats: np.ndarray
    focal: float
    centre: np.ndarray
    classes: list[str]

    def world(self, frame: int) -> np.ndarray:
        """World point of every pixel centre, float64 [H, W, 3], by solving K (R X + t) = z p."""
        height, width = self.depth.shape[1:]
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        z = self.depth[frame].astype(np.float64)
        local = np.stack([(x - self.centre[0]) / self.focal * z, (y - self.centre[1]) / self.focal * z, z, np.ones_like(z)], -1)
        return (local @ np.linalg.inv(self.viewmats[frame]).T)[..., :3]

    def pixels(self, points: np.ndarray, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Pixel position (centre of pixel 0 at 0.5) and depth of world points."""
        local = points @ self.viewmats[frame][:3, :3].T + self.viewmats[frame][:3, 3]
        return local[..., :2] / local[..., 2:] * self.focal + self.centre, local[..., 2]


def load(folder: Path) -> Phantom:
    camera = json.loads((folder / "camera.json").read_text())
    with np.load(folder / "gt.npz", allow_pickle=False) as truth:
        displacement, cautery = truth["displacement"], truth["cautery"]
    return Phantom(
        np.stack([np.array(Image.open(p)) for p in sorted((folder / "images").iterdir())]),
        np.stack([np.array(Image.open(p)) for p in sorted((folder / "labels").iterdir())]),
        np.stack([np.load(p, allow_pickle=False) for p in sorted((folder / "depth").iterdir())]),
        displacement,
        cautery,
        np.array(camera["viewmats"]),
        camera["fx"],
        np.array([camera["cx"], camera["cy"]]),
        json.loads((folder / "classes.json").read_text())["classes"],
    )

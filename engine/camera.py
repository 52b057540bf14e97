"""Pinhole cameras in the OpenCV convention: x right, y down, z forward; pixel (0, 0) has its centre at (0.5, 0.5)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Camera:
    """One view: image size, focal lengths and principal point in pixels, and the rigid map from world to camera, float64 [4, 4]."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    viewmat: np.ndarray = field(default_factory=lambda: np.eye(4))

    @property
    def intrinsics(self) -> np.ndarray:
        """K, float64 [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def scaled(self, factor: float) -> Camera:
        """The same view drawn at `factor` times the resolution (size rounded, at least 1 × 1)."""
        width, height = max(1, round(self.width * factor)), max(1, round(self.height * factor))
        sx, sy = width / self.width, height / self.height
        return replace(self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy)

    def letterboxed(self, width: int, height: int) -> Camera:
        """The camera whose image fills a viewport of `width` × `height` pixels and shows the whole of this one's image, centred."""
        return self._fitted(width, height, min(width / self.width, height / self.height))

    def filled(self, width: int, height: int) -> Camera:
        """As `letterboxed`, with no pixel that this camera does not see: it undoes that, since margins are cut off again."""
        return self._fitted(width, height, max(width / self.width, height / self.height))

    def _fitted(self, width: int, height: int, scale: float) -> Camera:
        return replace(
            self,
            width=width,
            height=height,
            fx=self.fx * scale,
            fy=self.fy * scale,
            cx=(self.cx - self.width / 2) * scale + width / 2,
            cy=(self.cy - self.height / 2) * scale + height / 2,
        )

    def with_unit(self, factor: float) -> Camera:
        """The same view of a world whose lengths were multiplied by `factor`."""
        viewmat = self.viewmat.copy()
        viewmat[:3, 3] *= factor
        return replace(self, viewmat=viewmat)

    def pixel_centres(self) -> np.ndarray:
        """Positions of the middles of all pixels, float64 [height, width, 2] (x, y)."""
        return np.stack(np.meshgrid(np.arange(self.width) + 0.5, np.arange(self.height) + 0.5), -1)

    def unproject(self, pixels: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """World points [..., 3] of pixel positions [..., 2] (x, y) at camera depths z [...]."""
        x = (pixels[..., 0] - self.cx) / self.fx * depth
        y = (pixels[..., 1] - self.cy) / self.fy * depth
        points = np.stack([x, y, np.broadcast_to(depth, x.shape)], -1)
        rotation, translation = self.viewmat[:3, :3], self.viewmat[:3, 3]
        return (points - translation) @ rotation

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixel positions [..., 2] and camera depths z [...] of world points [..., 3]."""
        local = points @ self.viewmat[:3, :3].T + self.viewmat[:3, 3]
        z = local[..., 2]
        safe = np.where(np.abs(z) < 1e-12, 1e-12, z)
        x = local[..., 0] / safe * self.fx + self.cx
        y = local[..., 1] / safe * self.fy + self.cy
        return np.stack([x, y], -1), z

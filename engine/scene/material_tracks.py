"""Where points go by the Gaussians that make the surface there: the motion of the scene itself, whatever its recording shows."""

from __future__ import annotations

import numpy as np
import torch
from torch.nn import functional

from degense.engine.progress import Steps
from degense.engine.scene.material import materials_at
from degense.engine.scene.scene import Scene

LEFT = 0.5  # share of its opacity below which what a point was followed by is gone: an instrument's Gaussians last for some frames


def following_material(scene: Scene, queries: np.ndarray) -> Steps[np.ndarray]:
    """Follow points forwards and backwards through the whole clip: positions float64 [K, T, 3], world, clip units; NaN for a point that
    nothing is reconstructed at.

    A point moves by the weighted mean of the displacements of its Gaussians (`materials_at`), from the frame where they were chosen on: it
    does not drift. They are chosen anew, where it is then, once they have lost half of their opacity.

    Parameters
    ----------
    queries : float [K, 3]
        Frame, x and y of each point, pixels.
    """
    starts = queries[:, 0].round().astype(int)
    positions = np.full((len(queries), scene.frames, 3), np.nan)
    moves = [(1, range(scene.frames)), (-1, range(scene.frames - 1, -1, -1))]
    for number, (step, frames) in enumerate(moves):
        followed = _Followed(scene, len(queries))
        for done, frame in enumerate(frames):
            yield (number + done / scene.frames) / 2, "following points"
            followed.advance(frame, frame - step)
            begun = np.flatnonzero(starts == frame)
            followed.begin(begun, frame, queries[begun, 1:])
            active = starts * step <= frame * step
            positions[active, frame] = followed.places[active]
    return positions


class _Followed:
    """Points on their way in one direction of time; `places` float64 [K, 3] says where they are."""

    def __init__(self, scene: Scene, count: int):
        self._scene = scene
        self.places = np.full((count, 3), np.nan)
        self._anchors, self._frames = self.places.copy(), np.zeros(count, int)  # where and when their Gaussians were chosen
        device = scene.splats(0).means.device
        self._rows = torch.zeros((count, 1), dtype=torch.int64, device=device)
        self._weights = torch.zeros((count, 1), dtype=torch.float64, device=device)

    def begin(self, points: np.ndarray, frame: int, pixels: np.ndarray) -> None:
        """Choose the Gaussians of points at pixels of a frame; points at which nothing is reconstructed have no place."""
        if not len(points):
            return
        rows, weights, depth = materials_at(self._scene, frame, pixels)
        known = weights.sum(1) > 0
        places = self._scene.camera(frame).unproject(pixels, depth)
        self._choose(points[known], frame, places[known], rows[known], weights[known])

    def advance(self, frame: int, before: int) -> None:
        """Move all points to a frame, from the one before."""
        active = np.flatnonzero(np.isfinite(self.places[:, 0]))
        for chosen in np.unique(self._frames[active]).tolist():
            points = active[self._frames[active] == chosen]
            moves, left = self._since(points, chosen, frame)
            gone = points[left < LEFT]
            if len(gone) and chosen != before:
                pixels, _ = self._scene.camera(before).project(self.places[gone])
                found, shares, _ = materials_at(self._scene, before, pixels)
                known = shares.sum(1) > 0
                self._choose(gone[known], before, self.places[gone[known]], found[known], shares[known])
                self.places[gone[known]] += self._since(gone[known], before, frame)[0]
            kept = self._frames[points] == chosen
            self.places[points[kept]] = self._anchors[points[kept]] + moves[kept]

    def _choose(self, points: np.ndarray, frame: int, places: np.ndarray, rows: np.ndarray, weights: np.ndarray) -> None:
        if (more := rows.shape[1] - self._rows.shape[1]) > 0:
            self._rows, self._weights = functional.pad(self._rows, (0, more)), functional.pad(self._weights, (0, more))
        self._frames[points], self._anchors[points], self.places[points] = frame, places, places
        index = torch.as_tensor(points, device=self._rows.device)
        self._rows[index], self._weights[index] = torch.as_tensor(rows).to(self._rows), torch.as_tensor(weights).to(self._weights)

    @torch.no_grad()
    def _since(self, points: np.ndarray, chosen: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """How far the Gaussians of points, chosen in one frame, moved until another, float64 [n, 3], and the share [n] of their opacity
        that is left."""
        here, there = self._scene.splats(chosen), self._scene.splats(frame)
        changes = torch.cat([there.means - here.means, (there.opacities / here.opacities.clamp_min(1e-6))[:, None]], 1)
        index = torch.as_tensor(points, device=changes.device) if len(points) < len(self.places) else slice(None)
        rows, weights = self._rows[index], self._weights[index]
        of_each = changes.index_select(0, rows.reshape(-1)).reshape(*rows.shape, 4).double()
        changed = (weights[:, None] @ of_each)[:, 0].cpu().numpy()
        return changed[:, :3], changed[:, 3]

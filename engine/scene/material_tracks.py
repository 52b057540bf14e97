"""Where points go by the Gaussians that make the surface there: the motion of the scene itself, whatever its recording shows."""

from __future__ import annotations

import numpy as np

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
        self._rows, self._weights = np.zeros((count, 1), int), np.zeros((count, 1))

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
        for chosen in np.unique(self._frames[active]):
            points = active[self._frames[active] == chosen]
            here, there = self._scene.splats(int(chosen)), self._scene.splats(frame)
            rows, weights = self._rows[points], self._weights[points]
            left = (weights * (there.opacities / here.opacities.clamp_min(1e-6)).cpu().numpy()[rows]).sum(1)
            gone = points[left < LEFT]
            if len(gone) and chosen != before:
                pixels, _ = self._scene.camera(before).project(self.places[gone])
                found, shares, _ = materials_at(self._scene, before, pixels)
                known = shares.sum(1) > 0
                self._choose(gone[known], before, self.places[gone[known]], found[known], shares[known])
                self._move(gone[known], before, frame)
            self._move(points[self._frames[points] == chosen], int(chosen), frame)

    def _choose(self, points: np.ndarray, frame: int, places: np.ndarray, rows: np.ndarray, weights: np.ndarray) -> None:
        if self._rows.shape[1] < rows.shape[1]:
            wider = ((0, 0), (0, rows.shape[1] - self._rows.shape[1]))
            self._rows, self._weights = np.pad(self._rows, wider), np.pad(self._weights, wider)
        self._frames[points], self._anchors[points], self.places[points] = frame, places, places
        self._rows[points], self._weights[points] = rows, weights

    def _move(self, points: np.ndarray, chosen: int, frame: int) -> None:
        moved = (self._scene.splats(frame).means - self._scene.splats(chosen).means).cpu().numpy()
        moves = (self._weights[points][:, None] @ moved[self._rows[points]].astype(np.float64))[:, 0]
        self.places[points] = self._anchors[points] + moves

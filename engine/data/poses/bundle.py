"""Bundle adjustment: all cameras of a clip at once, from the rigid motion of most of the tracked tissue.

For a point X of key frame a (from its pixel and depth, in a's camera), camera b sees π(R_b R_aᵀ (X − t_a) + t_b). The poses minimise

    Σ ρ(‖π(…) − seen‖) + λ² Σ ‖second differences of the poses‖²

by Gauss–Newton with iterated weights. ρ is the robust loss of Geman and McClure, and the weight of a point is multiplied by its mean weight
over all frames, so that points that deform count little. λ is far below the weight of one point: it decides only where a frame has none.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera
from degense.engine.data.poses.tracks import Track

LOOSE, TIGHT = 16.0, 0.7  # pixels: scale of ρ at the start and at the end
SHRINK = 0.75  # of the scale, a step
EXTRA = 8  # steps at the final scale
SMOOTH = 0.1  # λ, pixels
DAMPING = 1e-6  # squared pixels: keeps the system regular where weights vanish


def refine(viewmats: np.ndarray, tracks: list[Track], camera: Camera, loose: float = LOOSE) -> np.ndarray:
    """Poses that fit all tracks; the first frame stays where it is.

    Parameters
    ----------
    viewmats : float64 [T, 4, 4]
        World to camera; where to begin.
    tracks : list of Track
        Depths in units in which a typical one is 1.
    camera : Camera
        Intrinsics of all frames.
    loose : float
        Scale of ρ to begin with, pixels.

    Returns
    -------
    float64 [T, 4, 4]
    """
    viewmats = viewmats.copy()
    scales = [loose]
    while scales[-1] > TIGHT:
        scales.append(max(TIGHT, scales[-1] * SHRINK))
    rays = [_unproject(track, camera) for track in tracks]
    for scale in scales + [TIGHT] * EXTRA:
        parts = [_residuals(viewmats, track, ray, camera) for track, ray in zip(tracks, rays, strict=True)]
        weights = _weights(tracks, [part[0] for part in parts], scale)
        system = _System(len(viewmats))
        for track, (residual, by_key, by_frame), weight in zip(tracks, parts, weights, strict=True):
            system.add(track.key, track.frame, residual, by_key, by_frame, weight)
        system.smooth(viewmats, SMOOTH * camera.fx)
        viewmats = _moved(viewmats, system.solve(DAMPING * camera.fx**2))
    return viewmats


def projected(viewmats: np.ndarray, track: Track, camera: Camera) -> np.ndarray:
    """Where the poses say that a track's points are seen, float64 [n, 2]."""
    return track.seen + _residuals(viewmats, track, _unproject(track, camera), camera)[0]


def _unproject(track: Track, camera: Camera) -> np.ndarray:
    x = (track.pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    return np.concatenate([x, np.ones((len(x), 1))], 1) * track.depth[:, None]


def _residuals(viewmats: np.ndarray, track: Track, points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Predicted minus seen [n, 2], and its derivatives [n, 2, 6] by (rotation, translation) of the key frame and of the other.

    A rotation changes as exp([δ]×) R.
    """
    (ra, ta), (rb, tb) = ((viewmats[i, :3, :3], viewmats[i, :3, 3]) for i in (track.key, track.frame))
    relative, local = rb @ ra.T, points - ta
    turned = local @ relative.T
    y = turned + tb
    z = np.maximum(y[:, 2], 1e-3)
    predicted = y[:, :2] / z[:, None] * (camera.fx, camera.fy) + (camera.cx, camera.cy)
    lens = np.zeros((len(y), 2, 3))
    lens[:, 0, 0], lens[:, 1, 1] = camera.fx / z, camera.fy / z
    lens[:, 0, 2], lens[:, 1, 2] = -camera.fx * y[:, 0] / z**2, -camera.fy * y[:, 1] / z**2
    by_key = np.concatenate([lens @ (relative @ _cross(local)), -(lens @ relative)], 2)
    by_frame = np.concatenate([-(lens @ _cross(turned)), lens], 2)
    return predicted - track.seen, by_key, by_frame


def _weights(tracks: list[Track], residuals: list[np.ndarray], scale: float) -> list[np.ndarray]:
    """Weight of every point in every track: how well it fits there × how well it fits on average, in the tracks of its key frame."""
    fits = [(scale**2 / (scale**2 + (r**2).sum(1))) ** 2 for r in residuals]
    size = max(int(track.index.max(initial=0)) for track in tracks) + 1
    sums: dict[int, np.ndarray] = {track.key: np.zeros(size) for track in tracks}
    counts: dict[int, np.ndarray] = {track.key: np.zeros(size) for track in tracks}
    for track, fit in zip(tracks, fits, strict=True):  # a track has each of its key frame's points once
        sums[track.key][track.index] += fit
        counts[track.key][track.index] += 1
    return [fit * (sums[t.key] / np.maximum(counts[t.key], 1))[t.index] for t, fit in zip(tracks, fits, strict=True)]


class _System:
    """Normal equations of all poses, 6 unknowns each: rotation, translation."""

    def __init__(self, count: int):
        self.count = count
        self.gradient = np.zeros((count, 6))
        self.blocks: list[tuple[int, int, np.ndarray]] = []

    def add(self, a: int, b: int, residual: np.ndarray, by_a: np.ndarray, by_b: np.ndarray, weight: np.ndarray) -> None:
        rows = np.sqrt(weight)[:, None, None]
        left, right = (rows * by_a).reshape(-1, 6), (rows * by_b).reshape(-1, 6)
        error = (np.sqrt(weight)[:, None] * residual).reshape(-1)
        self.gradient[a] += left.T @ error
        self.gradient[b] += right.T @ error
        cross = left.T @ right
        self.blocks += [(a, a, left.T @ left), (b, b, right.T @ right), (a, b, cross), (b, a, cross.T)]

    def smooth(self, viewmats: np.ndarray, weight: float) -> None:
        """Penalise second differences of rotation and translation; lengths are near 1, so both weigh alike."""
        rotations = Rotation.from_matrix(viewmats[:, :3, :3])
        square = weight**2 * np.eye(6)
        for i in range(1, self.count - 1):
            bend = np.concatenate(
                [
                    (rotations[i - 1] * rotations[i].inv()).as_rotvec() + (rotations[i + 1] * rotations[i].inv()).as_rotvec(),
                    viewmats[i - 1, :3, 3] - 2 * viewmats[i, :3, 3] + viewmats[i + 1, :3, 3],
                ]
            )
            around = ((i - 1, 1.0), (i, -2.0), (i + 1, 1.0))
            for j, factor in around:
                self.gradient[j] += factor * weight**2 * bend
                self.blocks += [(j, k, factor * other * square) for k, other in around]

    def solve(self, damping: float) -> np.ndarray:
        """The step [count, 6]; 0 for the first pose."""
        grid = np.arange(6)
        rows = np.concatenate([np.repeat(6 * i + grid, 6) for i, _, _ in self.blocks])
        columns = np.concatenate([np.tile(6 * j + grid, 6) for _, j, _ in self.blocks])
        values = np.concatenate([block.ravel() for _, _, block in self.blocks])
        matrix = coo_array((values, (rows, columns)), shape=(6 * self.count,) * 2).tocsc()
        matrix += damping * eye_array(6 * self.count, format="csc")
        step = np.zeros((self.count, 6))
        step[1:] = spsolve(matrix[6:, 6:], -self.gradient[1:].ravel()).reshape(-1, 6)
        return step


def _moved(viewmats: np.ndarray, step: np.ndarray) -> np.ndarray:
    moved = viewmats.copy()
    moved[:, :3, :3] = (Rotation.from_rotvec(step[:, :3]) * Rotation.from_matrix(viewmats[:, :3, :3])).as_matrix()
    moved[:, :3, 3] += step[:, 3:]
    return moved


def _cross(vectors: np.ndarray) -> np.ndarray:
    """[v]×, [n, 3, 3]."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], 1).reshape(-1, 3, 3)

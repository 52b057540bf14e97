"""Bundle adjustment: all cameras of a clip at once, from the rigid motion of most of the tracked tissue.

For a point X of key frame a (from its pixel and depth, in a's camera), camera b sees π(R_b R_aᵀ (X − t_a) + t_b). The poses minimise

    Σ ρ(‖π(…) − seen‖) + λ² Σ ‖second differences of the poses‖²

by Gauss–Newton with iterated weights. ρ is the robust loss of Geman and McClure, and the weight of a point is multiplied by its mean weight
over all frames, so that points that deform count little. λ is far below the weight of one point: it decides only where a frame has none.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array, kron
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from degense.engine.camera import Camera
from degense.engine.data.poses.tracks import Track

LOOSE, TIGHT = 16.0, 0.7  # pixels: scale of ρ at the start and at the end
SHRINK = 0.75  # of the scale, a step
EXTRA = 8  # steps at the final scale
SMOOTH = 0.1  # λ, pixels
DAMPING = 1e-6  # squared pixels: keeps the system regular where weights vanish


def refine(viewmats: np.ndarray, tracks: list[Track], camera: Camera) -> np.ndarray:
    """Poses that fit all tracks, world to camera, float64 [T, 4, 4]; the first frame stays where it is.

    `viewmats` are where to begin, `camera` has the intrinsics of all frames. Depths of tracks are in units in which a typical one is 1.
    """
    viewmats = viewmats.copy()
    scales = [LOOSE]
    while scales[-1] > TIGHT:
        scales.append(max(TIGHT, scales[-1] * SHRINK))
    rays = [_unproject(track, camera) for track in tracks]
    for scale in scales + [TIGHT] * EXTRA:
        parts = [_residuals(viewmats, track, ray, camera) for track, ray in zip(tracks, rays, strict=True)]
        weights = _weights(tracks, [part[0] for part in parts], scale)
        matrix, gradient = _normal_equations(len(viewmats), tracks, parts, weights)
        if len(viewmats) > 2:
            bends, bend = _bends(viewmats)
            matrix += (SMOOTH * camera.fx) ** 2 * bends.T @ bends
            gradient += (SMOOTH * camera.fx) ** 2 * bends.T @ bend
        matrix += DAMPING * camera.fx**2 * eye_array(matrix.shape[0], format="csc")
        viewmats = _moved(viewmats, np.vstack([np.zeros(6), spsolve(matrix[6:, 6:], -gradient[6:]).reshape(-1, 6)]))
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


def _normal_equations(
    count: int, tracks: list[Track], parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]], weights: list[np.ndarray]
) -> tuple[csc_array, np.ndarray]:
    """JᵀJ [6 T, 6 T] and Jᵀr [6 T] of the weighted residuals of all tracks; 6 unknowns a pose: rotation, translation."""
    gradient = np.zeros((count, 6))
    blocks, rows, columns = [], [], []
    for track, (residual, by_key, by_frame), weight in zip(tracks, parts, weights, strict=True):
        root = np.sqrt(weight)[:, None]
        jacobian = (root[..., None] * np.concatenate([by_key, by_frame], 2)).reshape(-1, 12)
        gradient[[track.key, track.frame]] += (jacobian.T @ (root * residual).ravel()).reshape(2, 6)
        unknowns = (6 * np.array([[track.key], [track.frame]]) + np.arange(6)).ravel()
        blocks.append((jacobian.T @ jacobian).ravel())
        rows.append(unknowns.repeat(12))
        columns.append(np.tile(unknowns, 12))
    places = np.concatenate(rows), np.concatenate(columns)
    return coo_array((np.concatenate(blocks), places), shape=(6 * count,) * 2).tocsc(), gradient.ravel()


def _bends(viewmats: np.ndarray) -> tuple[csc_array, np.ndarray]:
    """Second differences of the poses [6 (T − 2)], and their derivatives; lengths are near 1, so rotations and translations weigh alike."""
    count, rotations = len(viewmats), Rotation.from_matrix(viewmats[:, :3, :3])
    before, here, after = rotations[:-2], rotations[1:-1].inv(), rotations[2:]
    turns = (before * here).as_rotvec() + (after * here).as_rotvec()
    second = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count))
    return kron(second, eye_array(6), format="csc"), np.concatenate([turns, np.diff(viewmats[:, :3, 3], 2, axis=0)], 1).ravel()


def _moved(viewmats: np.ndarray, step: np.ndarray) -> np.ndarray:
    moved = viewmats.copy()
    moved[:, :3, :3] = (Rotation.from_rotvec(step[:, :3]) * Rotation.from_matrix(viewmats[:, :3, :3])).as_matrix()
    moved[:, :3, 3] += step[:, 3:]
    return moved


def _cross(vectors: np.ndarray) -> np.ndarray:
    """[v]×, [n, 3, 3]."""
    return np.cross(np.eye(3), vectors[:, None])

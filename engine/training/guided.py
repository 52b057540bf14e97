"""What a coarse teacher means in the picture's own regions: its patches' vectors, shared out by place and colour."""

from __future__ import annotations

import cv2
import numpy as np

COLOUR = 6.0  # CIELAB units: how alike the colours of a patch and a region must be for the patch to speak for it


def refined_by_regions(vectors: np.ndarray, index: np.ndarray, image: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """A vector for each superpixel of a frame from vectors that describe patches (joint bilateral upsampling, Kopf et al. 2007).

    v_r ∝ Σ_p n_p exp(−‖x_r − x_p‖² / 2σ² − ‖c_r − c_p‖² / 2τ²) v_p over patches p with n_p pixels, centre x_p and mean colour c_p; σ is the side
    of a patch, τ is `COLOUR`. A patch that lies half on an instrument has a mixed colour and speaks for neither side; those
    of like colour around it do. Errors of single patches average out.

    Parameters
    ----------
    vectors : float32 [k, D]
    index : int [H, W]
        Patch of each pixel; −1 where the teacher says nothing.
    image : uint8 [H, W, 3]
    regions : int [H, W]
        0 … K − 1.

    Returns
    -------
    float32 [K, D], unit rows; rows of zeros for regions too far from any patch that says something
    """
    height, width = index.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    spoken = index >= 0
    patch, size = _means(index[spoken], np.stack([x, y], -1)[spoken], lab[spoken], len(vectors))
    region, _ = _means(regions.ravel(), np.stack([x, y], -1).reshape(-1, 2), lab.reshape(-1, 3), int(regions.max()) + 1)
    used = size > 0
    side = np.sqrt(np.count_nonzero(spoken) / max(np.count_nonzero(used), 1))
    scale = np.array([side, side, COLOUR, COLOUR, COLOUR], np.float32)
    a, b = region / scale, patch[used] / scale
    square = (a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2 * a @ b.T
    mixed = (np.exp(-0.5 * np.maximum(square, 0)) * size[used]) @ vectors[used]
    length = np.linalg.norm(mixed, axis=1, keepdims=True)
    return np.where(length > 1e-6, mixed / np.maximum(length, 1e-6), 0).astype(np.float32)


def _means(owner: np.ndarray, place: np.ndarray, colour: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean place and colour, float32 [count, 5], and number of pixels, float32 [count], of each owner."""
    size = np.bincount(owner, minlength=count).astype(np.float32)
    values = np.concatenate([place, colour], -1)
    sums = np.stack([np.bincount(owner, values[:, i], count) for i in range(5)], -1)
    return (sums / np.maximum(size, 1)[:, None]).astype(np.float32), size

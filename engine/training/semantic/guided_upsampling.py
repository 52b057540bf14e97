"""Guided upsampling of a coarse teacher's vectors: from its patches to the superpixels of the frame, by place and colour."""

from __future__ import annotations

import cv2
import numpy as np

BLUR = 0.7  # patch sides: how far around itself a patch sees
RADIUS = 1.0  # patch sides: σ of the weight of patches around a region
RIDGE = 0.7  # CIELAB units²: variance of colour below which colour does not explain vectors


def upsample_to_regions(vectors: np.ndarray, index: np.ndarray, image: np.ndarray, regions: np.ndarray) -> np.ndarray:
    """A vector for each superpixel of a frame from vectors that describe patches.

    Around each region r the patches' vectors are explained by their mean colours, and the line is read at the region's own colour:

        v_r ∝ v̄ + (c_r − c̄)ᵀ (Σ_cc + λI)⁻¹ Σ_cv        weights n_p exp(−‖x_r − x_p‖² / 2σ²)

    with n_p pixels, centre x_p and mean colour c_p of patch p, and weighted means, covariances and σ around r (the idea of guided
    filtering, He et al. 2013). Where a patch sees a third of an instrument, its vector and its colour are both mixed by a third; the line
    leads on to what is purely of the instrument's colour. Errors of single patches average out.

    Parameters
    ----------
    vectors : float32 [k, D]
    index : int [H, W]
        Patch of each pixel; −1 where it has no label.
    image : uint8 [H, W, 3]
    regions : int [H, W]
        0 … K − 1.

    Returns
    -------
    float32 [K, D], unit rows; rows of zeros for regions too far from any labelled patch
    """
    height, width = index.shape
    place = np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)), -1)
    lab = cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    labelled = index >= 0
    size = np.bincount(index[labelled], minlength=len(vectors))
    side = patch_side(index, size)
    seen = np.concatenate([place, cv2.GaussianBlur(lab, (0, 0), BLUR * side)], -1)
    used = size > 0
    patch = means_of(index[labelled], seen[labelled], len(vectors))[used]
    region = means_of(regions.ravel(), np.concatenate([place, lab], -1).reshape(-1, 5), int(regions.max()) + 1)
    a, b = region[:, :2] / (RADIUS * side), patch[:, :2] / (RADIUS * side)
    weight = np.exp(-0.5 * np.maximum((a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2 * a @ b.T, 0)) * size[used]
    total = weight.sum(1, keepdims=True)
    weight = weight / np.maximum(total, 1e-9)
    colour, vector = patch[:, 2:], vectors[used].astype(np.float64)
    colour_mean, vector_mean = weight @ colour, weight @ vector
    pairs = np.concatenate([colour[:, :, None] * colour[:, None], colour[:, :, None] * vector[:, None]], 2)
    moments = (weight @ pairs.reshape(len(colour), -1)).reshape(len(weight), 3, -1)
    moments -= colour_mean[:, :, None] * np.concatenate([colour_mean, vector_mean], 1)[:, None]
    slope = np.linalg.solve(moments[..., :3] + RIDGE * np.eye(3), moments[..., 3:])
    mixed = vector_mean + np.einsum("ri,rid->rd", region[:, 2:] - colour_mean, slope)
    length = np.linalg.norm(mixed, axis=1, keepdims=True)
    return np.where((total > 1e-6) & (length > 1e-6), mixed / np.maximum(length, 1e-6), 0).astype(np.float32)


def patch_side(index: np.ndarray, size: np.ndarray) -> float:
    """Side of a square with the mean area of the labelled patches, pixels.

    `index` [H, W] is the patch of each pixel, −1 where it has no label; `size` [k] are pixels of each patch.
    """
    return float(np.sqrt(np.count_nonzero(index >= 0) / max(int(np.count_nonzero(size)), 1)))


def means_of(owner: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Mean of the values [P, c] of each owner, float64 [count, c]; 0 for those that own none."""
    size = np.bincount(owner, minlength=count)
    return np.stack([np.bincount(owner, column, count) for column in values.T], -1) / np.maximum(size, 1)[:, None]

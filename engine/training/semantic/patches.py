"""What the patches of a coarse teacher see of a drawn frame: the mean over each patch and a little of those around it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from scipy.spatial import cKDTree
from torch import Tensor

from degense.engine.training.losses import rows_of

BLUR = 0.7  # patch sides: how far around itself a patch sees
AROUND = 25  # nearest patches that it may see, itself included


class Patches(NamedTuple):
    """The patches of one frame, k of them."""

    owner: Tensor  # int32 [H × W]; patch of each pixel, k where it has no label
    size: Tensor  # float [k]; pixels of each
    near: Tensor  # int64 [k, n]; which patches each one sees
    share: Tensor  # float [k, n]; how much of each, rows sum to 1

    @classmethod
    def of(cls, index: np.ndarray, count: int, device: torch.device) -> Patches:
        """From the patch of each pixel, int [H, W], −1 where it has no label."""
        labelled = index >= 0
        owner = index[labelled]
        size = np.bincount(owner, minlength=count)
        place = means_of(owner, np.argwhere(labelled), count)
        near = cKDTree(place).query(place, np.arange(min(AROUND, count)) + 1)[1]
        far = np.square(place[near] - place[:, None]).sum(-1) / patch_side(index, size) ** 2
        share = np.exp(-far / (2 * BLUR**2)) * size[near]
        share /= np.maximum(share.sum(1, keepdims=True), 1e-12)
        arrays = np.where(labelled, index, count).ravel().astype(np.int32), size.astype(np.float32), near, share.astype(np.float32)
        return cls(*(torch.from_numpy(a).to(device) for a in arrays))

    def see(self, flat: Tensor) -> Tensor:
        """What each patch sees of a frame [H × W, d]: float [k, d]."""
        count = len(self.size)
        total = flat.new_zeros(count + 1, flat.shape[1]).index_add(0, self.owner, flat)[:count]
        mean = total / self.size.clamp_min(1)[:, None]
        return (rows_of(mean, self.near) * self.share[:, :, None]).sum(1)


class PatchTarget(NamedTuple):
    """A coarse teacher's supervision of one frame, patch by patch."""

    patches: Patches
    latents: Tensor  # float [k, d]; its vectors, projected to the basis
    weight: Tensor  # float [k]; as a target's, summed over the pixels of a patch; sum 1


def patch_side(index: np.ndarray, size: np.ndarray) -> float:
    """Side of a square with the mean area of the labelled patches, pixels.

    `index` [H, W] is the patch of each pixel, −1 where it has no label; `size` [k] are pixels of each patch.
    """
    return float(np.sqrt(np.count_nonzero(index >= 0) / max(int(np.count_nonzero(size)), 1)))


def means_of(owner: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Mean of the values [P, c] of each owner, float64 [count, c]; 0 for those that own none."""
    size = np.bincount(owner, minlength=count)
    return np.stack([np.bincount(owner, column, count) for column in values.T], -1) / np.maximum(size, 1)[:, None]

"""What regions of like colour around a place are called, over all frames and along the scene's own motion.

A teacher errs in whole regions and beside the true boundaries; a vote in one place contains both for as long as they last. What lies near
by in the scene and has the same colour is mostly the same thing, and was mostly called right in some frame.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import pad

from degense.engine.latest import Latest
from degense.engine.semantics.masks.superpixels import REGION_SIZE, superpixels
from degense.engine.training.fused.region_votes_cpu import region_votes
from degense.engine.training.semantic.finished import FinishedGeometry

MOST_REGIONS = 600  # of a frame
COLOR_SCALE = 5.0  # CIELAB units: difference of colours at which a region counts e^(−½)
ROWS = 128  # regions asked at once
KEPT = 128  # frames whose regions are kept


class FrameRegions(NamedTuple):
    """Superpixels of one frame, K of them."""

    of_pixel: Tensor  # int64 [P]
    size: Tensor  # float [K], pixels
    traits: Tensor  # float [K, 6]; place among the canonical Gaussians in widths of the picture, CIELAB in units of `COLOR_SCALE`


class Regions:
    """Superpixels of a clip's frames, each at the place of the canonical Gaussians that it shows: what moves keeps its place."""

    def __init__(self, geometry: FinishedGeometry):
        self._geometry, self._frames = geometry, geometry.frames
        frames = geometry.frames
        width, height = frames.size
        self._side = max(REGION_SIZE, round(math.sqrt(width * height / MOST_REGIONS)))
        self._width = width / frames.cameras[0].fx  # of the picture, at the median depth
        self._made = Latest(KEPT)
        self._traits: list[Tensor] = []
        self._sums: list[Tensor] = []
        self._read: dict[tuple[int, float], Tensor] = {}  # of a frame's regions, float [K, words]

    def clear(self) -> None:
        """Forget what was called what."""
        self._traits, self._sums = [], []
        self._read.clear()

    def sums(self, frame: int, shares: Float[Tensor, "pixels words"]) -> Float[Tensor, "regions words"]:
        """The shares of a frame's pixels, summed in its regions; rows of zeros say nothing."""
        regions = self.of(frame)
        return shares.new_zeros(len(regions.size), shares.shape[1]).index_add_(0, regions.of_pixel, shares)

    def add(self, frame: int, sums: Float[Tensor, "regions words"]) -> None:
        """Let the regions of a frame vote with their `sums`, so by size."""
        self._read.clear()
        self._traits.append(self.of(frame).traits)
        self._sums.append(sums)

    def read(self, frame: int, reach: float) -> Float[Tensor, "pixels words"]:
        """The shares of the votes around each pixel's region, rows of sum 1:  Σ_s exp(−‖traits − traits_s‖² / 2) Σ_p∈s shares_p, with
        places divided by `reach`, the distance in widths of the picture at which a region counts e^(−½)."""
        if (frame, reach) not in self._read:
            self._read[frame, reach] = self._shares(frame, reach)
        return self._read[frame, reach].index_select(0, self.of(frame).of_pixel)

    def _shares(self, frame: int, reach: float) -> Float[Tensor, "regions words"]:
        sums = torch.cat(self._sums)
        scale = sums.new_tensor([1 / reach] * 3 + [1.0] * 3)
        traits, asked = torch.cat(self._traits) * scale, self.of(frame).traits * scale
        if sums.is_cuda:
            votes = torch.cat([torch.exp(torch.cdist(rows, traits).square() / -2) @ sums for rows in asked.split(ROWS)])
        else:
            votes = region_votes(asked, traits, sums)
        return votes / votes.sum(1, keepdim=True).clamp_min(1e-12)

    def of(self, frame: int) -> FrameRegions:
        """The regions of a frame."""
        return self._made.get(frame, lambda: self._found(frame))

    @torch.no_grad()
    def _found(self, frame: int) -> FrameRegions:
        image, device = self._frames.image(frame), self._frames.device
        of_pixel = torch.from_numpy(superpixels(image, self._side).ravel().astype(np.int64)).to(device)
        colors = torch.from_numpy(cv2.cvtColor(image.astype(np.float32) / 255, cv2.COLOR_RGB2LAB).reshape(-1, 3)).to(device)
        means = self._geometry.model.canonical["means"].detach()
        drawn = self._geometry.placed(frame).draw(pad(means, (0, 1), value=1.0)).reshape(-1, 4)  # beside the means, how much they cover
        places = drawn[:, :3] / drawn[:, 3:].clamp_min(1e-3)
        size = torch.bincount(of_pixel).to(colors)
        traits = torch.cat([places / self._width, colors / COLOR_SCALE], 1)
        return FrameRegions(of_pixel, size, _means(of_pixel, traits, size))


def _means(of_pixel: Int[Tensor, " pixels"], values: Float[Tensor, "pixels n"], size: Float[Tensor, " regions"]) -> Tensor:
    """Mean of the values of each region, [regions, n]."""
    return values.new_zeros(len(size), values.shape[1]).index_add_(0, of_pixel, values) / size.clamp_min(1)[:, None]

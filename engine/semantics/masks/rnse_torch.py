"""Region aggregation as tensor operations, for frames that were drawn on a GPU. The formulas are in `engine.semantics.masks.rnse`.

Nothing here waits for the device: work is queued, and only reading a map does. About 300 kernels find a frame's statistics, 60 refine
any number of prompts.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from degense.engine.semantics.masks import rnse
from degense.engine.semantics.masks.guided_filter import SIZE
from degense.engine.semantics.masks.similarity import SHORTEST
from degense.engine.semantics.masks.superpixels import dense
from degense.engine.semantics.masks.superpixels_torch import superpixels_on_device


class TorchAggregation(rnse.Aggregation[Tensor]):
    """See `Aggregation`: of rgb uint8 [H, W, 3] (None without regions), latent float32 [H, W, d], alpha float32 [H, W]; on one device."""

    def __init__(self, rgb: Tensor | None, latent: Tensor, alpha: Tensor | None = None):
        super().__init__(rgb)
        self.unit = _normalised(latent.float(), alpha)

    @property
    def regions(self) -> np.ndarray:
        labels, count = self._labels
        return dense(labels.cpu().numpy().astype(np.int32), count)

    @cached_property
    def _labels(self) -> tuple[Tensor, int]:
        return superpixels_on_device(self._rgb)

    @cached_property
    def statistics(self) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Regions int64 [H, W], M_k float32 [K, d], w and λ' float32 [H, W]."""
        labels, count = self._labels
        return labels, *frame_statistics(self.unit, labels, count)

    @cached_property
    def _guide(self) -> tuple[Tensor, Tensor, Tensor]:
        """Colours in [0, 1] [3, H, W], their window means [3, H, W], and (Σ + ε)⁻¹ [3, 3, H, W]."""
        guide = self._rgb.permute(2, 0, 1).float() / 255
        mean = _box(guide, SIZE)
        covariance = _box((guide[:, None] * guide).flatten(0, 1), SIZE).unflatten(0, (3, 3)) - mean[:, None] * mean
        return guide, mean, _inverse(covariance)

    def similarity(self, vectors: np.ndarray) -> Tensor:
        return _project(self._planes, self._rows(vectors))

    @cached_property
    def _planes(self) -> Tensor:
        return self.unit.permute(2, 0, 1).contiguous()

    def refined(self, vectors: np.ndarray) -> Tensor:
        labels, means, regional_weight, noisiness = self.statistics
        rows = self._rows(vectors)
        pixel, regional = _project(self._planes, rows), _project(means.T.contiguous(), rows)[:, labels]
        coarse = pixel + regional_weight * (regional - pixel)
        guided, explained = self._filter(coarse)
        weight = torch.maximum(noisiness, _ramp(explained, rnse.EXPLAINED)).clamp_min(rnse.LEAST_GUIDED)
        return coarse + weight * (guided - coarse)

    @cached_property
    def _plain_means(self) -> Tensor:
        """Means of unit latents over regions, float32 [K, d]."""
        labels, count = self._labels
        return plain_means(_normalised(self.unit, None).flatten(0, 1), labels.flatten(), count)

    def means(self, vectors: np.ndarray) -> Tensor:
        regional = _project(self._plain_means.T.contiguous(), self._rows(vectors))
        return self._filter(regional[:, self._labels[0]])[0]

    def largest(self, maps: Sequence[Tensor]) -> Tensor:
        return maps[0] if len(maps) == 1 else torch.stack(list(maps)).amax(0)

    def numpy(self, maps: Sequence[Tensor]) -> list[np.ndarray]:
        array = torch.stack(list(maps)).cpu().numpy()
        array.flags.writeable = False
        return list(array)

    def _rows(self, vectors: np.ndarray) -> Tensor:
        # without waiting: CUDA has taken a copy of a small array by the time this returns
        return torch.from_numpy(np.ascontiguousarray(vectors, np.float32)).to(self.unit.device, non_blocking=True)

    def _filter(self, maps: Tensor) -> tuple[Tensor, Tensor]:
        """G and mean R² of maps [n, H, W], as `engine.semantics.masks.guided_filter`."""
        guide, mean, inverse = self._guide
        moments = _box(torch.cat([maps[:, None] * guide, maps[:, None], maps[:, None] ** 2], 1), SIZE)  # [n, 5, H, W]
        level = moments[:, 3:4]
        covariance = moments[:, :3] - mean * level
        slope = (inverse * covariance[:, None]).sum(2)
        variance = (moments[:, 4:] - level**2).clamp_min(rnse.LEVEL)
        explained = ((slope * covariance).sum(1, keepdim=True) / variance).clamp(0, 1)
        offset = level - (slope * mean).sum(1, keepdim=True)
        fit = _box(torch.cat([slope, offset, explained], 1), SIZE)
        return (fit[:, :3] * guide).sum(1) + fit[:, 3], fit[:, 4]


def _project(planes: Tensor, rows: Tensor) -> Tensor:
    """Σ_c q_c z_c, [n, ...], of planes [d, ...] and rows [n, d], one channel after the other.

    Each row's map is the same to the last bit whatever other rows there are, which no matrix product of a library guarantees.
    """
    weights = rows.view(*rows.shape, *[1] * (planes.ndim - 1))
    out = weights[:, 0] * planes[0]
    for c in range(1, len(planes)):
        out.addcmul_(weights[:, c], planes[c])
    return out


def frame_statistics(unit: Tensor, labels: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """M_k float32 [K, d], w and λ' float32 [H, W], of normalised latents [H, W, d] in regions int64 [H, W], 0 … K − 1."""
    flat, owner = unit.flatten(0, 1), labels.flatten()
    means = _means(flat, owner, plain_means(flat, owner, count))
    rough = torch.log(_second_difference(unit) + rnse.QUIET).flatten()
    # in float64, as in `_means`: what a region's noise is must not depend on the order in which threads add
    sums = torch.zeros(count, 2, dtype=torch.float64, device=unit.device)
    sums.index_add_(0, owner, torch.stack([rough, torch.ones_like(rough)], 1).double())
    noise = torch.exp((sums[:, 0] / sums[:, 1].clamp_min(1)).float())
    noisiness = _box(_ramp(noise, rnse.NOISE)[labels][None], rnse.NOISE_WINDOW)[0]
    local = _box(unit.permute(2, 0, 1), 3).permute(1, 2, 0)
    direction = unit + noisiness[..., None] * (local - unit)
    region = means[labels]
    length = torch.linalg.vector_norm(direction, dim=2)
    both = length * torch.linalg.vector_norm(region, dim=2)
    agreement = _ramp(torch.where(both > 1e-12, (direction * region).sum(2) / both.clamp_min(1e-12), 0.0), rnse.AGREEMENT)
    specks = (1 - agreement) * (1 - _continuity(direction / length.clamp_min(1e-6)[..., None]))
    noisiness = torch.maximum(noisiness, (rnse.SPECK_GAIN * _box(specks[None], rnse.SPECK_WINDOW)[0]).clamp_max(1))
    return means, noisiness * agreement + specks, noisiness


def _normalised(latent: Tensor, alpha: Tensor | None) -> Tensor:
    """As `engine.semantics.masks.similarity.normalised`."""
    largest = latent.abs().amax(2, keepdim=True)
    sound = (largest > SHORTEST) & (largest < torch.inf)  # False for NaN too, which amax passes on
    scaled = torch.where(sound, latent / torch.where(sound, largest, 1.0), 0.0)
    unit = scaled / torch.linalg.vector_norm(scaled, dim=2, keepdim=True).clamp_min(0.5)
    return unit if alpha is None else unit * torch.nan_to_num(alpha).clamp(0, 1)[..., None]


def plain_means(flat: Tensor, owner: Tensor, count: int) -> Tensor:
    """Means [K, d] of the rows [n, d] of each owner [n], 0 … K − 1."""
    return _means(flat, owner, torch.zeros(count, flat.shape[1], device=flat.device))


def _means(flat: Tensor, owner: Tensor, plain: Tensor) -> Tensor:
    """Means [K, d] of the rows [n, d] of each owner [n] that are like its `plain` [K, d]; of all where that is zero."""
    other = plain[owner]
    length = torch.linalg.vector_norm(flat, dim=1) * torch.linalg.vector_norm(other, dim=1)
    weight = _ramp((flat * other).sum(1) / length.clamp_min(1e-12), rnse.MAJORITY)[:, None] + 1e-3
    # in float64, as in memory: a mean must not depend on the order in which threads add
    sums = torch.zeros(len(plain), flat.shape[1] + 1, dtype=torch.float64, device=flat.device)
    sums.index_add_(0, owner, torch.cat([weight * flat, weight], 1).double())
    return (sums[:, :-1] / sums[:, -1:].clamp_min(1e-6)).float()


def _second_difference(unit: Tensor) -> Tensor:
    """The least over four directions, [H, W]."""
    height, width, step = *unit.shape[:2], rnse.STRIDE
    padded = _padded(unit.permute(2, 0, 1), step)
    twice = 2 * unit.permute(2, 0, 1)

    def at(down: int, right: int) -> Tensor:
        return padded[:, step + down : step + down + height, step + right : step + right + width]

    around = ((0, -step), (-step, 0), (-step, -step), (-step, step))
    before, after = (torch.stack([at(sign * down, sign * right) for down, right in around]) for sign in (1, -1))
    return ((before + after - twice).square_().sum(1).amin(0) / 6).sqrt()


def _continuity(direction: Tensor) -> Tensor:
    """c, [H, W], of unit vectors [H, W, d]; nothing goes on outside of the picture."""
    height, width = direction.shape[:2]
    reach = rnse.REACH
    planes = direction.permute(2, 0, 1).contiguous()
    padded = functional.pad(planes, (reach,) * 4)
    side, inner = 2 * reach + 1, 2 * reach - 1
    # the four sides of the square, all of a side's pixels at once: [d, H, W, pixels] without a copy
    sides = [padded[:, down : down + height].unfold(2, side, 1) for down in (0, 2 * reach)]
    sides += [padded[:, 1 : 1 + height + inner - 1, right : right + width].unfold(1, inner, 1) for right in (0, 2 * reach)]
    found = torch.zeros(height, width, device=direction.device)
    for pixels in sides:
        cosines = planes[0, ..., None] * pixels[0]
        for own, others in zip(planes[1:], pixels[1:], strict=True):
            cosines.addcmul_(own[..., None], others)
        found += _ramp(cosines, rnse.ALIKE).sum(-1)
    return found.clamp_max(1)


def _inverse(covariance: Tensor) -> Tensor:
    """(Σ + ε)⁻¹ of symmetric [3, 3, H, W], by cofactors."""
    m = covariance + rnse.FLAT * torch.eye(3, device=covariance.device)[..., None, None]
    cofactors = torch.stack([torch.linalg.cross(m[(i + 1) % 3], m[(i + 2) % 3], dim=0) for i in range(3)])
    return cofactors / (m[0] * cofactors[0]).sum(0)


def _ramp(values: Tensor, ends: tuple[float, float]) -> Tensor:
    return ((values - ends[0]) / (ends[1] - ends[0])).clamp(0, 1)


def _box(planes: Tensor, size: int) -> Tensor:
    """Mean of size × size pixels of [..., H, W], the border repeated; rows and columns one after the other."""
    padded = _padded(planes, size // 2)
    return functional.avg_pool2d(functional.avg_pool2d(padded, (size, 1), 1), (1, size), 1)


def _padded(planes: Tensor, by: int) -> Tensor:
    """[C, H, W] or [n, C, H, W] with the border repeated."""
    return functional.pad(planes, (by,) * 4, mode="replicate")

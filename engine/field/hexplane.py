"""HexPlane H(p, t): six feature planes, multiplied over planes, concatenated over resolutions (paper §2.2).

All Gaussians of a frame share one time, so the three time planes are first reduced to three lines at that time: a sample then costs three
bilinear and three linear look-ups a level instead of six bilinear ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.util import find_spec

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from degense.engine.field import hexplane_cpu
from degense.engine.field.roughness import ACROSS, ALONG, APART, BEND, roughness

#: Numbers a knot, under which a processor is faster with one product over the knots that count than with picking four of them.
SHORT = 16


class HexPlane(nn.Module):
    """Multi-resolution HexPlane over [-1, 1]³ × [-1, 1], with so many channels a level.

    Space planes have `resolution` cells along each axis, times the level's number in `levels`; time planes have `time_resolution` cells
    along time at every level.
    """

    def __init__(self, channels: int = 16, resolution: int = 64, time_resolution: int = 32, levels: tuple[int, ...] = (1, 2)):
        super().__init__()
        self.channels, self.levels = channels, levels
        # Channels last, so that one look-up reads one contiguous run. Space planes: [xy, xz, yz]; time planes: [xt, yt, zt].
        self.space = nn.ParameterList([torch.empty(3, resolution * m, resolution * m, channels).uniform_(0.5, 1.5) for m in levels])
        self.time = nn.ParameterList([torch.ones(3, time_resolution, resolution * m, channels) for m in levels])

    @property
    def dimension(self) -> int:
        """Length of a feature: channels × levels."""
        return self.channels * len(self.levels)

    def lines(self, t: float | Tensor) -> list[Tensor]:
        """The time planes at time `t`, one [3, R, C] a level. Times outside [-1, 1] are clamped."""
        return [at_time(plane, t) for plane in self.time]

    def forward(self, points: Tensor, t: float | Tensor, *others: tuple[Tensor, float | Tensor]) -> Tensor:
        """Features [N, channels × levels] of `points` [N, 3] (clamped to [-1, 1]) at time `t`; then those of `others`, points at a time.

        No gradient reaches `points`: a field that can be changed by moving the query point is one more way to explain colour by motion.
        """
        queries = [(inside(query.detach()), self.lines(time)) for query, time in ((points, t), *others)]
        spaces = list(self.space)
        if points.device.type == "cpu" and points.dtype == torch.float32 and not self.channels % hexplane_cpu.BLOCK:
            return hexplane_cpu.sample([query for query, _ in queries], spaces, [lines for _, lines in queries])
        found = [sample_levels(query, spaces, lines, sampler(query)) for query, lines in queries]
        return found[0] if len(found) == 1 else torch.cat(found)

    def smoothness(self) -> tuple[Tensor, Tensor, Tensor]:
        """Regularisers of the planes, each a mean of squares or absolutes.

        Returns (total variation in space, acceleration in time, distance of the time planes from 1).
        """
        in_space = [value for plane in self.space for value in roughness(plane, ALONG, ACROSS)]
        in_time = [roughness(plane, ALONG, BEND, APART, centre=1.0) for plane in self.time]
        along, curvature, constancy = (sum(values) for values in zip(*in_time, strict=True))
        return sum(in_space) + along, curvature, constancy


def inside(points: Tensor) -> Tensor:
    """Points of the box [-1, 1]³, whatever `points` are: a NaN must not become an index."""
    return points.nan_to_num().clamp(-1.0, 1.0)


def sampler(points: Tensor) -> Callable[[Tensor, Tensor, Tensor], Tensor]:
    """`sample_level`, or on a GPU where Triton is installed its fused twin, which is for float32."""
    if points.device.type == "cpu" or points.dtype != torch.float32 or find_spec("triton") is None:
        return sample_level
    from degense.engine.field import hexplane_cuda

    return hexplane_cuda.sample


def sample_level(points: Tensor, space: Tensor, line: Tensor) -> Tensor:
    """One level in plain torch, any device and precision: the product of six samples at points [N, 3] in [-1, 1], float [N, C].

    `space` [3, R, R, C] are the planes xy, xz, yz, of which the first named axis runs along the columns; `line` [3, R, C] are the time
    planes at one time, along x, y, z.
    """
    grid = torch.stack([points[:, [0, 1]], points[:, [0, 2]], points[:, [1, 2]]])[:, :, None].to(space.dtype)
    planes = F.grid_sample(space.permute(0, 3, 1, 2), grid, padding_mode="border", align_corners=True)[..., 0]
    along = torch.stack([points.T, torch.zeros_like(points.T)], -1)[:, :, None].to(space.dtype)
    lines = F.grid_sample(line.permute(0, 2, 1)[:, :, None], along, padding_mode="border", align_corners=True)[..., 0]
    return (planes[0] * planes[1] * planes[2] * lines[0] * lines[1] * lines[2]).T


def sample_levels(
    points: Tensor,
    spaces: Sequence[Tensor],
    lines: Sequence[Tensor],
    sample: Callable[[Tensor, Tensor, Tensor], Tensor] = sample_level,
) -> Tensor:
    """Features [N, all levels' channels], each level by `sample`."""
    return torch.cat([sample(points, space, line) for space, line in zip(spaces, lines, strict=True)], 1)


def at_time(knots: Tensor, t: float | Tensor) -> Tensor:
    """Uniform cubic B-spline along axis 1, whose K knots are spread evenly over [-1, 1]; times outside are clamped.

    Smooth in its second derivative, as tissue moves. Beyond the ends the outermost knots are repeated.
    Constants stay exactly what they are. From knots [A, K, ...] it gives [A, ...]. A time that is a tensor on the knots' device may change
    after the call was recorded in a CUDA graph.
    """
    count = knots.shape[1]
    if count == 1:
        return knots.select(1, 0)
    time = torch.as_tensor(t, dtype=knots.dtype, device=knots.device)
    position = ((time + 1) / 2).clamp(0, 1) * (count - 1)
    low = position.floor().clamp(max=count - 2)
    index = (low.long() + torch.arange(-1, 3, device=knots.device)).clamp(0, count - 1)
    u = position - low
    v = 1 - u
    weights = torch.stack([v**3, 3 * u**3 - 6 * u**2 + 4, 3 * v**3 - 6 * v**2 + 4, u**3]) / 6
    if knots.device.type == "cpu" and knots.ndim == 3 and knots.shape[2] < SHORT:
        first, last = int(index[0]), int(index[-1]) + 1
        of_knot = weights.new_zeros(last - first).index_add(0, index - first, weights)
        return knots[:, first:last].flatten(1) @ torch.kron(of_knot[:, None], torch.eye(knots.shape[2], dtype=knots.dtype))
    return torch.tensordot(knots.index_select(1, index), weights, ([1], [0]))

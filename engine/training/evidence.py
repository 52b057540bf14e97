"""Motion evidence: optical flow between training frames, lifted to 3D where depth was measured.

A photometric loss alone lets Gaussians fade and recolour in place. Flow says where each visible point went, so that colour is explained by
colour and motion by motion.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from engine.camera import Camera
from engine.language.vocabulary import surgical_vocabulary
from engine.motion import consistent, flow_between, follow, sample
from engine.progress import Progress, silent
from engine.training.frames import TrainingFrames

FLOW_PIXELS = 160_000
DEPTH_TOLERANCE = 0.03  # of the depth: a Gaussian farther from the drawn surface is hidden and says nothing
SOFTNESS = 0.003  # scene units (median depth 1) below which the robust norm is quadratic


@dataclass
class Pair:
    """Where the pixels of one frame went in another.

    Attributes
    ----------
    to : int
        The other frame.
    flow : float16 [2, h, w]
        Fractions of the image's width and height.
    weight : float16 [1, h, w]
        1 where the flow is consistent forwards and backwards and both ends are valid, else 0.
    """

    to: int
    flow: Tensor
    weight: Tensor


class MotionEvidence:
    """Flow of every training frame to its neighbours and to the first training frame, computed once.

    Neighbours are matched directly, which is exact for small motion; the way to the first frame is followed from frame to frame, since a
    direct match of far frames passes the forward-backward check while being wrong by many pixels.

    Parameters
    ----------
    frames : TrainingFrames
    progress : Progress
    """

    def __init__(self, frames: TrainingFrames, progress: Progress = silent):
        self.frames = frames
        width, height = frames.size
        shrink = min(1.0, (FLOW_PIXELS / (width * height)) ** 0.5)
        self.size = max(12, round(width * shrink)), max(12, round(height * shrink))
        train = frames.clip.train_frames
        pictures = [cv2.resize(frames.image(i), self.size, interpolation=cv2.INTER_AREA) for i in train]
        tissue = [self._inside(tissue_pixels(frames, i)) for i in train]
        self.pairs: dict[int, list[Pair]] = {i: [] for i in train}

        def neighbours(k: int) -> tuple[np.ndarray, np.ndarray]:
            return flow_between(pictures[k], pictures[k + 1]), flow_between(pictures[k + 1], pictures[k])

        steps = len(train) - 1
        with ThreadPoolExecutor(max_workers=8) as pool:
            direct = pool.map(neighbours, range(steps))
            followed = follow(pictures) if steps > 1 else iter(())
            for k, (forward, backward) in enumerate(followed):
                progress(k / steps, "following tissue through the clip")
                self._add(train[0], train[k + 1], forward, backward, tissue[0], tissue[k + 1])
                self._add(train[k + 1], train[0], backward, forward, tissue[k + 1], tissue[0])
            for k, (forward, backward) in enumerate(direct):
                progress(1.0, "matching neighbouring frames")
                self._add(train[k], train[k + 1], forward, backward, tissue[k], tissue[k + 1])
                self._add(train[k + 1], train[k], backward, forward, tissue[k + 1], tissue[k])

    def _inside(self, valid: np.ndarray) -> np.ndarray:
        """Valid pixels at flow size, away from the edge of a tool mask, whose motion bleeds into the tissue beside it."""
        small = cv2.resize(valid.astype(np.uint8), self.size, interpolation=cv2.INTER_NEAREST)
        return cv2.erode(small, np.ones((7, 7), np.uint8), borderValue=1) > 0

    def _add(self, a: int, b: int, forward: np.ndarray, backward: np.ndarray, tissue_a: np.ndarray, tissue_b: np.ndarray) -> None:
        width, height = self.size
        weight = tissue_a & (sample(tissue_b.astype(np.float32), forward) > 0.99) & consistent(forward, backward)
        relative = np.moveaxis(forward / np.array([width, height], np.float32), -1, 0)
        device = self.frames.device
        self.pairs[a].append(Pair(b, torch.from_numpy(relative.copy()).half().to(device), torch.from_numpy(weight[None]).half().to(device)))

    def carried(self, picture: np.ndarray, source: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """A picture of one training frame, moved to where its tissue is in another, by way of the first training frame.

        Parameters
        ----------
        picture : [H, W] or [H, W, C]
            At the working size.

        Returns
        -------
        picture, known
            Nearest pixels of the source, and bool [H, W] where flow could say which; unmoved elsewhere.
        """
        first = self.frames.clip.train_frames[0]
        known = np.ones(picture.shape[:2], bool)
        for here, there in ((first, source), (frame, first)):
            pair = next((pair for pair in self.pairs.get(here, []) if pair.to == there), None)
            if pair is None:
                known &= here == there
                continue
            width, height = self.frames.size
            flow = cv2.resize(pair.flow.float().cpu().numpy().transpose(1, 2, 0), (width, height)) * np.array([width, height], np.float32)
            sure = cv2.resize(pair.weight[0].float().cpu().numpy(), (width, height)) > 0.5
            x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
            x, y = x + flow[..., 0], y + flow[..., 1]
            moved = cv2.remap(picture, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
            known = sure & (cv2.remap(known.astype(np.uint8), x, y, cv2.INTER_NEAREST, borderValue=0) > 0)
            picture = np.where(known.reshape(known.shape + (1,) * (picture.ndim - 2)), moved, picture)
        return picture, known

    def loss(self, here: Tensor, there: Tensor, visible: Tensor, frame: int, pair: Pair) -> Tensor:
        """Robust distance between the model's motion and the observed one, averaged over visible Gaussians with evidence.

        With measured depth the target is the 3D offset between the surface points at both ends of the flow; without it only the motion
        across the line of sight is compared, at the Gaussian's own depth.

        Parameters
        ----------
        here, there : float [N, 3]
            Centres at the time of `frame` and of `pair.to`.
        visible : float [N]
            Weight of each Gaussian: 0 hidden, 1 on the surface.
        """
        camera, other = self.frames.cameras[frame], self.frames.cameras[pair.to]
        start, z = project(here, camera)
        end, z_end = project(there, other)
        grid = start.detach() * 2 - 1
        flow = look_up(pair.flow.float(), grid)
        weight = (look_up(pair.weight.float(), grid)[:, 0] > 0.99) * visible  # believed at all four pixels around, but for rounding
        target = start.detach() + flow
        if self.frames.clip.depth_measured:
            before = look_up(self.frames[frame].depth[None], grid)[:, 0]
            after = look_up(self.frames[pair.to].depth[None], target * 2 - 1)[:, 0]
            weight = weight * (before > 0) * (after > 0) * ((after - before).abs() < 0.15 * before)
            error = (there - here) - (unproject(target, after, other) - unproject(start.detach(), before, camera))
        else:
            focal = there.new_tensor([other.width / other.fx, other.height / other.fy])
            lateral = ((end - start) - flow) * focal * z.detach()[:, None]
            error = torch.cat([lateral, (z_end - z)[:, None] * 0.2], 1)  # depth is unseen: a mild pull against explaining motion by it
        distance = (error.square().sum(1) + SOFTNESS**2).sqrt() - SOFTNESS
        return (distance * weight).sum() / weight.sum().clamp_min(1)


def tissue_pixels(frames: TrainingFrames, index: int) -> np.ndarray:
    """Valid pixels that no label map calls an instrument, bool [H, W] at the working size."""
    valid = frames.valid(index)
    clip = frames.clip
    instruments = [value for value, name in enumerate(clip.classes) if surgical_vocabulary().is_a(name, "instrument")]
    labels = clip.labels(index) if instruments and index in clip.labelled_frames else None
    if labels is None:
        return valid
    tool = np.isin(labels, instruments).astype(np.uint8)
    return valid & (cv2.resize(tool, frames.size, interpolation=cv2.INTER_NEAREST) == 0)


def surface_visibility(means: Tensor, opacities: Tensor, radii: Tensor, depth: Tensor, alpha: Tensor, camera: Camera) -> Tensor:
    """1 for Gaussians that are drawn, lie on the drawn surface (within 3 % of its depth) and are not faint; else 0. Float [N], no gradient.

    Parameters
    ----------
    depth, alpha : float [H, W]
        Blended z (not divided) and coverage.
    """
    position, z = project(means.detach(), camera)
    surface = look_up((depth / alpha.clamp_min(1e-6)).detach()[None], position * 2 - 1)[:, 0]
    return ((z - surface).abs() < DEPTH_TOLERANCE * surface).float() * (radii > 0) * (opacities.detach() > 0.1)


def project(points: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """Image positions as fractions of width and height [N, 2], and depths z [N]."""
    view = torch.as_tensor(camera.viewmat, dtype=points.dtype).to(points.device)
    local = points @ view[:3, :3].T + view[:3, 3]
    z = local[:, 2].clamp_min(1e-3)
    x = (local[:, 0] / z * camera.fx + camera.cx) / camera.width
    y = (local[:, 1] / z * camera.fy + camera.cy) / camera.height
    return torch.stack([x, y], 1), z


def unproject(position: Tensor, z: Tensor, camera: Camera) -> Tensor:
    """World points [N, 3] of image positions (fractions) [N, 2] at depths z [N]."""
    x = (position[:, 0] * camera.width - camera.cx) / camera.fx * z
    y = (position[:, 1] * camera.height - camera.cy) / camera.fy * z
    view = torch.as_tensor(camera.viewmat, dtype=position.dtype).to(position.device)
    return (torch.stack([x, y, z], 1) - view[:3, 3]) @ view[:3, :3]


def look_up(picture: Tensor, grid: Tensor) -> Tensor:
    """Bilinear samples [N, C] of `picture` [C, H, W] at `grid` [N, 2] in [-1, 1]; 0 outside."""
    return F.grid_sample(picture[None], grid[None, None].to(picture.dtype), align_corners=False)[0, :, 0].T

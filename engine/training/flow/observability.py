"""Motion observability: which displacement the images reveal at all."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.field import SceneModel
from degense.engine.motion import confidence
from degense.engine.motion.observed import TEXTURE
from degense.engine.raster import camera_depths, rasterize
from degense.engine.raster.camera_tensors import project, view_and_lens
from degense.engine.training.flow.motion_error import look_up, surface_visibility
from degense.engine.training.flow.supervision import FlowSupervision
from degense.engine.training.frames import TrainingFrames


@torch.no_grad()
def motion_observability(model: SceneModel, frames: TrainingFrames, flow: FlowSupervision) -> Tensor:
    """In which share of its frames the images reveal how far a Gaussian has moved, float32 [N] in [0, 1].

        observability_i = Σ_t v_i(t) · s(p_i(t), t) / Σ_t v_i(t)

    over training frames t other than the reference; v_i(t) is 1 where the Gaussian lies on the surface that is seen, p_i(t) its pixel,
    s(p, t) as in `revealed_motion`.

    A Gaussian that is never on the seen surface has 0: no frame shows where it is. What this cannot see: flow that is consistent, on
    texture, and wrong all the same (a highlight that travels, repeated patterns), and motion along the line of sight.

    `model` is trained, in the unit of `frames`.
    """
    clip = frames.clip
    reference = clip.train_frames[0]
    others = [i for i in clip.train_frames if i != reference] or [reference]
    revealed_frames = torch.zeros(len(model), device=model.bounds.device)
    seen = torch.zeros_like(revealed_frames)
    for i in others:
        camera = frames.cameras[i]
        splats = model.at(clip.time(i), semantics=False).splats
        depth = camera_depths(splats.means, camera)[:, None]
        render = rasterize(splats, depth, camera)
        seen_by = view_and_lens(camera, revealed_frames.device)
        visible = surface_visibility(splats.means, splats.opacities, render.radii, render.image[..., 0], render.alpha, seen_by)
        position, _ = project(splats.means, seen_by)
        revealed = torch.from_numpy(revealed_motion(frames, flow, i)).to(revealed_frames.device)
        revealed_frames += visible * look_up(revealed[None], position * 2 - 1)[:, 0]
        seen += visible
    return revealed_frames / seen.clamp_min(1)


def revealed_motion(frames: TrainingFrames, flow: FlowSupervision, index: int) -> np.ndarray:
    """s(p, t) for one training frame, float32 [h, w] at the size of the flow: 1 where the recording shows how far tissue has moved.

    That is where its way to the reference frame is the same forwards and backwards, begins and ends on valid pixels that the teacher calls
    no instrument, and texture pins it down (`engine.motion.confidence`); else 0.
    """
    reference = frames.clip.train_frames[0]
    frame = cv2.resize(frames.image(index), flow.size, interpolation=cv2.INTER_AREA)
    reliable = np.zeros(frame.shape[:2], np.float32)
    for pair in flow.pairs[index]:
        if pair.to == reference:
            reliable = np.maximum(reliable, pair.weight[0].float().cpu().numpy())
    return reliable * (confidence(frame) > TEXTURE)

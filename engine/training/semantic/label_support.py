"""Which Gaussians the labelled frames of a sparse teacher show: of what entered later nobody said what it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.field import SceneModel
from degense.engine.raster import backproject
from degense.engine.splats import Splats
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.semantic.targets import SemanticTargets

MOST_FRAMES = 24  # of the training, evenly spread, in which it is looked how much of a Gaussian is seen at best


def label_support(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> Float[Tensor, " n"]:
    """How much of each Gaussian the labelled frames show, of what is seen of it at best, in [0, 1]:

        s_i = max_{t labelled} Σ_p m_p(t) w_ip(t) / max_t Σ_p w_ip(t)

    over the teacher's labelled frames, and these with up to `MOST_FRAMES` training frames; w_ip is the share of Gaussian i in pixel p, and
    m_p is 1 where the teacher labels the pixel, else 0. A Gaussian outside of the view, hidden, or not there yet in all labelled frames has
    0, and so has one that no frame shows. `model` is in the unit of `frames`.
    """
    answers = {frame: targets.answer(frame) for frame in targets.labelled_frames}
    said = {frame: answer[1] >= 0 for frame, answer in answers.items() if answer is not None}
    return support_of(
        lambda frame: model.at(frames.clip.time(frame), semantics=False).splats, frames.cameras, said, frames.clip.train_frames
    )


@torch.no_grad()
def support_of(
    splats_at: Callable[[int], Splats], cameras: Sequence[Camera], said: Mapping[int, np.ndarray], others: Sequence[int]
) -> Float[Tensor, " n"]:
    """`label_support` of any scene: `splats_at` gives its N Gaussians at a frame, `said` the labelled pixels bool [H, W] by frame."""
    spread = {others[k] for k in np.unique(np.linspace(0, len(others) - 1, min(len(others), MOST_FRAMES)).round().astype(int))}
    sums = []
    for frame in sorted(spread | set(said)):
        camera, splats = cameras[frame], splats_at(frame)
        labelled = said.get(frame, np.zeros((camera.height, camera.width), bool))
        named, seen = backproject(splats, torch.from_numpy(labelled).to(splats.means)[..., None], camera, clean=True)
        sums.append(torch.stack([named[:, 0], seen]))
    named, best = torch.stack(sums).amax(0)
    return (named / best.clamp_min(1e-6)).clamp(0, 1)

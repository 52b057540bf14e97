"""What the labelled frames of a sparse teacher show, and what looks like it: of all else nobody said what it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import cv2
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from degense.engine.camera import Camera
from degense.engine.field import SceneModel
from degense.engine.raster import backproject
from degense.engine.semantics.novelty import Novelty, surroundings_by_class
from degense.engine.splats import Splats
from degense.engine.store.run import LabelSupport
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.semantic.targets import SemanticTargets

MOST_FRAMES = 24  # of the training, evenly spread, that are looked at
SAMPLES = 1500  # pixels of each label and frame that tell how what is labelled looks
#: From which `Novelty` on a place looks new, and the blur of it, pixels.
NEW, BLUR = 3.0, 2.0


def label_support(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> LabelSupport:
    """How much of each Gaussian the labelled frames show (`shown_by`), and how much of it looks like what they show:

        f_i = Σ_t Σ_p [ν_p(t) < `NEW`] w_ip(t) / Σ_t Σ_p w_ip(t)

    over up to `MOST_FRAMES` training frames t; ν is the `Novelty` of a pixel's surroundings beside those of the labelled pixels, w_ip the
    share of Gaussian i in pixel p. `model` is in the unit of `frames`.
    """
    labels = {frame: answer[1] for frame in targets.labelled_frames if (answer := targets.answer(frame)) is not None}
    clip, random = frames.clip, np.random.default_rng(0)
    looks = [surroundings_by_class(frames.image(frame), said, SAMPLES, random) for frame, said in labels.items()]
    novelty = Novelty(np.concatenate([values for by_label in looks for values in by_label.values()]))

    def splats_at(frame: int) -> Splats:
        return model.at(clip.time(frame), semantics=False).splats

    shown = shown_by(splats_at, frames.cameras, {frame: said >= 0 for frame, said in labels.items()}, clip.train_frames)
    familiar = familiar_by(splats_at, frames.cameras, lambda frame: novelty(frames.image(frame)), clip.train_frames)
    return LabelSupport(shown.cpu(), familiar.cpu(), list(targets.labelled_frames))


@torch.no_grad()
def shown_by(
    splats_at: Callable[[int], Splats], cameras: Sequence[Camera], said: Mapping[int, np.ndarray], others: Sequence[int]
) -> Float[Tensor, " n"]:
    """How much of each Gaussian some frames show, of what is seen of it at best, in [0, 1]:

        s_i = max_{t said} Σ_p m_p(t) w_ip(t) / max_t Σ_p w_ip(t)

    over the frames of `said`, bool [H, W] by frame, which is m, and these with up to `MOST_FRAMES` of the `others`. `splats_at` gives the N
    Gaussians at a frame. A Gaussian outside of the view, hidden, or not there yet in all frames of `said` has 0, and so has one that no
    frame shows.
    """
    sums = []
    for frame in sorted({*spread(others), *said}):
        camera, splats = cameras[frame], splats_at(frame)
        labelled = said.get(frame, np.zeros((camera.height, camera.width), bool))
        named, seen = backproject(splats, torch.from_numpy(labelled).to(splats.means)[..., None], camera, clean=True)
        sums.append(torch.stack([named[:, 0], seen]))
    named, best = torch.stack(sums).amax(0)
    return (named / best.clamp_min(1e-6)).clamp(0, 1)


@torch.no_grad()
def familiar_by(
    splats_at: Callable[[int], Splats], cameras: Sequence[Camera], novelty: Callable[[int], np.ndarray], others: Sequence[int]
) -> Float[Tensor, " n"]:
    """f_i of `label_support`, in [0, 1], by the novelty float32 [H, W] of each frame; 0 of what is not seen."""
    total = torch.zeros(())
    for frame in spread(others):
        splats = splats_at(frame)
        known = cv2.GaussianBlur(novelty(frame), (0, 0), BLUR) < NEW
        named, seen = backproject(splats, torch.from_numpy(known).to(splats.means)[..., None], cameras[frame], clean=True)
        total = total.to(seen) + torch.stack([named[:, 0], seen])
    return (total[0] / total[1].clamp_min(1e-6)).clamp(0, 1)


def spread(frames: Sequence[int]) -> list[int]:
    """Up to `MOST_FRAMES` of some frames, evenly spread."""
    return [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, min(len(frames), MOST_FRAMES)).round().astype(int))]

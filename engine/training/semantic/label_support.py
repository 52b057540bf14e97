"""What the labelled frames of a sparse teacher show, and what looks like what they call the same: of all else nobody said what it is."""

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
from degense.engine.semantics.novelty import Novelty, surroundings, surroundings_by_class
from degense.engine.splats import Splats
from degense.engine.store.run import LabelSupport
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.passes import draw_latents
from degense.engine.training.semantic.targets import SemanticTargets
from degense.engine.training.semantic.vectors import words_of

MOST_FRAMES = 24  # of the training, evenly spread, that are looked at
SAMPLES = 1500  # pixels of each label and frame that tell how what is labelled looks
#: From which `Novelty` on a place looks new, and the blur of it, pixels.
NEW, BLUR = 3.0, 2.0


def label_support(model: SceneModel, targets: SemanticTargets, frames: TrainingFrames) -> LabelSupport:
    """How much of each Gaussian the labelled frames show (`shown_by`), and how much of it looks like what they call as the scene does:

        f_i = Σ_t Σ_p [ν_p(t) < `NEW`] w_ip(t) / Σ_t Σ_p w_ip(t)

    over up to `MOST_FRAMES` training frames t; ν is the `Novelty` of a pixel's surroundings beside those of the labelled pixels of the word
    that the scene has for the pixel, w_ip the share of Gaussian i in pixel p. `model` is in the unit of `frames`.
    """
    clip = frames.clip
    words = words_of(targets.sample, targets.classes)
    said = {frame: targets.told(frame, words) for frame in targets.labelled_frames}
    alike = _novelty_by_word(frames, said)
    rows = torch.from_numpy(targets.basis.project(words)).float().to(model.bounds)

    @torch.no_grad()
    def novelty(frame: int) -> np.ndarray:
        latents = draw_latents(model.at(clip.time(frame)).splats, frames.cameras[frame], detached=True)
        named = (latents @ torch.nn.functional.normalize(rows, dim=1).T).argmax(-1).cpu().numpy().ravel()
        around, found = surroundings(frames.image(frame)), np.full(named.size, np.inf, np.float32)
        for word, of_word in alike.items():
            found[named == word] = of_word.of(around[named == word])
        return found.reshape(latents.shape[:2])

    def splats_at(frame: int) -> Splats:
        return model.at(clip.time(frame), semantics=False).splats

    shown = shown_by(splats_at, frames.cameras, {frame: told >= 0 for frame, told in said.items()}, clip.train_frames)
    familiar = familiar_by(splats_at, frames.cameras, novelty, clip.train_frames)
    return LabelSupport(shown.cpu(), familiar.cpu(), list(targets.labelled_frames))


def _novelty_by_word(frames: TrainingFrames, said: Mapping[int, np.ndarray]) -> dict[int, Novelty]:
    """`Novelty` beside the pixels of each word that labelled frames have, int [H, W] by frame; all in units of what they all show."""
    random = np.random.default_rng(0)
    looks = [surroundings_by_class(frames.image(frame), told, SAMPLES, random) for frame, told in said.items()]
    novelty = Novelty(np.concatenate([values for look in looks for values in look.values()]))
    words = sorted(set().union(*looks))
    return {word: novelty.beside(np.concatenate([look[word] for look in looks if word in look])) for word in words}


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

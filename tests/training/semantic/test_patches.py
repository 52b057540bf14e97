"""What patches see of a picture, against plain sums over all of them."""

import numpy as np
import torch

from degense.engine.research.degraded_teachers import Degradation, DegradedTeacher
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.losses import chord
from degense.engine.training.semantic.patches import BLUR, Patches
from degense.engine.training.semantic.targets import SemanticTargets
from tests.fakes import MemoryClip

CPU = torch.device("cpu")


def test_a_patch_sees_the_mean_of_itself_and_a_little_of_those_around_it():
    rng = np.random.default_rng(0)
    index = (np.arange(70)[:, None] // 10 * 9 + np.arange(90)[None] // 10).astype(np.int32)
    index[rng.random(index.shape) < 0.2] = -1
    index[index == 40] = -1  # a patch of which nothing is valid
    picture = rng.normal(size=(70 * 90, 5))
    seen = Patches.of(index, 63, CPU).see(torch.from_numpy(picture).float()).numpy()

    flat = index.ravel()
    rows, columns = np.divmod(np.arange(70 * 90), 90)
    live = [p for p in range(63) if p != 40]
    size = np.array([(flat == p).sum() for p in live])
    means = np.array([picture[flat == p].mean(0) for p in live])
    place = np.array([(rows[flat == p].mean(), columns[flat == p].mean()) for p in live])
    side = np.sqrt(size.sum() / len(live))
    for k, p in enumerate(live):
        share = size * np.exp(-((place - place[k]) ** 2).sum(1) / (2 * (BLUR * side) ** 2))
        np.testing.assert_allclose(seen[p], share @ means / share.sum(), atol=0.01)  # we leave out the farthest, which are hardly seen
    assert np.isfinite(seen).all()


def test_one_patch_and_more_than_there_are_pixels_of():
    picture = torch.arange(12.0)[:, None]
    assert Patches.of(np.zeros((3, 4), int), 1, CPU).see(picture).tolist() == [[5.5]]
    fine = Patches.of(np.arange(12).reshape(3, 4), 20, CPU)
    assert fine.see(picture).isfinite().all()
    np.testing.assert_allclose(fine.share.sum(1), 1, rtol=1e-6)


def test_the_patch_loss_is_least_where_each_patch_sees_what_was_said_of_it():
    clip = MemoryClip()
    teacher = DegradedTeacher(clip, EmbeddedEncoder(), Degradation("features", strength=3))
    targets = SemanticTargets(teacher, TrainingFrames(clip, 1 << 20, CPU))
    frame = targets.labelled_frames[1]
    patches, wanted, weight = targets.patch_target(frame)
    assert abs(float(weight.sum()) - 1) < 1e-5

    height, width = clip.labels(frame).shape
    latent = torch.randn(height, width, wanted.shape[1], generator=torch.Generator().manual_seed(0)).requires_grad_()
    unit = torch.nn.functional.normalize
    apart = unit(patches.see(latent.detach().reshape(height * width, -1)), dim=1) - unit(wanted, dim=1)
    by_hand = (apart.square().sum(1) + 0.01**2).sqrt()
    loss = targets.patch_loss(latent, frame, chord, 0.0)["align"]
    assert abs(loss.item() - float((by_hand * weight).sum())) < 1e-5
    assert sum(targets.patch_loss(latent, frame, chord, 1.0).values()) > loss

    optimizer = torch.optim.Adam([latent], lr=0.05)
    for _ in range(150):
        optimizer.zero_grad()
        loss = targets.patch_loss(latent, frame, chord, 0.0)["align"]
        loss.backward()
        optimizer.step()
    assert loss < 0.1
    silent = patches.owner == len(patches.size)
    assert not latent.grad.reshape(-1, wanted.shape[1])[silent].any()

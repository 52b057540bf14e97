"""The confidence of masks, found from a teacher that errs and compared with the truth that it was made from."""

import numpy as np
import pytest
import torch

from degense.engine.field import FieldConfig, SceneModel
from degense.engine.raster import rasterize
from degense.engine.semantics import EmbeddedEncoder
from degense.engine.semantics.masks import query_of
from degense.engine.semantics.prompts import PromptVectors
from degense.engine.semantics.teachers import LabelTeacher
from degense.engine.training.config import TrainConfig
from degense.engine.training.frames import TrainingFrames
from degense.engine.training.initialise import initial_gaussians
from degense.engine.training.semantic.confidence import confidence_of
from degense.engine.training.semantic.distillation import distill
from degense.engine.training.semantic.targets import SemanticTargets
from tests.fakes import MemoryClip
from tests.training.semantic.test_consensus import Erring


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_what_is_said_of_masks_is_the_share_that_is_right_whatever_share_of_its_labels_the_teacher_errs_in(share):
    clip = MemoryClip(16, 96, 80)
    frames = TrainingFrames(clip, 1 << 20, torch.device("cpu"))
    exact = LabelTeacher(clip, EmbeddedEncoder())
    targets = SemanticTargets(Erring(exact, share), frames)
    canonical, bounds = initial_gaussians(frames, None, 400, targets.basis.rank, np.random.default_rng(0), 4)
    model = SceneModel(FieldConfig(rank=targets.basis.rank, color_knots=4, resolution=16, time_resolution=4), bounds, canonical)
    distill(model, targets, frames, TrainConfig.preset_of("quick", semantic_steps=4))
    curve = confidence_of(model, targets, frames)
    said, right = [], []
    for frame in clip.train_frames:
        with torch.no_grad():
            splats = model.at(clip.time(frame)).splats
            drawn = rasterize(splats, torch.cat([splats.colors, splats.semantics], 1), clip.cameras[frame])
        query = query_of(drawn, targets.basis, curve)
        truth = exact.targets(frame)[1]
        for k, mask in enumerate(query.decode(PromptVectors(tuple(targets.classes), classes=targets.classes)).masks):
            held = mask & (truth >= 0)
            said.append(query.chances(targets.classes[k], targets.classes)[held])
            right.append(truth[held] == k)
    said, right = np.concatenate(said), np.concatenate(right)
    assert said.mean() == pytest.approx(right.mean(), abs=0.03)
    low = said < np.quantile(said, 0.2)
    assert said[low].mean() == pytest.approx(right[low].mean(), abs=0.08), "where it is least sure, too"

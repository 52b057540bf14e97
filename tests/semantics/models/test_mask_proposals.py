"""Regions that a SAM proposes: a tiny random one in the real class, and one whose masks are known."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from degense.engine.errors import DegenseError
from degense.engine.semantics.models.mask_proposals import MaskProposals, distinct
from degense.engine.semantics.teachers import teacher_by_name, with_cached_targets
from degense.engine.semantics.teachers.vlm import VlmTeacher, by_regions
from tests.fakes import MemoryClip
from tests.semantics.models.tiny_models import write_model, write_sam


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    root = tmp_path_factory.mktemp("models")
    return {kind: write_model(root / kind, kind) for kind in ("clip", "clipseg")} | {"sam": write_sam(root / "sam")}


def knowing(proposals: MaskProposals, quality: float) -> MaskProposals:
    """The same model, which answers each point with the half of the picture, left or right, that the point lies in."""

    def answer(image_embeddings, input_points, input_labels, multimask_output):
        points = input_points[0, :, 0]
        logits = torch.full((1, len(points), 3, 8, 8), -9.0)
        for k, x in enumerate(points[:, 0].tolist()):
            logits[0, k, 0, :, slice(0, 4) if x < 16 else slice(4, 8)] = 9
            logits[0, k, 1] = torch.linspace(-1.5, 1.5, 8)  # where it is cut decides about it
            logits[0, k, 2] = 9
        return SimpleNamespace(pred_masks=logits, iou_scores=torch.tensor([quality, 1.0, 0.1]).expand(1, len(points), 3))

    embedded = proposals._model.get_image_embeddings
    proposals._model = type("Known", (), {"get_image_embeddings": staticmethod(embedded), "__call__": staticmethod(answer)})()
    return proposals


def test_a_sam_from_a_folder_proposes_masks_of_the_frame(models, monkeypatch):
    monkeypatch.setattr("degense.engine.semantics.models.mask_proposals.QUALITY", -9.0)  # a random one is good for nothing
    monkeypatch.setattr("degense.engine.semantics.models.mask_proposals.STABILITY", -1.0)
    proposals = MaskProposals(models["sam"], torch.device("cpu"))
    rgb = np.random.default_rng(0).integers(0, 255, (40, 48, 3), np.uint8)
    masks = proposals(rgb)
    assert (masks.dtype, masks.shape[1:]) == (bool, (40, 48))
    assert len(masks)
    assert (np.diff(masks.sum((1, 2))) <= 0).all()
    np.testing.assert_array_equal(masks, MaskProposals(models["sam"], torch.device("cpu"))(rgb))
    assert proposals.name.startswith("sam-")


def test_good_stable_masks_stay_once_and_without_padding(models):
    proposals = knowing(MaskProposals(models["sam"], torch.device("cpu")), 0.95)
    left, right = masks = proposals(np.zeros((32, 64, 3), np.uint8))
    assert len(masks) == 2
    assert (left ^ right).mean() > 0.95
    assert sorted([left[:, :28].mean(), right[:, :28].mean()]) == [0, 1]
    assert len(knowing(MaskProposals(models["sam"], torch.device("cpu")), 0.5)(np.zeros((32, 64, 3), np.uint8))) == 0


def test_of_masks_that_are_about_the_same_the_best_stays():
    logits = torch.full((3, 10, 10), -1.0)
    logits[0, :5], logits[1, :6], logits[2, 8:] = 1, 1, 1
    np.testing.assert_array_equal(distinct(logits, torch.tensor([0.9, 0.95, 0.8])), logits[[1, 2]])
    assert len(distinct(logits[:0], torch.zeros(0))) == 0


def test_each_region_has_the_mean_of_its_pixels_and_the_smallest_wins():
    pieces, place = np.array([[1.0, 0], [0, 1]]), np.repeat([[0, 0, 1, 1]], 4, 0)
    masks = np.zeros((2, 4, 4), bool)
    masks[0, :, :3], masks[1, 0, 2] = True, True
    found, index = by_regions(pieces, place, masks)
    np.testing.assert_array_equal(index, [[2, 2, 3, 1]] + 3 * [[2, 2, 2, 1]])
    np.testing.assert_allclose(found[2:], [[8 / 11, 3 / 11], [0, 1]])


@pytest.mark.parametrize("kind", ["clip", "clipseg"])
def test_a_teacher_with_regions_gives_them_one_vector_each(models, kind):
    clip = MemoryClip()
    name = f"vlm:{models[kind]}?scales=2&regions={models['sam']}"
    teacher = teacher_by_name(name, clip)
    assert (teacher.name, teacher.pixelwise) == (name, True)
    assert "regions of sam-" in teacher.provenance
    assert teacher.settings != VlmTeacher(clip, str(models[kind]), 2).settings
    knowing(teacher.proposals, 0.95)
    vectors, index = with_cached_targets(teacher).targets(2)
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    valid = clip.valid(2)
    for half in (slice(2, 20), slice(28, 46)):
        assert len(np.unique(index[:, half][valid[:, half]])) == 1


def test_what_is_no_sam_is_one_sentence(models, tmp_path):
    clip = MemoryClip()
    with pytest.raises(DegenseError, match="kind 'clip'; regions are proposed by a SAM"):
        VlmTeacher(clip, str(models["clip"]), regions=str(models["clip"]))
    (tmp_path / "config.json").write_text('{"model_type": "sam"}')
    with pytest.raises(DegenseError, match=r"holds no SAM with model\.safetensors"):
        VlmTeacher(clip, str(models["clip"]), regions=str(tmp_path))
    with pytest.raises(DegenseError, match="does not understand 'regions='"):
        teacher_by_name(f"vlm:{models['clip']}?regions=", clip)

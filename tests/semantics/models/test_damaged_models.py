"""Models whose files are damaged, or are another model's, are refused in a sentence: weights, tokenizer, preprocessing."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from degense.engine.errors import DegenseError
from degense.engine.semantics.models.mask_proposals import MaskProposals
from degense.engine.semantics.models.vlm_models import DenseModel
from degense.engine.semantics.text.towers import encoder_at
from tests.semantics.models.tiny_models import write_model, write_sam
from tests.semantics.text.test_towers import write_sentences

CPU = torch.device("cpu")
UNREADABLE = b"\x02\0\0\0\0\0\0\0[]"  # a header that is no object


@pytest.fixture(scope="module")
def published(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("models")
    write_model(root / "clip", "clip"), write_sam(root / "sam"), write_sentences(root / "sentences")
    return root


@pytest.fixture
def models(published, tmp_path) -> Path:
    """Copies that may be spoilt."""
    return Path(shutil.copytree(published, tmp_path / "models"))


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("clip", lambda path: DenseModel(path, CPU)),
        ("sam", lambda path: MaskProposals(path, CPU)),
        ("sentences", lambda path: encoder_at(str(path))),
    ],
)
def test_damaged_weights_are_one_sentence(name, read, models):
    (models / name / "model.safetensors").write_bytes(UNREADABLE)
    with pytest.raises(DegenseError, match=rf"{name} holds no .* with model\.safetensors.*: \w+") as refused:
        read(models / name)
    assert "Error" not in str(refused.value).replace("Error while", "")


def test_a_sam_whose_parts_do_not_fit_each_other_is_one_sentence(models):
    file = models / "sam" / "config.json"
    said = json.loads(file.read_text())
    said["prompt_encoder_config"]["image_embedding_size"] = str(said["prompt_encoder_config"]["image_embedding_size"])
    file.write_text(json.dumps(said))
    with pytest.raises(DegenseError, match=r"sam holds no SAM .*: its parts do not fit each other$"):
        MaskProposals(models / "sam", CPU)(np.zeros((40, 48, 3), np.uint8))


def shifted(tokenizer: Path, by: int) -> None:
    """Every token gets a number that is so much higher."""
    said = json.loads(tokenizer.read_text())
    said["model"]["vocab"] = {word: place + by for word, place in said["model"]["vocab"].items()}
    said["added_tokens"] = [{**token, "id": token["id"] + by} for token in said["added_tokens"]]
    tokenizer.write_text(json.dumps(said))


@pytest.mark.parametrize(
    ("name", "read"), [("clip", lambda path: DenseModel(path, CPU).texts(["liver"])), ("sentences", lambda path: encoder_at(str(path)))]
)
def test_a_tokenizer_of_another_model_is_refused(name, read, models):
    read(models / name)
    shifted(models / name / "tokenizer.json", 100)
    with pytest.raises(DegenseError, match="tokenizer is damaged, or not the one of the model"):
        read(models / name)


@pytest.mark.parametrize(
    "three", [None, "0.5", [0.5, 0.5], [[0.5], [0.5], [0.5]], [1, 1, float("nan")], [0, 0, 0], [True, True, True], [1e9, 1, 1]]
)
@pytest.mark.parametrize(("name", "read"), [("clip", DenseModel), ("sam", MaskProposals)])
def test_pictures_are_prepared_by_three_numbers_or_not(three, name, read, models):
    (models / name / "preprocessor_config.json").write_text(json.dumps({"image_std": three}))
    with pytest.raises(DegenseError, match=r"image_std|not valid JSON"):
        read(models / name, CPU)
    (models / name / "preprocessor_config.json").write_text(json.dumps({"image_mean": [0, 0.5, -1], "image_std": [1, 1, 2]}))
    model = read(models / name, CPU)
    np.testing.assert_array_equal(model._mean.ravel(), [0, 0.5, -1])

"""Text towers, on tiny random models in the real classes and file formats of transformers and sentence-transformers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import transformers

from degense.engine.errors import DegenseError, PromptError, RunError
from degense.engine.semantics import open_encoder, save_encoder
from degense.engine.semantics.models import vlm_models
from degense.engine.semantics.text.towers import encoder_at
from tests.semantics.models.tiny_models import write_model

LETTERS = "abcdefghijklmnopqrstuvwxyz"


def write_sentences(folder: Path, mode: str = "mean_tokens", seed: int = 0) -> Path:
    """A sentence model as sentence-transformers lays it out."""
    transformers.utils.logging.disable_progress_bar()
    folder.mkdir()
    vocabulary = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *LETTERS, *("##" + letter for letter in LETTERS)]
    (folder / "vocab.txt").write_text("\n".join(vocabulary))
    transformers.BertTokenizer(str(folder / "vocab.txt"), model_max_length=32).save_pretrained(folder)
    torch.manual_seed(seed)
    shape = {"hidden_size": 24, "num_hidden_layers": 2, "num_attention_heads": 2, "intermediate_size": 32, "max_position_embeddings": 40}
    transformers.BertModel(transformers.BertConfig(vocab_size=len(vocabulary), **shape)).save_pretrained(folder)
    names = ("Transformer", "Pooling", "Normalize")
    (folder / "modules.json").write_text(json.dumps([{"idx": i, "type": f"sentence_transformers.models.{n}"} for i, n in enumerate(names)]))
    (folder / "1_Pooling").mkdir()
    modes = {f"pooling_mode_{name}": name == mode for name in ("cls_token", "mean_tokens", "max_tokens")}
    (folder / "1_Pooling/config.json").write_text(json.dumps({"word_embedding_dimension": 24, **modes}))
    return folder


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("models")
    return {"clip": write_model(folder / "clip", "clip"), "sentences": write_sentences(folder / "sentences")}


@pytest.mark.parametrize("kind", ["clip", "sentences"])
def test_a_tower_understands_wordings_and_says_what_it_does_not(places, kind):
    encoder = encoder_at(str(places[kind])).with_classes(["liver", "L_hook"])
    rows = encoder.encode(["the livers", "foie", "Leber", "hook"])
    assert rows.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    np.testing.assert_array_equal(rows, encoder.encode(["liver", "liver", "liver", "L_hook"]))
    assert abs(rows[0] @ rows[3]) < 0.999
    with pytest.raises(PromptError, match="'banana' is not in the vocabulary"):
        encoder.encode(["banana"])
    as_typed = encoder.encode(['"a ripe banana, not green"'])[0]
    assert np.linalg.norm(as_typed) == pytest.approx(1, abs=1e-5)
    assert encoder.exclude('liver, not "a banana"').shape == (1, encoder.dimension)


def captions(folder: Path, *sentences: str) -> np.ndarray:
    """Unit text vectors [n, D] as transformers computes them, sentence by sentence."""
    model = transformers.CLIPModel.from_pretrained(folder)
    tokenizer = transformers.AutoTokenizer.from_pretrained(folder)
    with torch.no_grad():
        vectors = [model.get_text_features(**tokenizer([text], return_tensors="pt")).pooler_output[0].numpy() for text in sentences]
    return np.stack([vector / np.linalg.norm(vector) for vector in vectors])


def test_a_clip_is_asked_in_several_captions(places):
    said = captions(places["clip"], *(template.format("spleen") for template in vlm_models.TEMPLATES)).mean(0)
    found = encoder_at(str(places["clip"])).encode(["the spleen"])[0]
    np.testing.assert_allclose(found, said / np.linalg.norm(said), atol=1e-5)
    assert len(vlm_models.TEMPLATES) > 1
    assert all(template.count("{}") == 1 for template in vlm_models.TEMPLATES)


def test_a_run_is_answered_in_the_captions_it_was_made_with_and_refuses_others(places, tmp_path, monkeypatch):
    encoder = encoder_at(str(places["clip"]))
    single, digest = encoder.name.split("+templates-")
    assert len(digest) == 8
    earlier = open_encoder(single, ["liver", "L_hook"], tmp_path, encoder)
    assert (earlier.name, earlier.classes) == (single, ("liver", "L_hook"))
    expected = captions(places["clip"], "a photo of a liver", "a photo of a L hook", "a photo of a ripe banana")
    np.testing.assert_allclose(earlier.encode(["foie", "hook", '"ripe banana"']), expected, atol=1e-5)
    assert open_encoder(encoder.name, [], tmp_path, encoder).name == encoder.name
    monkeypatch.setattr(vlm_models, "TEMPLATES", vlm_models.TEMPLATES[:-1])
    with pytest.raises(RunError, match=r"features of the text encoder 'clip-.*\+templates-.*', so 'clip-.*' cannot answer"):
        open_encoder(encoder.name, [], tmp_path, encoder_at(str(places["clip"])))


@pytest.mark.parametrize("mode", ["mean_tokens", "cls_token"])
def test_sentences_are_pooled_as_the_model_says_whatever_stands_beside_them(tmp_path, mode):
    encoder = encoder_at(str(write_sentences(tmp_path / "model", mode)))
    model = transformers.AutoModel.from_pretrained(tmp_path / "model")
    tokenizer = transformers.AutoTokenizer.from_pretrained(tmp_path / "model")

    def pooled(text: str) -> np.ndarray:
        with torch.no_grad():
            hidden = model(**tokenizer([text], return_tensors="pt")).last_hidden_state[0].numpy()
        vector = hidden[0] if mode == "cls_token" else hidden.mean(0)
        return vector / np.linalg.norm(vector)

    # the mean over the vocabulary is taken off: differences are left alone
    mean = np.mean([pooled(c.name) for c in encoder.vocabulary.concepts if not c.later], 0)
    for text in ("liver", "kidney parenchyma"):
        expected = pooled(text) - mean
        np.testing.assert_allclose(encoder.encode([text])[0], expected / np.linalg.norm(expected), atol=1e-4)


def test_a_run_of_a_tower_needs_it_no_more_and_refuses_another(places, tmp_path):
    encoder = encoder_at(str(places["sentences"])).with_classes(["liver", "foo"])
    save_encoder(encoder, tmp_path)
    kept = open_encoder(encoder.name, encoder.classes, tmp_path)
    np.testing.assert_allclose(kept.encode(["foie", "foo", "spleen"]), encoder.encode(["liver", "foo", "spleen"]), atol=1e-6)
    again = open_encoder(encoder.name, encoder.classes, tmp_path, encoder_at(str(places["sentences"])))
    np.testing.assert_allclose(again.encode(['"foo"']), encoder.encode(["foo"]), atol=1e-6)
    with pytest.raises(RunError, match=r"features of the text encoder 'sentence-.*', so 'clip-.*' cannot answer"):
        open_encoder(encoder.name, encoder.classes, tmp_path, encoder_at(str(places["clip"])))
    with pytest.raises(RunError, match="cannot answer"):
        open_encoder(encoder.name, encoder.classes, tmp_path, encoder_at(str(write_sentences(tmp_path / "other", seed=1))))


def test_what_is_no_tower_is_refused_in_one_sentence(places, tmp_path):
    with pytest.raises(DegenseError, match="neither a folder nor in your model cache"):
        encoder_at("somebody/something")
    with pytest.raises(DegenseError, match="which is not read"):
        encoder_at(str(write_sentences(tmp_path / "max", "max_tokens")))
    (places["sentences"] / "modules.json").rename(tmp_path / "modules.json")
    try:
        with pytest.raises(DegenseError, match="of the kind 'bert'"):
            encoder_at(str(places["sentences"]))
    finally:
        (tmp_path / "modules.json").rename(places["sentences"] / "modules.json")
    with pytest.raises(DegenseError, match="a clipseg, which has no text vectors"):
        encoder_at(str(write_model(tmp_path / "seg", "clipseg")))

"""CLIPs as open_clip publishes them: the same vectors as its computation gives, and a sentence for what is not read."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from degense.engine.errors import DegenseError
from degense.engine.semantics import open_encoder, save_encoder
from degense.engine.semantics.models.model_folder import find_model, is_open_clip, model_digest
from degense.engine.semantics.models.open_clip import read_open_clip
from degense.engine.semantics.models.vlm_models import DEVIATION, MEAN, DenseModel
from degense.engine.semantics.teachers import teacher_by_name, with_cached_targets
from degense.engine.semantics.teachers.vlm import VlmTeacher
from degense.engine.semantics.text.towers import encoder_at
from tests.fakes import MemoryClip
from tests.semantics.models.open_clip_models import CONFIG, CONTEXT, write_open_clip
from tests.semantics.models.tiny_models import write_model

CPU = torch.device("cpu")
LONG = "the " + "gallbladder " * CONTEXT
TEXTS = ("liver", "a photo of fat", LONG, "x", "an endoscopic image of the cystic duct")
WEIGHTS = "open_clip_model.safetensors"


def random_pictures(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (3, 34, 34, 3), dtype=np.uint8)


def normalised(pictures: np.ndarray, mean, deviation) -> torch.Tensor:
    return torch.from_numpy((pictures / 255 - np.array(mean)) / np.array(deviation)).permute(0, 3, 1, 2).float()


def rewrite(folder: Path, change) -> None:
    said = json.loads((folder / "open_clip_config.json").read_text())
    change(said)
    (folder / "open_clip_config.json").write_text(json.dumps(said))


@pytest.mark.parametrize(
    "options",
    [
        {"seed": 1},
        {"seed": 2, "quick_gelu": True},
        {"seed": 3, "own_text_tower": True},
        {"seed": 4, "quick_gelu": True, "own_text_tower": True},
        {"seed": 5, "dtype": torch.float16},
        {"seed": 6, "dtype": torch.bfloat16, "quick_gelu": True},
    ],
    ids=lambda options: "-".join(map(str, options.values())),
)
def test_vectors_are_those_of_open_clips_computation(options, tmp_path):
    there = write_open_clip(tmp_path / "model", **options)
    model = DenseModel(tmp_path / "model", CPU)
    assert (model.kind, model.side) == ("clip", 34)
    pictures = random_pictures(options["seed"])
    seen = normalised(pictures, CONFIG["preprocess_cfg"]["mean"], CONFIG["preprocess_cfg"]["std"])
    clip, _, _ = read_open_clip(tmp_path / "model")
    with torch.no_grad():
        expected = [there.visual(seen), there.visual.values(seen).reshape(3, 4, 4, 12), there.encode_text(TEXTS)]
        found = [clip.get_image_features(pixel_values=seen).pooler_output.numpy(), model.maps(pictures, []), model.texts(TEXTS)]
    for here, should in zip(found, expected, strict=True):
        assert here.dtype == np.float32
        assert np.abs(should.numpy()).max() > 0.1
        np.testing.assert_allclose(here, should, atol=1e-5, rtol=0)
    np.testing.assert_allclose(np.stack([model.texts([text])[0] for text in TEXTS]), expected[2], atol=1e-5, rtol=0)  # without padding
    assert clip.logit_scale.item() == pytest.approx(there.logit_scale.item())


def test_the_activation_is_the_configurations(folder):
    pictures = random_pictures(7)
    plain = DenseModel(folder, CPU)
    rewrite(folder, lambda said: said["model_cfg"].update(quick_gelu=True))
    quick = DenseModel(folder, CPU)
    assert np.abs(plain.maps(pictures, []) - quick.maps(pictures, [])).max() > 1e-3
    assert np.abs(plain.texts(TEXTS) - quick.texts(TEXTS)).max() > 1e-3
    assert plain.name != quick.name


def test_what_training_needed_and_what_is_not_said_change_nothing(tmp_path):
    there = write_open_clip(tmp_path / "model")

    def say_more(said):
        said["model_cfg"] |= {"custom_text": True, "init_logit_bias": None}
        said["model_cfg"]["vision_cfg"] |= {"patch_dropout": 0.5, "pool_type": "tok", "attentional_pool": False, "timm_pool": "avg"}
        said["model_cfg"]["text_cfg"] |= {"mlp_ratio": 4, "pool_type": "argmax", "proj_type": "linear", "hf_model_name": None, "pad_id": 0}
        said["preprocess_cfg"] = {"hf_hub": "someone/model"}

    rewrite(tmp_path / "model", say_more)
    tensors = load_file(tmp_path / "model" / WEIGHTS)
    save_file({**tensors, "logit_scale": tensors["logit_scale"].reshape(1)}, tmp_path / "model" / WEIGHTS)
    for name in ("tokenizer.json", "tokenizer_config.json"):  # vocab.json and merges.txt are left
        (tmp_path / "model" / name).unlink()
    model, pictures = DenseModel(tmp_path / "model", CPU), random_pictures(8)
    np.testing.assert_allclose(model.texts(TEXTS), there.encode_text(TEXTS), atol=1e-5, rtol=0)
    expected = there.visual.values(normalised(pictures, MEAN, DEVIATION)).reshape(3, 4, 4, 12)
    np.testing.assert_allclose(model.maps(pictures, []), expected, atol=1e-5, rtol=0)


def test_a_tokenizers_habits_do_not_matter(folder):
    plain = DenseModel(folder, CPU).texts(TEXTS)
    said = json.loads((folder / "tokenizer_config.json").read_text())
    said |= {"padding_side": "left", "truncation_side": "left", "pad_token": None, "tokenizer_class": "BertTokenizer"}
    (folder / "tokenizer_config.json").write_text(json.dumps(said))
    np.testing.assert_array_equal(DenseModel(folder, CPU).texts(TEXTS), plain)


def test_a_teacher_and_the_encoder_of_its_run(published, tmp_path):
    clip = MemoryClip(frames=4)
    teacher = teacher_by_name(f"vlm:{published}?scales=2", clip)
    vectors, index = with_cached_targets(teacher).targets(0)
    assert (vectors.shape[1], index.shape) == (12, (40, 48))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert teacher.encoder.name.startswith(f"clip-{model_digest(published)}+templates-")
    save_encoder(teacher.encoder, tmp_path)
    asked = open_encoder(teacher.encoder.name, clip.classes, tmp_path, encoder_at(str(published)))
    np.testing.assert_allclose(asked.encode(["gall bladder"]), teacher.encoder.encode(["gall bladder"]), atol=1e-5)
    write_open_clip(tmp_path / "other", seed=1)
    with pytest.raises(DegenseError, match="cannot answer its prompts"):
        open_encoder(teacher.encoder.name, clip.classes, tmp_path, encoder_at(str(tmp_path / "other")))


def test_which_of_two_forms_is_read(folder, tmp_path, monkeypatch):
    assert is_open_clip(folder)
    digest = model_digest(folder)
    (folder / "config.json").write_text(json.dumps({"architecture": "vit_base_patch32_clip_224"}))  # timm's
    save_file({"patch_embed.proj.weight": torch.ones(1)}, folder / "model.safetensors")
    assert DenseModel(folder, CPU).name == f"clip-{digest}"
    (folder / "config.json").write_text(json.dumps({"model_type": "clip"}))
    (folder / "model.safetensors").rename(folder / "pytorch_model.bin")
    assert DenseModel(folder, CPU).name == f"clip-{digest}"
    saved = write_model(tmp_path / "saved", "clip")
    name = DenseModel(saved, CPU).name
    shutil.copy(folder / "open_clip_config.json", saved)
    assert not is_open_clip(saved)
    assert DenseModel(saved, CPU).name == name

    import huggingface_hub

    monkeypatch.setattr(huggingface_hub, "snapshot_download", lambda place, local_files_only: str(folder) if local_files_only else None)
    assert VlmTeacher(MemoryClip(), "someone/plain-clip").model.name == f"clip-{digest}"
    (folder / "old.pt").touch()
    assert find_model(str(folder)) == folder


def test_a_digest_stays_what_it_was(tmp_path):
    (tmp_path / "config.json").write_bytes(b'{"model_type": "clip"}')
    (tmp_path / "model.safetensors").write_bytes(bytes(range(256)) * 9)
    assert model_digest(tmp_path) == "13fe4a52bfe4"

"""Vision-language models from local folders: tiny random ones, in the real classes and files."""

import json
import shutil
import sys

import numpy as np
import pytest
import torch

from degense.engine.errors import ClipError, DegenseError
from degense.engine.semantics.models.model_folder import find_model
from degense.engine.semantics.models.vlm_models import TEMPLATES, DenseModel
from degense.engine.semantics.teachers import teacher_by_name, teacher_choices, with_cached_targets
from degense.engine.semantics.teachers.vlm import VlmTeacher
from degense.engine.semantics.text.towers import encoder_at
from tests.fakes import MemoryClip
from tests.semantics.models.tiny_models import write_model


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    root = tmp_path_factory.mktemp("models")
    return {kind: write_model(root / kind, kind) for kind in ("clip", "siglip", "clipseg")}


def test_clip_gives_unit_features_in_the_space_of_its_own_text_vectors(models):
    import transformers

    teacher = VlmTeacher(MemoryClip(), str(models["clip"]), scales=2)
    [(frame, (vectors, index))] = teacher.compute([2])
    assert (frame, vectors.dtype, index.dtype, index.shape) == (2, np.float32, np.int32, (40, 48))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1, atol=1e-5)
    assert ((index >= 0) == MemoryClip().valid(2)).all()
    assert vectors.shape[1] == teacher.encoder.dimension == 12
    assert len(np.unique(vectors.round(4), axis=0)) > 30  # a vector a patch, at the finer scale

    tokenizer = transformers.AutoTokenizer.from_pretrained(str(models["clip"]), local_files_only=True)
    model = transformers.CLIPModel.from_pretrained(str(models["clip"]), local_files_only=True)
    with torch.no_grad():
        captions = [tokenizer([template.format("gallbladder")], return_tensors="pt") for template in TEMPLATES]
        told = np.stack([model.get_text_features(**caption).pooler_output[0].numpy() for caption in captions])
    told = (told / np.linalg.norm(told, axis=1, keepdims=True)).mean(0)
    np.testing.assert_allclose(teacher.encoder.encode(["gall bladder"])[0], told / np.linalg.norm(told), atol=1e-5)
    tower = encoder_at(str(models["clip"]))
    assert tower.name == teacher.encoder.name
    np.testing.assert_allclose(tower.encode(["gall bladder"]), teacher.encoder.encode(["gall bladder"]), atol=1e-5)


def test_siglip_is_asked_as_it_was_trained(models):
    """Texts padded to one length without a mask; of a picture of one patch alone the patch is the picture's own vector."""
    import transformers

    model = transformers.SiglipModel.from_pretrained(str(models["siglip"]), local_files_only=True).eval()
    tokenizer = transformers.AutoTokenizer.from_pretrained(str(models["siglip"]), local_files_only=True)
    ours = DenseModel(models["siglip"], torch.device("cpu"))
    padded = tokenizer(["a liver", "fat"], padding="max_length", max_length=77, return_tensors="pt")["input_ids"]
    with torch.no_grad():
        np.testing.assert_allclose(ours.texts(["a liver", "fat"]), model.get_text_features(padded).pooler_output.numpy(), atol=1e-5)
        head = model.vision_model.head
        seen = model.vision_model(pixel_values=torch.randn(1, 3, 32, 32)).last_hidden_state
        alone = torch.cat([head(seen[:, place : place + 1]) for place in range(16)])  # each patch pooled as the only one
    ours._model.vision_model.forward = lambda pixel_values: type("Seen", (), {"last_hidden_state": seen})
    np.testing.assert_allclose(ours.maps(np.zeros((1, 32, 32, 3), np.uint8), []).reshape(16, -1), alone.numpy(), atol=1e-5)
    teacher = VlmTeacher(MemoryClip(), str(models["siglip"]))
    assert teacher.encoder.dimension == encoder_at(str(models["siglip"])).dimension == 16


@pytest.mark.parametrize("kind", ["clip", "siglip"])
def test_patches_keep_their_place(models, kind):
    model = DenseModel(models[kind], torch.device("cpu"))
    pictures = np.full((2, 32, 32, 3), 90, np.uint8)
    pictures[1, 8:16, 16:24] = (250, 20, 20)  # patch (1, 2)
    plain, changed = model.maps(pictures, [])
    difference = np.linalg.norm(changed - plain, axis=-1)
    assert np.unravel_index(difference.argmax(), (4, 4)) == (1, 2)


def test_clipseg_looks_for_the_classes_by_name(models):
    clip = MemoryClip()
    clip.classes = ("background", "liver", "gallbladder")
    teacher = VlmTeacher(clip, str(models["clipseg"]))
    assert teacher.encoder.name == "embedded-surgical-1"
    [(_, (vectors, index))] = teacher.compute([0])
    own = teacher.encoder.encode(["liver", "gallbladder"])
    spoken = vectors[np.unique(index[index >= 0])]
    assert (spoken @ own.T).max(1).min() > 0.7  # mixtures of the two that it was asked for
    assert np.abs(spoken @ teacher.encoder.encode(["background"])[0]).max() < 0.2
    clip.classes = ("background",)
    with pytest.raises(ClipError, match="names no classes for CLIPSeg"):
        VlmTeacher(clip, str(models["clipseg"]))


def test_answers_are_kept_and_depend_on_the_model(models, tmp_path):
    clip = MemoryClip(frames=4)
    name = f"vlm:{models['clip']}?scales=2"
    first = teacher_by_name(name, clip)
    assert first.name == name
    kept = with_cached_targets(first)
    assert kept.targets(0) is not None
    again = teacher_by_name(name, clip)
    again.answers = lambda frames, progress: pytest.fail("asked again")
    with_cached_targets(again)
    other = write_model(tmp_path / "other", "clip")
    weights = other / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-4] + b"\0\0\0\0")
    assert VlmTeacher(clip, str(other)).settings["model"] != first.settings["model"]
    reasons = {choice.name: choice.reason for choice in teacher_choices(clip)}
    assert reasons["vlm"].startswith("a model must be named: the folder of a CLIP, SigLIP or CLIPSeg")


def test_what_cannot_be_read_is_one_sentence(models, tmp_path, monkeypatch):
    clip = MemoryClip()
    (tmp_path / "catseg").mkdir()
    (tmp_path / "catseg" / "model_final_cholecseg.pth").touch()
    (tmp_path / "open").mkdir()
    (tmp_path / "open" / "open_clip_config.json").write_text("{}")
    (tmp_path / "bert").mkdir()
    (tmp_path / "bert" / "config.json").write_text(json.dumps({"model_type": "bert"}))
    pickled = shutil.copytree(models["clip"], tmp_path / "pickled")
    (pickled / "model.safetensors").rename(pickled / "pytorch_model.bin")
    cases = {
        str(tmp_path / "catseg"): "pickled checkpoint .as of CAT-Seg or SurgVLP., which is not read; compute its features",
        "SurgVLP.pth": "pickled checkpoint",
        str(tmp_path / "open"): "of open_clip's models only a CLIP of a plain ViT is read; take the copy that transformers reads",
        str(tmp_path / "bert"): "kind 'bert'; those that can be read are clip, siglip, clipseg",
        str(pickled): "with model.safetensors",
        str(tmp_path / "nowhere"): "is no folder",
        "openai/no-such-model": "neither a folder nor in your model cache; download it first",
    }
    for place, words in cases.items():
        with pytest.raises(DegenseError, match=words):
            VlmTeacher(clip, place)
    for name in ("vlm", "vlm:x?scales=many", f"vlm:{models['clip']}?scales=99"):
        with pytest.raises(DegenseError, match=r"a model must be named|scales"):
            teacher_by_name(name, clip)
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(DegenseError, match=r"needs the package transformers; install it with: pip install 'degense\[vlm\]'"):
        VlmTeacher(clip, str(models["clip"]))


def test_a_model_in_the_users_cache_is_found_by_its_name(models, tmp_path, monkeypatch):
    import huggingface_hub

    monkeypatch.setattr(
        huggingface_hub, "snapshot_download", lambda place, local_files_only: str(models["clip"]) if local_files_only else None
    )
    assert find_model("someone/tiny-clip") == models["clip"]

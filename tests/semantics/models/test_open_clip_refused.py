"""What of open_clip's models is not read, damaged or absurd: a sentence each."""

import json
import pickle
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from degense.engine.errors import DegenseError
from degense.engine.semantics.models.model_folder import find_model
from degense.engine.semantics.models.vlm_models import DenseModel
from tests.semantics.models.open_clip_models import CONTEXT

CPU = torch.device("cpu")
LONG = "the " + "gallbladder " * CONTEXT
TEXTS = ("liver", "a photo of fat", LONG, "x", "an endoscopic image of the cystic duct")
WEIGHTS = "open_clip_model.safetensors"


def rewrite(folder: Path, change) -> None:
    said = json.loads((folder / "open_clip_config.json").read_text())
    change(said)
    (folder / "open_clip_config.json").write_text(json.dumps(said))


def find_and_read(folder: Path) -> DenseModel:
    return DenseModel(find_model(str(folder)), CPU)


@pytest.mark.parametrize(
    ("part", "option", "value"),
    [
        (None, "init_logit_bias", -10),
        (None, "multimodal_cfg", {"width": 768}),
        (None, "quick_gelu", "yes"),
        (None, "embed_dim", None),
        (None, "vision_cfg", None),
        ("vision_cfg", "timm_model_name", "convnext_base"),
        ("vision_cfg", "layers", [3, 4, 6, 3]),
        ("vision_cfg", "attentional_pool", True),
        ("vision_cfg", "ls_init_value", 1e-5),
        ("vision_cfg", "no_ln_pre", True),
        ("vision_cfg", "pool_type", "avg"),
        ("vision_cfg", "pos_embed_type", "sin_cos_2d"),
        ("vision_cfg", "final_ln_after_pool", True),
        ("vision_cfg", "qk_norm", True),
        ("vision_cfg", "act_kwargs", {"approximate": "tanh"}),
        ("vision_cfg", "never_heard_of", 1),
        ("vision_cfg", "image_size", [224, 112]),
        ("vision_cfg", "patch_size", 35),
        ("vision_cfg", "head_width", 48),
        ("vision_cfg", "mlp_ratio", 1e-3),
        ("vision_cfg", "layers", 10**9),
        ("vision_cfg", "layers", True),
        ("text_cfg", "hf_model_name", "roberta-base"),
        ("text_cfg", "hf_tokenizer_name", "bert-base-uncased"),
        ("text_cfg", "tokenizer_kwargs", {"clean": "canonicalize"}),
        ("text_cfg", "pool_type", "last"),
        ("text_cfg", "pool_type", None),
        ("text_cfg", "embed_cls", True),
        ("text_cfg", "no_causal_mask", True),
        ("text_cfg", "proj_bias", True),
        ("text_cfg", "proj_type", "none"),
        ("text_cfg", "norm_kwargs", {"eps": 1e-6}),
        ("text_cfg", "heads", 3),
        ("text_cfg", "context_length", 0),
        ("text_cfg", "vocab_size", 1 << 40),
    ],
)
def test_what_is_no_plain_clip_is_one_sentence(folder, part, option, value):
    rewrite(folder, lambda said: (said["model_cfg"][part] if part else said["model_cfg"]).update({option: value}))
    with pytest.raises(DegenseError, match=r"only a CLIP of a plain ViT is read; take the copy that transformers reads") as raised:
        find_and_read(folder)
    said = {"patch_size": "patch_size", "head_width": "width", "heads": "width", "mlp_ratio": ""}.get(option, option)
    assert said in str(raised.value)
    assert len(str(raised.value).removeprefix(str(folder))) < 400


@pytest.mark.parametrize("mean", [[0.5, 0.5], [0.5, 0.5, "x"], 0.5, [True] * 3])
def test_means_that_are_none(folder, mean):
    rewrite(folder, lambda said: said["preprocess_cfg"].update(mean=mean))
    with pytest.raises(DegenseError, match='says "mean"'):
        find_and_read(folder)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 10**30, 10**400])
def test_numbers_that_are_none(folder, number):
    rewrite(folder, lambda said: said["model_cfg"]["vision_cfg"].update(width=number))
    with pytest.raises(DegenseError, match=r"is not valid JSON \(.*number\)"):
        find_and_read(folder)


@pytest.mark.parametrize("text", ["", "{", "[1]", "[" * 100_000, '{"model_cfg": 3}', '{"model_cfg": {}, "preprocess_cfg": 3}', "{}"])
def test_configurations_that_say_nothing(folder, text):
    (folder / "open_clip_config.json").write_text(text)
    with pytest.raises(DegenseError, match=r"is not valid JSON|describes no model|only a CLIP of a plain ViT"):
        find_and_read(folder)


def test_a_deviation_of_zero_and_a_configuration_without_end(folder):
    rewrite(folder, lambda said: said["preprocess_cfg"].update(std=[0.2, 0, 0.2]))
    with pytest.raises(DegenseError, match='says "std"'):
        find_and_read(folder)
    with (folder / "open_clip_config.json").open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(DegenseError, match="larger than 16,777,216 bytes"):
        find_and_read(folder)


def respelt(change):
    """Spoils a folder's weights."""

    def spoil(folder: Path) -> None:
        tensors = load_file(folder / WEIGHTS)
        change(tensors)
        save_file(tensors, folder / WEIGHTS)

    return spoil


def truncated(folder: Path) -> None:
    (folder / WEIGHTS).write_bytes((folder / WEIGHTS).read_bytes()[:-100])


def pickled(folder: Path) -> None:
    (folder / WEIGHTS).unlink()
    (folder / "open_clip_pytorch_model.bin").write_bytes(pickle.dumps({}))


def smaller_vocabulary(folder: Path) -> None:
    rewrite(folder, lambda said: said["model_cfg"]["text_cfg"].update(vocab_size=53))


def untaught(folder: Path) -> None:
    for name in ("tokenizer.json", "vocab.json"):
        (folder / name).unlink()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (respelt(lambda held: held.pop("visual.proj")), "visual.proj is missing; download the model anew"),
        (respelt(lambda held: held.update({"logit_bias": torch.zeros(1)})), '"logit_bias" has no place in it'),
        (respelt(lambda held: held.update({"visual.proj": torch.zeros(12, 24)})), r"visual.proj is F32 \[12, 24\], not .* \[24, 12\]"),
        (respelt(lambda held: held.update({"ln_final.bias": torch.zeros(16, dtype=torch.int64)})), r"ln_final.bias is I64 \[16\]"),
        (respelt(lambda held: held.update({"ln_final.bias": torch.zeros(16, dtype=torch.float64)})), r"ln_final.bias is F64 \[16\]"),
        (respelt(lambda held: held.update({"text.ln_final.bias": held.pop("ln_final.bias")})), "ln_final.weight"),
        (lambda folder: rewrite(folder, lambda said: said["model_cfg"]["text_cfg"].update(layers=3)), "resblocks.2.* is missing"),
        (lambda folder: rewrite(folder, lambda said: said["model_cfg"]["vision_cfg"].update(layers=2)), "resblocks.2.* has no place"),
        (lambda folder: rewrite(folder, lambda said: said["model_cfg"]["vision_cfg"].update(image_size=1 << 18)), "positional_embedding"),
        (truncated, "is damaged or not a safetensors file; download it anew"),
        (lambda folder: (folder / WEIGHTS).write_bytes(pickle.dumps({"a": 1})), "is damaged or not a safetensors file"),
        (pickled, "holds no open_clip_model.safetensors but pickles, which are not read; download that file, or write it"),
        (lambda folder: (folder / WEIGHTS).unlink(), "holds no open_clip_model.safetensors; download that file"),
        (untaught, "lacks its tokenizer; put tokenizer.json, or vocab.json and merges.txt, beside the weights"),
        (lambda folder: (folder / "tokenizer.json").write_text("{"), "tokenizer that is damaged"),
        (lambda folder: (folder / "tokenizer.json").write_text("{}"), "tokenizer"),
        (smaller_vocabulary, "a tokenizer of 54 tokens, and its model is one of 53 of which the last ends a text"),
    ],
)
def test_what_is_damaged_is_one_sentence(folder, spoil, words):
    spoil(folder)
    with pytest.raises(DegenseError, match=words):
        find_and_read(folder)


def test_an_absurd_size_is_refused_before_it_is_made(folder):
    rewrite(folder, lambda said: said["model_cfg"]["vision_cfg"].update(width=1 << 18, head_width=1 << 10, layers=256, mlp_ratio=64))
    with pytest.raises(DegenseError, match=r"is not what open_clip_config\.json describes"):
        find_and_read(folder)

"""CLIPs as open_clip publishes them, read into transformers' `CLIPModel`: the same computation under other names.

The package open_clip is not needed, which needs a torchvision of the very build of PyTorch.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError
from degense.engine.semantics.models.model_folder import OPEN_CLIP_CONFIG, OPEN_CLIP_WEIGHTS, transformers_library
from degense.engine.semantics.models.open_clip_config import open_clip_config

#: Parts of transformers' names, and what open_clip calls them. `TEXT` stands for "text." where the text tower is a module of its own.
NAMES = {
    "vision_model.embeddings.class_embedding": "visual.class_embedding",
    "vision_model.embeddings.patch_embedding": "visual.conv1",
    "vision_model.embeddings.position_embedding.weight": "visual.positional_embedding",
    "vision_model.pre_layrnorm": "visual.ln_pre",
    "vision_model.encoder.layers": "visual.transformer.resblocks",
    "vision_model.post_layernorm": "visual.ln_post",
    "visual_projection.weight": "visual.proj",
    "text_model.embeddings.token_embedding": "TEXTtoken_embedding",
    "text_model.embeddings.position_embedding.weight": "TEXTpositional_embedding",
    "text_model.encoder.layers": "TEXTtransformer.resblocks",
    "text_model.final_layer_norm": "TEXTln_final",
    "text_projection.weight": "TEXTtext_projection",
    ".layer_norm1.": ".ln_1.",
    ".layer_norm2.": ".ln_2.",
    ".mlp.fc1.": ".mlp.c_fc.",
    ".mlp.fc2.": ".mlp.c_proj.",
    ".self_attn.out_proj.": ".attn.out_proj.",
    ".self_attn.q_proj.": ".attn.in_proj_",
    ".self_attn.k_proj.": ".attn.in_proj_",
    ".self_attn.v_proj.": ".attn.in_proj_",
}
STACKED = (".q_proj.", ".k_proj.", ".v_proj.")  # as in_proj, in this order
TRANSPOSED = ("visual_projection.weight", "text_projection.weight")
NUMBERS = ("F32", "F16", "BF16")


def read_open_clip(folder: Path) -> tuple[Any, Any, dict[str, Any]]:
    """`CLIPModel` in float32 on the CPU, `CLIPTokenizer`, and `image_mean` and `image_std` where they are known.

    The folder holds open_clip_config.json, open_clip_model.safetensors and a tokenizer's files. DegenseError in one sentence when one is
    missing, damaged or a pickle, or the model is no plain CLIP.
    """
    shape, preprocessing = open_clip_config(folder)
    transformers = transformers_library()
    tokenizer = _tokenizer(folder, shape["text_config"])
    config = transformers.CLIPConfig(**shape)
    with torch.device("meta"):  # names and shapes only
        wanted = {name: tuple(tensor.shape) for name, tensor in transformers.CLIPModel(config).state_dict().items()}
    weights = _renamed_weights(folder / OPEN_CLIP_WEIGHTS, wanted)
    model = transformers.CLIPModel.from_pretrained(None, config=config, state_dict=weights, dtype=torch.float32)
    return model, tokenizer, preprocessing


def _tokenizer(folder: Path, text: dict[str, Any]) -> Any:
    if not (folder / "tokenizer.json").exists() and not all((folder / name).exists() for name in ("vocab.json", "merges.txt")):
        raise DegenseError(f"{shown(folder)} lacks its tokenizer; put tokenizer.json, or vocab.json and merges.txt, beside the weights.")
    options = {"model_max_length": text["max_position_embeddings"], "padding_side": "right", "truncation_side": "right"}
    try:
        tokenizer = transformers_library().CLIPTokenizer.from_pretrained(str(folder), local_files_only=True, **options)
        tokenizer.pad_token = tokenizer.eos_token  # what follows the end is not looked at
        last = max(tokenizer.get_vocab().values())
    except Exception as error:  # of the package tokenizers, which has no class of its own for them
        raise DegenseError(f"{shown(folder)} holds a tokenizer that is damaged or no CLIP's; download the model anew.") from error
    if not tokenizer.eos_token_id == last == text["eos_token_id"]:
        raise DegenseError(
            f"{shown(folder)} holds a tokenizer of {last + 1} tokens, and its model is one of {text['vocab_size']} of which the last ends "
            "a text; put the model's own tokenizer beside the weights."
        )
    return tokenizer


def _renamed_weights(file: Path, wanted: Mapping[str, tuple[int, ...]]) -> dict[str, Tensor]:
    """The weights in open_clip's file, float32, under transformers' names and of the shapes `wanted` by name.

    Names and shapes are checked before any is read: DegenseError in one sentence when the file is missing or damaged, lacks a weight, or
    holds one of another name, shape or kind.
    """
    if not file.exists():
        pickled = " but pickles, which are not read" if any(file.parent.glob("open_clip_pytorch_model*")) else ""
        raise DegenseError(
            f"{shown(file.parent)} holds no {file.name}{pickled}; download that file, or write it with open_clip and safetensors."
        )
    try:
        with safe_open(str(file), framework="pt") as opened:
            parts = {name: opened.get_slice(name) for name in opened.keys()}  # noqa: SIM118 - a handle, not a dict
            prefix = "text." if any(name.startswith("text.") for name in parts) else ""
            sources = {name: _open_clip_name(name).replace("TEXT", prefix) for name in wanted}
            shapes = {sources[name]: _stored(name, shape) for name, shape in wanted.items()}
            held = {name: (part.get_dtype(), tuple(part.get_shape())) for name, part in parts.items()}
            if fault := _fault(held, shapes):
                raise DegenseError(f"{shown(file)} is not what {OPEN_CLIP_CONFIG} describes: {fault}; download the model anew.")
            tensors = {name: opened.get_tensor(name).float() for name in shapes}
    except (OSError, SafetensorError) as error:
        raise DegenseError(f"{shown(file)} is damaged or not a safetensors file; download it anew.") from error
    return {name: _taken(name, tensors[source]).reshape(wanted[name]) for name, source in sources.items()}


def _open_clip_name(name: str) -> str:
    for theirs, open_clips in NAMES.items():
        name = name.replace(theirs, open_clips)
    return name


def _stored(name: str, shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape in open_clip's file of what has this name and shape in transformers."""
    if any(part in name for part in STACKED):
        return 3 * shape[0], *shape[1:]
    return shape[::-1] if name in TRANSPOSED else shape


def _taken(name: str, tensor: Tensor) -> Tensor:
    """What has this name in transformers, of the tensor in open_clip's file that holds it."""
    for place, part in enumerate(STACKED):
        if part in name:
            return tensor.chunk(3)[place]
    return tensor.T if name in TRANSPOSED else tensor


def _fault(held: Mapping[str, tuple[str, tuple[int, ...]]], shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """What is wrong with the kinds and shapes that a file holds."""
    for name in sorted(held.keys() | shapes.keys()):
        if name not in held:
            return f"{name} is missing"
        kind, shape = held[name]
        if name not in shapes:
            return f"{json.dumps(name)[:80]} has no place in it"
        if kind not in NUMBERS or (shape or (1,)) != (shapes[name] or (1,)):  # a single number may be stored as a list of one
            return f"{name} is {kind} {list(shape)}, not floating-point numbers {list(shapes[name])}"
    return None

"""CLIPs as open_clip publishes them, read into transformers' `CLIPModel`: the same computation under other names.

The package open_clip is not needed, which needs a torchvision of the very build of PyTorch. Read is a plain CLIP of any size: a ViT and a
causal text transformer as OpenAI built them. Everything else that open_clip can build is refused, as is an option that is not known here:
it might change the computation.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError
from degense.engine.semantics.models.model_folder import OPEN_CLIP_CONFIG, OPEN_CLIP_WEIGHTS, read_config, transformers_library

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


Options = dict[str, Any]
#: Sizes, with open_clip's defaults.
VISION = {"image_size": 224, "patch_size": 16, "width": 768, "layers": 12, "head_width": 64, "mlp_ratio": 4.0}
TEXT = {"context_length": 77, "vocab_size": 49408, "width": 512, "layers": 12, "heads": 8, "mlp_ratio": 4.0}
MOST, MOST_LAYERS, WIDEST_MLP, BRIGHTEST = 1 << 18, 256, 64, 255
#: The plain values of options that name a way. All other options are plain where they are null, false, zero or empty.
PLAIN_VISION = {"pool_type": "tok", "pos_embed_type": "learnable"}
PLAIN_TEXT = {"pool_type": "argmax", "proj_type": "linear"}
#: Options of training, and those without effect unless another is set that is refused.
IDLE = re.compile(
    r"custom_text|init_logit_scale|nonscalar_logit_scale|patch_dropout|attn_pooler_\w+|pad_id|eos_id|timm_(?!model_name)\w+"
    r"|hf_(?!model_name|tokenizer_name)\w+"
)


def open_clip_config(folder: Path) -> tuple[Options, Options]:
    """The same as keyword arguments of transformers' `CLIPConfig`, and what is known of `image_mean` and `image_std`, three numbers each.

    DegenseError in one sentence for what is no plain CLIP or has impossible sizes.
    """
    config = read_config(folder / OPEN_CLIP_CONFIG)
    model, preprocessing = _typed(folder, config, "model_cfg", dict), config.get("preprocess_cfg") or {}
    activation = "quick_gelu" if _typed(folder, model, "quick_gelu", bool, False) else "gelu"
    vision = _sizes(folder, _typed(folder, model, "vision_cfg", dict), VISION, PLAIN_VISION)
    text = _sizes(folder, _typed(folder, model, "text_cfg", dict), TEXT, PLAIN_TEXT)
    rest = {name: value for name, value in model.items() if name not in ("quick_gelu", "vision_cfg", "text_cfg")}
    projection = _sizes(folder, rest, {"embed_dim": None}, {})["embed_dim"]
    if vision["patch_size"] > vision["image_size"]:
        raise _refusal(folder, "patch_size", vision["patch_size"])
    shape = {
        "projection_dim": projection,
        "vision_config": _transformer(folder, vision, vision["width"] // vision["head_width"], activation)
        | {"image_size": vision["image_size"], "patch_size": vision["patch_size"]},
        "text_config": _transformer(folder, text, text["heads"], activation)
        | {"max_position_embeddings": text["context_length"], "vocab_size": text["vocab_size"]}
        # a text's vector is that of its highest token, which ends it; the two tokens around a text are the vocabulary's last
        | {"bos_token_id": text["vocab_size"] - 2, "eos_token_id": text["vocab_size"] - 1},
    }
    return shape, _preprocessing(folder, preprocessing)


def _transformer(folder: Path, sizes: Options, heads: int, activation: str) -> Options:
    width, hidden = sizes["width"], int(sizes["width"] * sizes["mlp_ratio"])
    if heads < 1 or width % heads or hidden < 1:
        raise _refusal(folder, "width", width)
    return {
        "hidden_size": width,
        "intermediate_size": hidden,
        "num_hidden_layers": sizes["layers"],
        "num_attention_heads": heads,
        "hidden_act": activation,
        "layer_norm_eps": 1e-5,
    }


def _preprocessing(folder: Path, config: Any) -> Options:
    """Mean and deviation, where they are given."""
    if not isinstance(config, dict):
        raise _refusal(folder, "preprocess_cfg", config)
    given = {"image_mean": config.get("mean"), "image_std": config.get("std")}
    for name, values in given.items():
        numbers = isinstance(values, list) and len(values) == 3 and all(type(v) in (int, float) and abs(v) <= BRIGHTEST for v in values)
        if values is not None and not (numbers and (name == "image_mean" or min(values) > 0)):
            raise _refusal(folder, name.removeprefix("image_"), values)
    return {name: values for name, values in given.items() if values is not None}


def _sizes(folder: Path, part: Options, sizes: Mapping[str, Any], plain: Mapping[str, str]) -> Options:
    """The sizes of a part that has no option but plain ones."""
    for name, value in part.items():
        if name not in sizes and not IDLE.fullmatch(name) and (value != plain[name] if name in plain else value):
            raise _refusal(folder, name, value)
    found = {name: part.get(name, size) for name, size in sizes.items()}
    for name, value in found.items():
        if name == "mlp_ratio":
            possible = type(value) in (int, float) and 0 < value <= WIDEST_MLP
        else:
            possible = type(value) is int and 1 <= value <= (MOST_LAYERS if name == "layers" else MOST)
        if not possible:
            raise _refusal(folder, name, value)
    return found


def _typed(folder: Path, config: Options, name: str, kind: type, default: Any = None) -> Any:
    if not isinstance(value := config.get(name, default), kind):
        raise _refusal(folder, name, value)
    return value


def _refusal(folder: Path, name: str, value: Any) -> DegenseError:
    told = f"{json.dumps(name)[:60]}: {json.dumps(value)[:60]}"
    return DegenseError(
        f"{shown(folder / OPEN_CLIP_CONFIG)} says {told}, and of open_clip's models only a CLIP of a plain ViT is read; take the copy that "
        "transformers reads, or compute features with open_clip and train with --teacher precomputed:FOLDER."
    )

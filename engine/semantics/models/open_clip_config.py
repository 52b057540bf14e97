"""The configuration of a plain CLIP as open_clip publishes it: a ViT and a causal text transformer as OpenAI built them, of any size.

Everything else that open_clip can build is refused, as is an option that is not known here: it might change the computation.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError
from degense.engine.semantics.models.model_folder import OPEN_CLIP_CONFIG, read_config

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

"""CLIPs as open_clip publishes them, read into transformers' `CLIPModel`: the same computation under other names.

The package open_clip is not needed, which needs a torchvision of the very build of PyTorch.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError
from degense.engine.semantics.models.model_folder import OPEN_CLIP_WEIGHTS, transformers_library
from degense.engine.semantics.models.open_clip_config import open_clip_config
from degense.engine.semantics.models.open_clip_weights import renamed_weights


def read_open_clip(folder: Path) -> tuple[Any, Any, dict[str, Any]]:
    """The model in a folder with open_clip_config.json, open_clip_model.safetensors and a tokenizer's files.

    Returns
    -------
    model : transformers.CLIPModel
        In float32, on the CPU.
    tokenizer : transformers.CLIPTokenizer
    preprocessing : dict
        `image_mean` and `image_std`, where they are known.

    Raises
    ------
    DegenseError
        In one sentence, when a file is missing, damaged or a pickle, or the model is no plain CLIP.
    """
    shape, preprocessing = open_clip_config(folder)
    transformers = transformers_library()
    tokenizer = _tokenizer(folder, shape["text_config"])
    config = transformers.CLIPConfig(**shape)
    with torch.device("meta"):  # names and shapes only
        wanted = {name: tuple(tensor.shape) for name, tensor in transformers.CLIPModel(config).state_dict().items()}
    weights = renamed_weights(folder / OPEN_CLIP_WEIGHTS, wanted)
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

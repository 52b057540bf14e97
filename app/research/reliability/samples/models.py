"""Small random models as their authors save them, from which damaged ones are made: a CLIP in two forms, a SAM, a model of sentences."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from degense.engine.semantics.models.model_folder import OPEN_CLIP_CONFIG, OPEN_CLIP_WEIGHTS, transformers_library
from degense.engine.store.files import write_tensors

LETTERS = tuple("abcdefghijklmnopqrstuvwxyz")
START, END = "<|startoftext|>", "<|endoftext|>"
WORDS = {word: place for place, word in enumerate((*LETTERS, *(f"{letter}</w>" for letter in LETTERS), START, END))}
SIDE, PATCH, WIDTH, LAYERS, HEADS, HIDDEN, CONTEXT, VECTOR = 32, 8, 16, 2, 2, 32, 77, 12


def clip(folder: Path) -> Path:
    """As transformers saves it."""
    library, ends = transformers_library(), {"bos_token_id": WORDS[START], "eos_token_id": WORDS[END]}
    text = {**_sizes(), **ends, "vocab_size": len(WORDS), "max_position_embeddings": CONTEXT}
    shape = {"text_config": text, "vision_config": {**_sizes(), "image_size": SIDE, "patch_size": PATCH}, "projection_dim": VECTOR}
    _saved(library.CLIPModel, library.CLIPConfig(**shape), folder)
    _tokenizer(folder)
    _write(folder / "preprocessor_config.json", {"image_mean": [0.5, 0.4, 0.3], "image_std": [0.3, 0.2, 0.2]})
    return folder


def open_clip(folder: Path) -> Path:
    """As open_clip publishes it."""
    sizes = {"width": WIDTH, "layers": LAYERS}
    vision = {**sizes, "image_size": SIDE, "patch_size": PATCH, "head_width": WIDTH // HEADS, "mlp_ratio": HIDDEN / WIDTH}
    text = {**sizes, "context_length": CONTEXT, "vocab_size": len(WORDS), "heads": HEADS, "mlp_ratio": HIDDEN / WIDTH}
    _tokenizer(folder)
    _write(folder / OPEN_CLIP_CONFIG, {"model_cfg": {"embed_dim": VECTOR, "vision_cfg": vision, "text_cfg": text}, "preprocess_cfg": {}})
    shapes: dict[str, tuple[int, ...]] = {
        "visual.class_embedding": (WIDTH,),
        "visual.conv1.weight": (WIDTH, 3, PATCH, PATCH),
        "visual.positional_embedding": ((SIDE // PATCH) ** 2 + 1, WIDTH),
        "visual.proj": (WIDTH, VECTOR),
        "positional_embedding": (CONTEXT, WIDTH),
        "token_embedding.weight": (len(WORDS), WIDTH),
        "text_projection": (WIDTH, VECTOR),
        "logit_scale": (),
    }
    for norm in ("visual.ln_pre", "visual.ln_post", "ln_final"):
        shapes |= {f"{norm}.weight": (WIDTH,), f"{norm}.bias": (WIDTH,)}
    for block in (f"{tower}transformer.resblocks.{layer}" for tower in ("visual.", "") for layer in range(LAYERS)):
        shapes |= {f"{block}.{norm}.{part}": (WIDTH,) for norm in ("ln_1", "ln_2") for part in ("weight", "bias")}
        shapes |= {f"{block}.attn.in_proj_weight": (3 * WIDTH, WIDTH), f"{block}.attn.in_proj_bias": (3 * WIDTH,)}
        shapes |= {f"{block}.attn.out_proj.weight": (WIDTH, WIDTH), f"{block}.attn.out_proj.bias": (WIDTH,)}
        shapes |= {f"{block}.mlp.c_fc.weight": (HIDDEN, WIDTH), f"{block}.mlp.c_fc.bias": (HIDDEN,)}
        shapes |= {f"{block}.mlp.c_proj.weight": (WIDTH, HIDDEN), f"{block}.mlp.c_proj.bias": (WIDTH,)}
    write_tensors(folder / OPEN_CLIP_WEIGHTS, _random(shapes))
    return folder


def sam(folder: Path) -> Path:
    """As transformers saves it."""
    library, layers = (
        transformers_library(),
        {"hidden_size": WIDTH, "num_hidden_layers": LAYERS, "num_attention_heads": HEADS, "mlp_dim": 24},
    )
    patches = {"image_size": SIDE, "patch_size": 16}
    vision = {**layers, **patches, "output_channels": WIDTH, "window_size": 1, "global_attn_indexes": [1], "num_pos_feats": 8}
    prompts = {**patches, "hidden_size": WIDTH, "image_embedding_size": 2, "mask_input_channels": 4}
    decoder = {**layers, "iou_head_hidden_dim": WIDTH}
    config = library.SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder)
    return _saved(library.SamModel, config, folder)


def sentences(folder: Path) -> Path:
    """As sentence-transformers saves it: a BERT of letters."""
    library = transformers_library()
    words = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", *LETTERS, *(f"##{letter}" for letter in LETTERS)]
    folder.mkdir(parents=True)
    (folder / "vocab.txt").write_text("\n".join(words) + "\n", encoding="utf-8")
    library.BertTokenizer(str(folder / "vocab.txt")).save_pretrained(folder)
    _saved(library.BertModel, library.BertConfig(vocab_size=len(words), max_position_embeddings=40, **_sizes()), folder)
    modules = ("Transformer", "Pooling", "Normalize")
    _write(folder / "modules.json", [{"idx": place, "type": f"sentence_transformers.models.{name}"} for place, name in enumerate(modules)])
    _write(folder / "1_Pooling" / "config.json", {"word_embedding_dimension": WIDTH, "pooling_mode_mean_tokens": True})
    return folder


def _sizes() -> dict[str, int]:
    return {"hidden_size": WIDTH, "intermediate_size": HIDDEN, "num_hidden_layers": LAYERS, "num_attention_heads": HEADS}


def _saved(model: Any, config: Any, folder: Path) -> Path:
    torch.manual_seed(0)
    model(config).save_pretrained(folder)
    return folder


def _tokenizer(folder: Path) -> None:
    _write(folder / "vocab.json", WORDS)
    (folder / "merges.txt").write_text("#version: 0.2\n", encoding="utf-8")
    tokenizer = transformers_library().CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=CONTEXT)
    tokenizer.save_pretrained(folder)


def _random(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, torch.Tensor]:
    torch.manual_seed(0)
    return {name: 0.2 * torch.randn(shape) for name, shape in shapes.items()}


def _write(path: Path, value: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value), encoding="utf-8")

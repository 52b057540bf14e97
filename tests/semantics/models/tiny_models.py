"""Tiny random models in the real classes and file formats of transformers."""

from __future__ import annotations

import json
from pathlib import Path

import torch

LETTERS = [chr(code) for code in range(ord("a"), ord("z") + 1)]
START, END = "<|startoftext|>", "<|endoftext|>"
VOCABULARY = {word: i for i, word in enumerate([*LETTERS, *(letter + "</w>" for letter in LETTERS), START, END])}
TEXT = {
    "hidden_size": 16,
    "intermediate_size": 24,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "vocab_size": len(VOCABULARY),
    "max_position_embeddings": 77,
    "bos_token_id": VOCABULARY[START],
    "eos_token_id": VOCABULARY[END],
}
VISION = {"hidden_size": 16, "intermediate_size": 24, "num_hidden_layers": 3, "num_attention_heads": 2, "image_size": 32, "patch_size": 8}


def write_tokenizer(folder: Path) -> None:
    """The files of CLIP's tokenizer, of letters only."""
    import transformers

    (folder / "vocab.json").write_text(json.dumps(VOCABULARY))
    (folder / "merges.txt").write_text("#version: 0.2\n")
    tokenizer = transformers.CLIPTokenizer(str(folder / "vocab.json"), str(folder / "merges.txt"), model_max_length=77)
    tokenizer.save_pretrained(folder)


def write_model(folder: Path, kind: str) -> Path:
    """A `clip`, `siglip` or `clipseg` as its authors publish it: configuration, weights in safetensors, tokenizer, preprocessing."""
    import transformers

    transformers.utils.logging.disable_progress_bar()
    folder.mkdir()
    write_tokenizer(folder)
    (folder / "preprocessor_config.json").write_text(json.dumps({"image_mean": [0.5, 0.4, 0.3], "image_std": [0.3, 0.2, 0.2]}))
    torch.manual_seed(0)
    shape = {"text_config": TEXT, "vision_config": VISION, "projection_dim": 12}
    if kind == "clip":
        transformers.CLIPModel(transformers.CLIPConfig(**shape)).save_pretrained(folder)
    elif kind == "siglip":
        transformers.SiglipModel(transformers.SiglipConfig(text_config=TEXT, vision_config=VISION)).save_pretrained(folder)
    else:
        decoder = {"reduce_dim": 8, "extract_layers": [0, 1, 2], "decoder_num_attention_heads": 2, "decoder_intermediate_size": 16}
        transformers.CLIPSegForImageSegmentation(transformers.CLIPSegConfig(**shape, **decoder)).save_pretrained(folder)
    return folder


def write_sam(folder: Path) -> Path:
    """A `SamModel` as its authors publish it, tiny and random."""
    import transformers

    transformers.utils.logging.disable_progress_bar()
    vision = {"hidden_size": 16, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 32, "patch_size": 16}
    vision |= {"output_channels": 16, "mlp_dim": 24, "window_size": 1, "global_attn_indexes": [1], "num_pos_feats": 8}
    prompts = {"hidden_size": 16, "image_size": 32, "patch_size": 16, "image_embedding_size": 2, "mask_input_channels": 4}
    decoder = {"hidden_size": 16, "mlp_dim": 24, "num_attention_heads": 2, "iou_head_hidden_dim": 16}
    torch.manual_seed(0)
    config = transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompts, mask_decoder_config=decoder)
    transformers.SamModel(config).save_pretrained(folder)
    return folder

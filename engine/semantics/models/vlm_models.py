"""Vision-language models from a local folder, or from the cache that the user's own downloads filled; nothing is ever downloaded.

Read: CLIP (`CLIPModel`), SigLIP and SigLIP 2 of a fixed size (`SiglipModel`), and CLIPSeg (`CLIPSegForImageSegmentation`) as `transformers`
saves them, and CLIP with a plain ViT as open_clip publishes it (`open_clip_config.json`), weights in safetensors. Where a folder holds both
forms, the one of transformers is read.
Not read: other models of open_clip (timm's and Hugging Face's towers, ResNets, CoCa), CAT-Seg's `model_final*.pth` (a detectron2
checkpoint) and SurgVLP's `SurgVLP.pth`, pickles of other programs. Features that such a model computed can be read from files
(`precomputed`).

A wording is asked for in several sentences: a CLIP is trained on captions, and averaging removes what one of them adds.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError
from degense.engine.semantics.basis import unit_rows
from degense.engine.semantics.models.model_folder import (
    brightness,
    is_open_clip,
    model_config,
    model_digest,
    read_config,
    saved_by_transformers,
)
from degense.engine.semantics.models.open_clip import read_open_clip
from degense.engine.semantics.models.tokens import tokenized

Embed = Callable[[Sequence[str]], np.ndarray]
#: The one of CLIPSeg, and of runs whose encoder's name has no digest of templates.
PLAIN = "a photo of a {}"
#: Names are things and stuff ("grasper", "fat"), so not all of these have an article. Other templates are another encoder.
TEMPLATES = (
    PLAIN,
    "a photo of {}",
    "a close-up photo of the {}",
    "a laparoscopic image of {}",
    "an endoscopic image of the {}",
    "{} seen through an endoscope",
    "{} during minimally invasive surgery",
    "a frame of a surgical video that shows the {}",
)


def template_encoders(model: str, embed: Embed) -> dict[str, Embed]:
    """Text encoders of a CLIP, words → unit vectors float [n, D], by name: in `TEMPLATES` first, then as earlier runs used it.

    A word has the normalised mean of its unit vectors in all templates, of which the name has a digest. `embed` turns sentences into
    vectors float [n, D] of any length but zero.
    """
    digest = hashlib.sha256("\n".join(TEMPLATES).encode()).hexdigest()[:8]
    return {f"{model}+templates-{digest}": _mean_over(TEMPLATES, embed), model: _mean_over((PLAIN,), embed)}


def _mean_over(templates: Sequence[str], embed: Embed) -> Embed:
    def encode(words: Sequence[str]) -> np.ndarray:
        vectors = unit_rows(embed([template.format(word) for word in words for template in templates]))
        return unit_rows(vectors.reshape(len(words), len(templates), -1).mean(1))

    return encode


#: Mean and deviation of the pictures that CLIP was trained on, where the model's own folder does not say.
MEAN, DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
#: Of transformers, by the kind of a model.
CLASSES = {"clip": "CLIPModel", "siglip": "SiglipModel", "clipseg": "CLIPSegForImageSegmentation"}
BATCH, SENTENCES = 8, 64  # pictures and sentences that are asked at once


class DenseModel:
    """A model that maps square pictures of `side` pixels to one vector a patch.

    Of the kinds "clip" and "siglip" it gives features in the space of its text vectors, of "clipseg" a logit for each of some wordings. The
    `name` is the kind and a digest of configuration and weights. DegenseError in one sentence when transformers is missing or the folder
    holds no model that can be read.
    """

    def __init__(self, folder: Path, device: torch.device):
        if is_open_clip(folder):
            self.kind, (model, self._tokenizer, preprocessing) = "clip", read_open_clip(folder)
        else:
            self.kind = str(model_config(folder).get("model_type"))
            model, self._tokenizer, preprocessing = _read(folder, self.kind)
        self._model, self._device = model.eval().requires_grad_(False).to(device), device
        self.side = int(model.config.vision_config.image_size)
        self.name = f"{self.kind}-{model_digest(folder)}"
        self._mean, self._deviation = (values.to(device) for values in brightness(folder, preprocessing, MEAN, DEVIATION))

    @property
    def has_text_vectors(self) -> bool:
        """Whether its features lie in the space of text vectors of its own."""
        return self.kind != "clipseg"

    @torch.no_grad()
    def maps(self, pictures: np.ndarray, wordings: Sequence[str]) -> np.ndarray:
        """Of square RGB pictures uint8 [n, side, side, 3]: features float32 [n, h, w, D], or of CLIPSeg a logit a wording [n, h, w, k]."""
        out = []
        for first in range(0, len(pictures), BATCH):
            batch = torch.from_numpy(pictures[first : first + BATCH]).to(self._device).permute(0, 3, 1, 2).float() / 255
            batch = (batch - self._mean) / self._deviation
            made = self._logits(batch, wordings) if self.kind == "clipseg" else self._patches(batch)
            out.append(made.float().cpu().numpy())
        return np.concatenate(out)

    def _patches(self, pictures: Tensor) -> Tensor:
        """Projected value vectors of the last attention, which keep their place as its output does not (Zhou et al., ECCV 2022).

        In a SigLIP that is the attention which pools all patches: each goes through its head as if it were the only one.
        """
        tower = self._model.vision_model
        if self.kind == "siglip":
            head = tower.head
            weight, bias = (part.chunk(3)[2] for part in (head.attention.in_proj_weight, head.attention.in_proj_bias))  # of the values
            seen = tower(pixel_values=pictures).last_hidden_state
            pooled = head.attention.out_proj(torch.nn.functional.linear(seen, weight, bias))
            return self._placed(pooled + head.mlp(head.layernorm(pooled)))
        before = tower(pixel_values=pictures, output_hidden_states=True).hidden_states[-2]
        last = tower.encoder.layers[-1]
        values = last.self_attn.out_proj(last.self_attn.v_proj(last.layer_norm1(before)))
        return self._placed(self._model.visual_projection(tower.post_layernorm(values))[:, 1:])

    @staticmethod
    def _placed(patches: Tensor) -> Tensor:
        rows = round(patches.shape[1] ** 0.5)
        return patches.reshape(len(patches), rows, rows, -1)

    def _logits(self, pictures: Tensor, wordings: Sequence[str]) -> Tensor:
        tokens = self._tokens([PLAIN.format(wording) for wording in wordings])
        made = []
        for picture in pictures:
            several = picture[None].expand(len(wordings), -1, -1, -1)
            made.append(self._model(pixel_values=several, **tokens).logits.reshape(len(wordings), self.side, self.side))
        return torch.stack(made).permute(0, 2, 3, 1)

    @torch.no_grad()
    def texts(self, sentences: Sequence[str]) -> np.ndarray:
        """Text vectors, float32 [n, D], not of unit length."""
        rows = []
        for first in range(0, len(sentences), SENTENCES):
            pooled = self._model.text_model(**self._tokens(sentences[first : first + SENTENCES])).pooler_output
            vectors = pooled if self.kind == "siglip" else self._model.text_projection(pooled)  # a SigLIP's text model projects itself
            rows.append(vectors.float().cpu().numpy())
        return np.concatenate(rows)

    def _tokens(self, sentences: Sequence[str]) -> dict[str, Tensor]:
        config = self._model.config
        if self.kind == "siglip":  # trained on texts of one length, whose padding it attends to
            length = int(config.text_config.max_position_embeddings)
            tokens = tokenized(self._tokenizer, sentences, config, ("input_ids",), padding="max_length", max_length=length)
        else:
            tokens = tokenized(self._tokenizer, sentences, config, ("input_ids", "attention_mask"), padding=True)
        return {name: values.to(self._device) for name, values in tokens.items()}


def _read(folder: Path, kind: str) -> tuple[Any, Any, dict[str, Any]]:
    """Model, tokenizer, and what the folder says of preprocessing. DegenseError in one sentence when there is none of this kind."""
    if kind not in CLASSES:
        raise DegenseError(f"{shown(folder)} holds a model of the kind {kind!r}; those that can be read are {', '.join(CLASSES)}.")
    model, tokenizer = saved_by_transformers(folder, kind, CLASSES[kind])
    preprocessing = folder / "preprocessor_config.json"
    return model, tokenizer, read_config(preprocessing) if preprocessing.exists() else {}


OVERLAP = 0.25  # of a tile's side that neighbours share at least


def tiled(rgb: np.ndarray, side: int, scales: int, model: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The feature map float32 [h', w', C] of a frame uint8 [H, W, 3], averaged over tiles and scales, as fine as the finest tiles' maps.

    Tiles are as high as the frame, then half as high, a third, …, down to 1 / `scales`. The model takes pictures uint8 [n, side, side, 3]
    and gives float32 [n, h, w, C].
    """
    height, width = rgb.shape[:2]
    total = weight = None
    for scale in range(scales, 0, -1):
        boxes = _boxes(height, width, scale)
        pictures = [
            cv2.resize(rgb[y : y + s, x : x + s], (side, side), interpolation=cv2.INTER_AREA if s > side else cv2.INTER_CUBIC)
            for y, x, s in boxes
        ]
        maps = model(np.stack(pictures))
        if total is None or weight is None:
            cell = boxes[0][2] / maps.shape[1]  # pixels of the frame
            shape = max(1, round(height / cell)), max(1, round(width / cell))
            total, weight = np.zeros((*shape, maps.shape[-1]), np.float32), np.zeros(shape, np.float32)
        rows, columns = total.shape[:2]
        for (y, x, s), values in zip(boxes, maps, strict=True):
            top, bottom = round(y / height * rows), max(round((y + s) / height * rows), round(y / height * rows) + 1)
            left, right = round(x / width * columns), max(round((x + s) / width * columns), round(x / width * columns) + 1)
            fitted = [cv2.resize(channel, (right - left, bottom - top)) for channel in np.moveaxis(values, -1, 0)]
            total[top:bottom, left:right] += np.stack(fitted, -1)
            weight[top:bottom, left:right] += 1
    assert total is not None
    assert weight is not None
    return total / weight[..., None]


def _boxes(height: int, width: int, scale: int) -> list[tuple[int, int, int]]:
    """(top, left, side) of square tiles that cover a frame, spread evenly."""
    side = max(1, min(height, width) // scale)
    tops, lefts = _starts(height, side), _starts(width, side)
    return [(top, left, side) for top in tops for left in lefts]


def _starts(length: int, side: int) -> list[int]:
    count = 1 if length == side else int(np.ceil((length - side) / (side * (1 - OVERLAP)))) + 1
    return [round(place) for place in np.linspace(0, length - side, count)]

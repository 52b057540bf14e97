"""A plain CLIP as open_clip computes it and publishes it, written anew in PyTorch: what its reading is held against."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file
from torch import Tensor, nn

from tests.semantics.models.tiny_models import END, START, VOCABULARY, write_tokenizer

CONTEXT = 80  # more than the tokenizer's own files say
CONFIG: dict[str, Any] = {
    "model_cfg": {
        "embed_dim": 12,
        # the last rows and columns of a picture are in no patch
        "vision_cfg": {"image_size": 34, "layers": 3, "width": 24, "head_width": 8, "mlp_ratio": 1.7, "patch_size": 8},
        "text_cfg": {"context_length": CONTEXT, "vocab_size": len(VOCABULARY), "width": 16, "heads": 2, "layers": 2},
    },
    "preprocess_cfg": {"mean": [0.5, 0.4, 0.3], "std": [0.3, 0.2, 0.25], "interpolation": "bicubic", "resize_mode": "squash"},
}


class QuickGelu(nn.Module):
    def forward(self, x: Tensor) -> Tensor:
        return x * torch.sigmoid(1.702 * x)


class Block(nn.Module):
    def __init__(self, width: int, heads: int, hidden: int, activation: type[nn.Module]):
        super().__init__()
        self.ln_1, self.attn, self.ln_2 = nn.LayerNorm(width), nn.MultiheadAttention(width, heads, batch_first=True), nn.LayerNorm(width)
        layers = {"c_fc": nn.Linear(width, hidden), "gelu": activation(), "c_proj": nn.Linear(hidden, width)}
        self.mlp = nn.Sequential(OrderedDict(layers))

    def forward(self, x: Tensor, mask: Tensor | None) -> Tensor:
        y = self.ln_1(x)
        x = x + self.attn(y, y, y, need_weights=False, attn_mask=mask)[0]
        return x + self.mlp(self.ln_2(x))


class Transformer(nn.Module):
    def __init__(self, layers: int, *block: Any):
        super().__init__()
        self.resblocks = nn.ModuleList(Block(*block) for _ in range(layers))

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        for block in self.resblocks:
            x = block(x, mask)
        return x


class Visual(nn.Module):
    def __init__(self, said: dict[str, Any], dimension: int, activation: type[nn.Module]):
        super().__init__()
        width, patch = said["width"], said["patch_size"]
        self.conv1 = nn.Conv2d(3, width, patch, patch, bias=False)
        self.class_embedding = nn.Parameter(torch.zeros(width))
        self.positional_embedding = nn.Parameter(torch.zeros((said["image_size"] // patch) ** 2 + 1, width))
        self.ln_pre, self.ln_post = nn.LayerNorm(width), nn.LayerNorm(width)
        self.transformer = Transformer(said["layers"], width, width // said["head_width"], int(width * said["mlp_ratio"]), activation)
        self.proj = nn.Parameter(torch.zeros(width, dimension))

    def embedded(self, pictures: Tensor) -> Tensor:
        x = self.conv1(pictures).flatten(2).transpose(1, 2)
        x = torch.cat([self.class_embedding.expand(len(x), 1, -1), x], 1) + self.positional_embedding
        return self.ln_pre(x)

    def forward(self, pictures: Tensor) -> Tensor:
        return self.ln_post(self.transformer(self.embedded(pictures))[:, 0]) @ self.proj

    def values(self, pictures: Tensor) -> Tensor:
        """The last layer's projected values, a vector a patch."""
        x, last = self.embedded(pictures), self.transformer.resblocks[-1]
        for block in self.transformer.resblocks[:-1]:
            x = block(x, None)
        width = x.shape[-1]
        values = last.ln_1(x) @ last.attn.in_proj_weight[2 * width :].T + last.attn.in_proj_bias[2 * width :]
        return (self.ln_post(last.attn.out_proj(values)) @ self.proj)[:, 1:]


class OpenClip(nn.Module):
    """Of random weights, norms included. Its state is named as open_clip's."""

    def __init__(self, model: dict[str, Any]):
        super().__init__()
        activation: type[nn.Module] = QuickGelu if model.get("quick_gelu") else nn.GELU
        text = model["text_cfg"]
        self.visual = Visual(model["vision_cfg"], model["embed_dim"], activation)
        self.transformer = Transformer(text["layers"], text["width"], text["heads"], 4 * text["width"], activation)
        self.token_embedding = nn.Embedding(text["vocab_size"], text["width"])
        self.positional_embedding = nn.Parameter(torch.zeros(text["context_length"], text["width"]))
        self.ln_final = nn.LayerNorm(text["width"])
        self.text_projection = nn.Parameter(torch.zeros(text["width"], model["embed_dim"]))
        self.logit_scale = nn.Parameter(torch.tensor(2.6))
        for name, parameter in self.named_parameters():
            nn.init.normal_(parameter, mean=float("ln_" in name and name.endswith("weight")), std=0.2)
        self.eval().requires_grad_(False)

    def encode_text(self, texts: Sequence[str]) -> Tensor:
        """Vectors [n, D] of texts of letters and spaces."""
        tokens = torch.zeros(len(texts), len(self.positional_embedding), dtype=torch.long)  # padded with zeros
        for row, text in zip(tokens, texts, strict=True):
            spelt = [VOCABULARY[letter] for word in text.split() for letter in [*word[:-1], word[-1] + "</w>"]]
            spelt = [VOCABULARY[START], *spelt[: len(row) - 2], VOCABULARY[END]]
            row[: len(spelt)] = torch.tensor(spelt)
        mask = torch.full((tokens.shape[1],) * 2, -torch.inf).triu(1)
        x = self.ln_final(self.transformer(self.token_embedding(tokens) + self.positional_embedding, mask))
        return x[torch.arange(len(x)), tokens.argmax(1)] @ self.text_projection


def write_open_clip(
    folder: Path,
    *,
    quick_gelu: bool = False,
    own_text_tower: bool = False,
    dtype: torch.dtype = torch.float32,
    seed: int = 0,
) -> OpenClip:
    """A model in a folder, as its authors publish it on the hub, and the same model in memory."""
    folder.mkdir()
    write_tokenizer(folder)
    config = {**CONFIG, "model_cfg": {**CONFIG["model_cfg"], "quick_gelu": quick_gelu, "custom_text": own_text_tower}}
    (folder / "open_clip_config.json").write_text(json.dumps(config))
    torch.manual_seed(seed)
    model = OpenClip(config["model_cfg"]).to(dtype)
    state = {name: tensor.contiguous() for name, tensor in model.state_dict().items()}
    if own_text_tower:
        state = {name if name.startswith(("visual.", "logit")) else f"text.{name}": tensor for name, tensor in state.items()}
    save_file(state, folder / "open_clip_model.safetensors")
    return model.float()

"""Masks that a SAM proposes for a frame, without a prompt: what lies together, whatever it is called.

As its authors propose masks (Kirillov et al., "Segment Anything", ICCV 2023): a grid of points is asked, each for three masks; those that
the model holds for bad or that depend on where their logits are cut go, and of masks that are about the same the best one stays.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError, is_out_of_memory, what_is_wrong
from degense.engine.semantics.models.model_folder import brightness, from_transformers, model_config, model_digest, read_config

POINTS = 16  # along each side of the grid
ASKED = 64  # points at once
QUALITY, STABILITY, SHIFT = 0.88, 0.95, 1.0  # the least of both, and by how much logits are cut above and below for the second
SAME = 0.7  # intersection over union from which two masks are one
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)  # of pictures, where the model's own folder does not say


class MaskProposals:
    """A SAM as transformers saves it (`SamModel`), from a local folder.

    `name` is its kind and a digest. DegenseError in one sentence when transformers is missing or the folder holds no SAM.
    """

    def __init__(self, folder: Path, device: torch.device):
        if (kind := model_config(folder).get("model_type")) != "sam":
            raise DegenseError(f"{shown(folder)} holds a model of the kind {kind!r}; regions are proposed by a SAM (SamModel).")
        model = from_transformers(folder, "SAM with model.safetensors", "SamModel", use_safetensors=True)
        preprocessing = folder / "preprocessor_config.json"
        values = read_config(preprocessing) if preprocessing.exists() else {}
        self._model: Any = model.eval().requires_grad_(False).to(device)
        self._mean, self._deviation = (three.to(device) for three in brightness(folder, values, MEAN, DEVIATION))
        self._side, self._device, self._folder = int(model.config.vision_config.image_size), device, folder
        self.name = f"sam-{model_digest(folder)}"

    @torch.no_grad()
    def __call__(self, rgb: np.ndarray) -> np.ndarray:
        """Masks of a frame uint8 [H, W, 3], the largest first, bool [n, H, W]; n may be 0."""
        height, width = rgb.shape[:2]
        scale = self._side / max(height, width)
        inner = max(1, round(height * scale)), max(1, round(width * scale))
        small = torch.from_numpy(cv2.resize(rgb, inner[::-1], interpolation=cv2.INTER_AREA)).to(self._device).permute(2, 0, 1).float()
        picture = torch.zeros(1, 3, self._side, self._side, device=self._device)
        picture[0, :, : inner[0], : inner[1]] = (small / 255 - self._mean) / self._deviation
        place = (torch.arange(POINTS, device=self._device) + 0.5) / POINTS
        points = torch.stack(torch.meshgrid(place * inner[1], place * inner[0], indexing="xy"), -1).reshape(-1, 1, 2)
        try:
            embedded = self._model.get_image_embeddings(picture)
            found, scores = zip(*(self._asked(embedded, some, inner) for some in points.split(ASKED)), strict=True)
        except Exception as error:  # whatever parts of a damaged model that do not fit each other lead to
            if is_out_of_memory(error):
                raise
            raise DegenseError(f"{shown(self._folder)} holds no SAM that proposes masks: {what_is_wrong(error)}") from error
        kept = distinct(torch.cat(found), torch.cat(scores))
        masks = np.zeros((len(kept), height, width), bool)
        for mask, logits in zip(masks, kept, strict=True):
            mask[:] = cv2.resize(logits.cpu().numpy(), (width, height)) > 0
        masks = masks[masks.any((1, 2))]
        return masks[np.argsort(-masks.sum((1, 2)), kind="stable")]

    def _asked(self, embedded: Tensor, points: Tensor, inner: tuple[int, int]) -> tuple[Tensor, Tensor]:
        """Logits [n, h, w], without padding, of the good and stable masks that some points [P, 1, 2] give, and their quality [n]."""
        labels = torch.ones(1, len(points), 1, dtype=torch.long, device=self._device)
        made = self._model(image_embeddings=embedded, input_points=points[None], input_labels=labels, multimask_output=True)
        logits, quality = made.pred_masks[0].flatten(0, 1).float(), made.iou_scores[0].flatten().float()
        rows, columns = (max(1, round(part / self._side * logits.shape[-1])) for part in inner)
        logits = logits[:, :rows, :columns]
        inside, around = ((logits > cut).sum((1, 2)) for cut in (SHIFT, -SHIFT))
        good = (quality > QUALITY) & (inside > STABILITY * around)
        return logits[good], quality[good]


def distinct(logits: Tensor, quality: Tensor) -> Tensor:
    """Of masks, logits float [n, h, w], those that no better one is about the same as, the best first."""
    kept: list[int] = []
    masks = (logits > 0).flatten(1).float()
    areas = masks.sum(1)
    for k in quality.argsort(descending=True).tolist():
        both = masks[kept] @ masks[k]
        if areas[k] > 0 and not bool((both > SAME * (areas[kept] + areas[k] - both)).any()):
            kept.append(k)
    return logits[kept]

"""Votes of appearance: colour and texture around a pixel of each class, learned anew from the corrected frames for every propagation."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from torch import nn

from degense.engine.threads import one_torch_thread

#: Pixels of each class and corrected frame to learn from.
SAMPLES = 1500
WIDTH, STEPS, BATCH, RATE, SMOOTHING = 32, 300, 2048, 1e-2, 0.1


class AppearanceVotes:
    """A small network from the surroundings of a pixel to its class.

    Learned from frames, uint8 [H, W, 3], and their labels, int64 [H, W], 0 … count − 1.
    """

    def __init__(self, pictures: Sequence[np.ndarray], labels: Sequence[np.ndarray], count: int, seed: int = 0):
        inputs, targets = _samples(pictures, labels, count, np.random.default_rng(seed))
        self._mean, self._spread = inputs.mean(0), inputs.std(0) + 1e-6
        self._present = np.bincount(targets, minlength=count) > 0
        with one_torch_thread():
            self._network = _fitted((inputs - self._mean) / self._spread, targets, count, seed)

    @torch.no_grad()
    def at(self, rgb: np.ndarray) -> np.ndarray:
        """Probabilities of the classes, float32 [H, W, count]; 0 for classes that no corrected frame has."""
        x = torch.from_numpy((surroundings(rgb) - self._mean) / self._spread)
        with one_torch_thread():
            scores = self._network(x)
        scores[:, ~torch.from_numpy(self._present)] = -torch.inf
        return torch.softmax(scores, 1).numpy().reshape(*rgb.shape[:2], -1)


def surroundings(rgb: np.ndarray) -> np.ndarray:
    """Of each pixel of a picture uint8 [H, W, 3]: CIELAB colour at three scales, contrast and edges at two, float32 [H · W, 13]."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / np.float32(255), cv2.COLOR_RGB2LAB)
    light = np.ascontiguousarray(lab[..., 0])
    maps = [channel for sigma in (0.7, 2, 5) for channel in cv2.split(cv2.GaussianBlur(lab, (0, 0), sigma))]
    for sigma in (1.5, 4):
        mean = cv2.GaussianBlur(light, (0, 0), sigma)
        maps.append(np.sqrt(np.maximum(cv2.GaussianBlur(light * light, (0, 0), sigma) - mean * mean, 0)))
    for sigma in (1, 2.5):
        smooth = cv2.GaussianBlur(light, (0, 0), sigma)
        maps.append(np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)))
    return np.stack(maps, -1).reshape(-1, len(maps))


def _samples(
    pictures: Sequence[np.ndarray], labels: Sequence[np.ndarray], count: int, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Surroundings float32 [n, 13] and classes int64 [n] of some pixels of each class in each picture."""
    inputs, targets = [], []
    for rgb, wanted in zip(pictures, labels, strict=True):
        around, flat = surroundings(rgb), wanted.ravel()
        for index in range(count):
            places = np.flatnonzero(flat == index)
            if len(places):
                chosen = random.choice(places, min(SAMPLES, len(places)), replace=False)
                inputs.append(around[chosen])
                targets.append(np.full(len(chosen), index))
    return np.concatenate(inputs), np.concatenate(targets)


def _fitted(inputs: np.ndarray, targets: np.ndarray, count: int, seed: int) -> nn.Module:
    x, y = torch.from_numpy(inputs), torch.from_numpy(targets)
    counts = torch.bincount(y, minlength=count).float()
    weights = torch.where(counts > 0, counts.clamp_min(1) ** -0.5, 0)  # rare classes count more, but not as much as common ones
    loss = nn.CrossEntropyLoss(weight=weights / weights.sum() * (counts > 0).sum(), label_smoothing=SMOOTHING)
    with torch.random.fork_rng(devices=[]), torch.enable_grad():
        torch.manual_seed(seed)
        network = nn.Sequential(nn.Linear(x.shape[1], WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, count))
        optimizer = torch.optim.AdamW(network.parameters(), lr=RATE, weight_decay=1e-3)
        for step in range(STEPS):
            for group in optimizer.param_groups:
                group["lr"] = RATE * (1 - step / STEPS) + RATE / 100
            batch = torch.randint(len(x), (BATCH,))
            optimizer.zero_grad(set_to_none=True)
            loss(network(x[batch]), y[batch]).backward()
            optimizer.step()
    return network.requires_grad_(False)

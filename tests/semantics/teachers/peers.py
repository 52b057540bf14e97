"""Feature files as the peers write them, made from label maps."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch

DIMENSION = 20


def class_vectors(names, seed=0):
    """A vector for each name, float32 [n, D], of unit length; any two differ."""
    drawn = np.random.default_rng(seed).normal(size=(len(names), DIMENSION))
    return (np.linalg.qr(drawn.T)[0].T if len(names) <= DIMENSION else drawn).astype(np.float32)


def cells(labels, vectors, rows, columns):
    """Mean of the pixels' vectors in each cell, float32 [rows, columns, D]."""
    dense = vectors[labels]
    return np.stack([cv2.resize(dense[..., i], (columns, rows), interpolation=cv2.INTER_AREA) for i in range(dense.shape[-1])], -1)


def langsplat(folder: Path, name: str, labels: np.ndarray, vectors: np.ndarray) -> None:
    """`NAME_s.npy` [4, H, W] and `NAME_f.npy` [N, D]: level 2 holds the classes, level 0 takes everything for one of them."""
    segments = np.full((4, *labels.shape), -1, np.int32)
    segments[0] = 0
    segments[2] = labels + 1
    segments[2, :2] = -1
    np.save(folder / f"{name}_s.npy", segments)
    np.save(folder / f"{name}_f.npy", np.concatenate([vectors[:1], vectors]).astype(np.float16))


def agg(folder: Path, name: str, labels: np.ndarray, vectors: np.ndarray) -> None:
    """`NAME_agg.npy` [1, D, h, w], square whatever the frame's shape, vectors of any length."""
    np.save(folder / f"{name}_agg.npy", 3 * np.moveaxis(cells(labels, vectors, 24, 24), -1, 0)[None])


def feature3dgs(folder: Path, name: str, labels: np.ndarray, vectors: np.ndarray) -> None:
    """`NAME_fmap_CxHxW.pt` [D, h, w]."""
    height, width = labels.shape
    dense = np.moveaxis(cells(labels, vectors, height // 2, width // 2), -1, 0)
    torch.save(torch.from_numpy(np.ascontiguousarray(dense)).half(), folder / f"{name}_fmap_CxHxW.pt")


def plain(folder: Path, name: str, labels: np.ndarray, vectors: np.ndarray) -> None:
    """`NAME.npy` [h, w, D]."""
    height, width = labels.shape
    np.save(folder / f"{name}.npy", cells(labels, vectors, height // 2, width // 2))


WRITERS = {"langsplat": langsplat, "agg": agg, "feature-3dgs": feature3dgs, "plain": plain}

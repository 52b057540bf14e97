"""Models and features of teachers: models as transformers and open_clip save them, features in arrays, cached targets, text vectors."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch

from degense.app.research.reliability import samples
from degense.app.research.reliability.readers.reader import Reader, under
from degense.app.research.reliability.samples import models
from degense.engine.data.readers import open_clip
from degense.engine.semantics.models.mask_proposals import MaskProposals
from degense.engine.semantics.models.model_folder import read_config
from degense.engine.semantics.models.vlm_models import DenseModel
from degense.engine.semantics.teachers.precomputed import PrecomputedTeacher
from degense.engine.semantics.teachers.target_cache import CachedTeacher
from degense.engine.semantics.text.text_vectors import TextVectors, write_vectors
from degense.engine.semantics.text.towers import encoder_at

LENGTH = 8


def teacher_readers() -> list[Reader]:
    """Models only where transformers is installed, without which none is read."""
    features = ("**/features/*",)
    found = [
        Reader("features of a teacher", _segment_features, _use_features, features),
        Reader("features of a teacher, torch", _torch_features, _use_features, ("**/*.pt",)),
        Reader("cached targets", _cached, _use_cached),
        Reader("text vectors", _vectors, lambda path: TextVectors.read(path).with_classes(samples.CLASSES[:1])),
        Reader("model configuration", _config, read_config),
    ]
    if importlib.util.find_spec("transformers") is not None:
        parts = ("**/*.safetensors", "**/*config.json", "**/*")  # a tokenizer has the most files
        found += [
            Reader("model clip", under(models.clip), _use_model, parts),
            Reader("model open_clip", under(models.open_clip), _use_model, parts),
            Reader("model sam", under(models.sam), _use_sam, parts),
            Reader("model of sentences", under(models.sentences), _use_sentences, parts),
        ]
    return found


def _clip_with_vectors(folder: Path) -> Path:
    clip = samples.phantom(folder / "input")
    (clip / "features").mkdir()
    names = json.loads((clip / "classes.json").read_text(encoding="utf-8"))["classes"]
    rng = np.random.default_rng(0)
    write_vectors(clip / "features" / "text_vectors.safetensors", {name: rng.normal(size=LENGTH) for name in names}, "sample")
    return clip


def _segment_features(folder: Path) -> Path:
    """Features of a frame's segments beside a clip."""
    clip = _clip_with_vectors(folder)
    np.save(clip / "features" / "000000_s.npy", np.maximum(samples.label_map(3), 1)[None].astype(np.int32) % 3)
    np.save(clip / "features" / "000000_f.npy", np.random.default_rng(1).normal(size=(3, LENGTH)).astype(np.float32))
    return clip


def _torch_features(folder: Path) -> Path:
    """A map of features that torch saved."""
    clip = _clip_with_vectors(folder)
    torch.save(torch.ones(LENGTH, samples.HEIGHT // 4, samples.WIDTH // 4), clip / "features" / "000000_fmap_CxHxW.pt")
    return clip


def _use_features(path: Path) -> None:
    PrecomputedTeacher(open_clip(path), path / "features").targets(0)


def _cached(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    np.savez_compressed(folder / "000000.npz", vectors=rng.normal(size=(3, LENGTH)).astype(np.float16), index=samples.label_map(3) % 3)
    return folder


def _use_cached(path: Path) -> None:
    costly: Any = SimpleNamespace(name="sample", provenance="sample", frames=[0], encoder=None, pixelwise=False)
    CachedTeacher(costly, path).targets(0)


def _vectors(folder: Path) -> Path:
    rng = np.random.default_rng(0)
    write_vectors(folder / "vectors.safetensors", {name: rng.normal(size=16) for name in samples.CLASSES}, "sample")
    return folder / "vectors.safetensors"


def _config(folder: Path) -> Path:
    text = {"model_type": "clip", "text_config": {"hidden_size": 32, "layers": 2}, "vision_config": {"image_size": 32}}
    (folder / "config.json").write_text(json.dumps(text), encoding="utf-8")
    return folder / "config.json"


def _use_model(path: Path) -> None:
    """Words and a frame of zeros, as a training asks it."""
    model = DenseModel(path, torch.device("cpu"))
    model.texts(samples.CLASSES)
    model.maps(np.zeros((1, model.side, model.side, 3), np.uint8), samples.CLASSES)


def _use_sam(path: Path) -> None:
    MaskProposals(path, torch.device("cpu"))(np.zeros((*samples.SHAPE, 3), np.uint8))


def _use_sentences(path: Path) -> None:
    encoder_at(str(path)).with_classes(samples.CLASSES).encode(["liver"])

"""The run folder: everything a training leaves behind, and nothing executable."""

from __future__ import annotations

import json
import os
import platform
from dataclasses import dataclass
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.errors import RunError, what_is_wrong
from degense.engine.field import FieldConfig, SceneModel
from degense.engine.field.model import CANONICAL
from degense.engine.files import make_folder
from degense.engine.semantics import Basis
from degense.engine.store.files import finite, read_json, read_tensors, write_json, write_tensors
from degense.engine.store.migrations import current_tensors, existing_file
from degense.engine.store.run_info import check_info, plane_numbers

FORMAT = 1
LABEL_SUPPORT = "label_support.safetensors"
MAX_FRAMES, MAX_GAUSSIANS, MAX_SIDE = 1_000_000, 10_000_000, 16_384


class LabelSupport(NamedTuple):
    """What the labelled frames of a sparse teacher show (`engine.training.semantic.label_support`)."""

    shown: torch.Tensor  # float32 [N] in [0, 1]; how much of each Gaussian they show
    familiar: torch.Tensor  # float32 [N] in [0, 1]; in which share of its pixels a Gaussian looks like what they show
    frames: list[int]


@dataclass
class Run:
    """A run folder. `info` is what `run.json` says: config, field, clip, cameras, classes, encoder, teacher, provenance, unit, versions,
    hardware, state, figures."""

    path: Path
    info: dict[str, Any]

    @classmethod
    def create(cls, path: Path, clip: Clip, info: dict[str, Any]) -> Run:
        """Make the folder and write `run.json`. RunError when it already holds a run."""
        if (path / "run.json").exists():
            raise RunError(f"{path} already holds a run; choose another folder or resume it")
        if path.exists() and any(path.iterdir()):
            raise RunError(f"{path} is not empty and not a run; choose another folder")
        try:
            for folder in (path, path / "checkpoints", path / "previews"):
                make_folder(folder)
        except OSError as error:
            raise RunError(f"{path} cannot be made: {error.strerror}") from error
        run = cls(
            path,
            {
                "format": FORMAT,
                "created": datetime.now(timezone.utc).isoformat(timespec="seconds"),
                "state": "training",
                "versions": {name: version(name) for name in ("degense", "torch", "numpy", "gsplat")},
                "hardware": hardware(),
                "cameras": cameras_to_json(clip.cameras),
                "fps": clip.fps,
                "unit_name": clip.unit,
                "classes": list(clip.classes),
                "provenance": clip.provenance,
                **info,
            },
        )
        run.save()
        return run

    @classmethod
    def open(cls, path: Path | str) -> Run:
        """Open an existing run folder. RunError in one sentence when it is missing, damaged or from a newer version."""
        path = Path(path)
        try:
            is_folder = path.is_dir()
        except OSError as error:
            raise RunError(f"{path} cannot be read: {error.strerror}") from error
        if not is_folder:
            raise RunError(f"{path} is not a folder; a run is a folder with a run.json in it")
        info = read_json(path / "run.json")
        if not isinstance(info, dict) or not isinstance(info.get("format"), int):
            raise RunError(f"{path / 'run.json'} was not written by degense")
        if info["format"] > FORMAT:
            raise RunError(f"{path} was written by a newer degense (format {info['format']}, this one reads {FORMAT}); update to open it")
        check_info(info, path / "run.json")
        return cls(path, info)

    def save(self) -> None:
        write_json(self.path / "run.json", self.info)

    def log(self, values: dict[str, Any]) -> None:
        """Append one line to `metrics.jsonl`."""
        with (self.path / "metrics.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(values) + "\n")

    @property
    def cameras(self) -> list[Camera]:
        """One camera a frame, at the clip's size, in the clip's unit."""
        return cameras_from_json(self.info["cameras"], self.path / "run.json")

    def save_model(self, model: SceneModel) -> None:
        write_tensors(self.path / "model.safetensors", dict(model.state_dict()))

    def load_model(self, device: torch.device | str = "cpu") -> SceneModel:
        """The trained scene. RunError when the file does not fit its configuration."""
        path = self.path / "model.safetensors"
        if not path.exists():
            raise RunError(
                f"{self.path} holds no finished model (its training is {self.info['state']}); "
                f"resume it with degense train CLIP --out {self.path} --resume"
            )
        return build_model(self.info["field"], current_tensors(finite(read_tensors(path), path)), path).to(device)

    def save_observability(self, observability: torch.Tensor) -> None:
        """Keep the share [N] of its frames in which each Gaussian's displacement is revealed (`engine.training.flow.observability`)."""
        write_tensors(self.path / "observability.safetensors", {"observability": observability})

    def load_observability(self, count: int) -> torch.Tensor | None:
        """Motion observability of the `count` Gaussians of the model, float32 [N] in [0, 1]; None for a run that kept none."""
        path = existing_file(self.path, "observability.safetensors")
        if not path.exists():
            return None
        shares = current_tensors(finite(read_tensors(path), path)).get("observability", torch.empty(0))
        if shares.dtype != torch.float32 or shares.shape != (count,) or not bool(((shares >= 0) & (shares <= 1)).all()):
            raise RunError(f"{path} does not hold {count} numbers from 0 to 1, one for each Gaussian; delete it to open the run without it")
        return shares

    def save_label_support(self, support: LabelSupport) -> None:
        """Keep what the labelled frames of a sparse teacher show."""
        frames = torch.tensor(support.frames, dtype=torch.int64)
        write_tensors(self.path / LABEL_SUPPORT, {"shown": support.shown, "familiar": support.familiar, "frames": frames})

    def load_label_support(self, count: int) -> LabelSupport | None:
        """What `save_label_support` kept of the `count` Gaussians of the model; None without."""
        path = self.path / LABEL_SUPPORT
        if not path.exists():
            return None
        tensors = finite(read_tensors(path), path)
        shown, familiar, frames = (tensors.get(name, torch.empty(0)) for name in ("shown", "familiar", "frames"))
        sound = all(
            shares.dtype == torch.float32 and shares.shape == (count,) and bool(((shares >= 0) & (shares <= 1)).all())
            for shares in (shown, familiar)
        )
        known = frames.dtype == torch.int64 and frames.ndim == 1 and 0 < len(frames) <= len(self.cameras)
        if not (sound and known and bool(((frames >= 0) & (frames < len(self.cameras))).all())):
            raise RunError(f"{path} does not hold what the labelled frames show of {count} Gaussians; delete it to open the run without it")
        return LabelSupport(shown, familiar, frames.tolist())

    def save_basis(self, basis: Basis) -> None:
        write_tensors(
            self.path / "basis.safetensors",
            {name: torch.from_numpy(np.ascontiguousarray(value)) for name, value in basis.arrays().items()},
        )

    def load_basis(self) -> Basis | None:
        """The basis of the semantic latents; None for a run without semantics."""
        path = self.path / "basis.safetensors"
        if not self.info["field"]["rank"]:
            return None
        try:
            return Basis.from_arrays({name: tensor.numpy() for name, tensor in finite(read_tensors(path), path).items()})
        except (KeyError, ValueError) as error:
            raise RunError(f"{path} is damaged: {error}") from error


def build_model(field: dict[str, Any], tensors: dict[str, torch.Tensor], path: Path) -> SceneModel:
    """A SceneModel from its configuration and tensors, checked against each other. RunError names `path`."""
    if not {"bounds", *(f"canonical.{name}" for name in CANONICAL)} <= set(tensors):
        raise RunError(f"{path} lacks the canonical Gaussians; it is damaged or not a model of ours")
    canonical = {name: tensors[f"canonical.{name}"] for name in CANONICAL}
    try:
        if (count := len(canonical["means"])) > MAX_GAUSSIANS:
            raise RunError(f"{path} claims {count} Gaussians; at most {MAX_GAUSSIANS} are read")
        config = FieldConfig.from_json(field)
        if plane_numbers(config) > sum(tensor.numel() for tensor in tensors.values()):
            raise RunError(f"{path} is too small for the planes in run.json; one of them is damaged")
        model = SceneModel(config, tensors["bounds"], canonical)
        moving, still, semantic_coefficients = (tensors.pop(name, None) for name in ("moving", "still", "semantic_coefficients"))
        model.load_state_dict(tensors)
        if moving is not None:
            model.set_moving(moving)
        if still is not None:
            model.set_still(still)
        if semantic_coefficients is not None:
            model.set_semantic_coefficients(semantic_coefficients)
    except (TypeError, ValueError, KeyError, RuntimeError) as error:
        raise RunError(f"{path} does not fit the configuration in run.json: {str(error).splitlines()[0]}") from error
    return model


def cameras_to_json(cameras: list[Camera]) -> dict[str, Any]:
    first = cameras[0]
    static = all(camera is first or np.array_equal(camera.viewmat, first.viewmat) for camera in cameras)
    return {
        **{name: getattr(first, name) for name in ("width", "height", "fx", "fy", "cx", "cy")},
        "count": len(cameras),
        "viewmats": [camera.viewmat.tolist() for camera in (cameras[:1] if static else cameras)],
    }


def cameras_from_json(values: dict[str, Any], path: Path) -> list[Camera]:
    try:
        count, viewmats = int(values["count"]), np.asarray(values["viewmats"], np.float64)
        width, height = int(values["width"]), int(values["height"])
        fx, fy, cx, cy = (float(values[name]) for name in ("fx", "fy", "cx", "cy"))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RunError(f"{path}: the cameras cannot be read ({what_is_wrong(error)})") from error
    sane = 1 <= count <= MAX_FRAMES and 1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and np.isfinite([fx, fy, cx, cy]).all()
    if not sane or viewmats.shape not in ((1, 4, 4), (count, 4, 4)) or not np.isfinite(viewmats).all():
        raise RunError(f"{path}: the cameras make no sense; the file is damaged")
    distinct = [Camera(width, height, fx, fy, cx, cy, viewmat) for viewmat in viewmats]
    return distinct * count if len(distinct) == 1 else distinct


def hardware() -> dict[str, Any]:
    """What a reader of figures must know of the machine."""
    gpu = torch.cuda.get_device_name(0) if torch.cuda.is_available() else None
    return {"machine": platform.machine(), "system": platform.system(), "cores": os.cpu_count(), "gpu": gpu}

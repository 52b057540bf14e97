"""Pictures whose cameras COLMAP has found: `images/` and a sparse model in `sparse/0/`, `sparse/` or `colmap/sparse/0/`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.colmap_model import read_sparse
from degense.engine.data.files.numbered import shown
from degense.engine.data.files.posed_frames import PosedFrame, open_posed
from degense.engine.errors import ClipError

PLACES = ("sparse/0", "sparse", "colmap/sparse/0")


def is_colmap(folder: Path) -> bool:
    """Whether a folder has pictures and a sparse model, and no cameras of another layout."""
    others = any((folder / name).exists() for name in ("camera.json", "poses_bounds.npy"))
    return (folder / "images").is_dir() and _model_folder(folder) is not None and not others


def _model_folder(folder: Path) -> Path | None:
    places = (folder / place for place in PLACES)
    return next((place for place in places if (place / "images.bin").is_file() or (place / "images.txt").is_file()), None)


def open_colmap(path: Path, options: ClipOptions) -> Clip:
    """Open the pictures that the model has poses of. ClipError when they, or it, cannot be read."""
    folder = _model_folder(path)
    if folder is None:
        raise ClipError(f"{shown(path)} holds no sparse model ({' or '.join(PLACES)} with images.bin or images.txt).")
    model = read_sparse(folder, path)
    frames = [PosedFrame(path / "images" / name, viewmat, model.lenses[lens]) for name, (viewmat, lens) in model.pictures.items()]
    depths = [model.points @ frame.viewmat[2, :3] + frame.viewmat[2, 3] for frame in frames[:1] if len(model.points)]
    ahead = np.concatenate(depths)[np.concatenate(depths) > 0] if depths else np.zeros(0)
    nearness = float(np.median(ahead)) if len(ahead) else None
    return open_posed(path, frames, folder / ("images.bin" if (folder / "images.bin").exists() else "images.txt"), options, nearness)

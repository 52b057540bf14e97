"""The masks of prompts over a clip, as a folder that can be gone on with: label maps, one mask for each prompt, areas over time."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.features.inspect.curves import table_of
from degense.app.features.viewer.layer_images import write_png
from degense.engine.data.files.images import read_index
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.progress import Steps
from degense.engine.untrusted import read_json

if TYPE_CHECKING:
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet

ASKED = "query.json"


def write_clip_masks(scene: Scene, prompts: PromptSet, frames: Sequence[int], out: Path) -> Steps[dict[str, np.ndarray]]:
    """Answer prompts on frames of a clip, into a folder. Returns the areas float64 [frames] of every prompt.

    `labels/NNNNNN.png` (8-bit index into `classes.json`, 255 where no mask is; of overlapping masks the most similar), as clips have them;
    `masks/KK-PROMPT/NNNNNN.png` (255 in the mask); `areas.csv` (share of the frame). A frame whose files are there is not asked again, if
    `query.json` says that the same was asked of the same run. DegenseError if a prompt is not understood, or the folder holds anything
    else.
    """
    from degense.engine.scene.clip_query import encode_prompts, query_clip

    if len({text.casefold() for text in prompts.prompts}) < len(prompts.prompts):
        raise DegenseError("A prompt is given twice; give each once.")
    encode_prompts(scene, prompts)  # what is not understood is said before anything is written
    _claim(out, _identity(scene, prompts))
    folders = [out / "masks" / folder_name(number, text) for number, text in enumerate(prompts.prompts, 1)]
    write_text(out / "classes.json", json.dumps({"classes": list(prompts.prompts)}, ensure_ascii=False))
    areas = {frame: _areas(folders, frame) for frame in frames if _label_file(out, frame).is_file()}
    left = [frame for frame in frames if frame not in areas]
    yield 1 - len(left) / len(frames), "drawing"
    for frame, found in query_clip(scene, prompts, left):
        for folder, mask in zip(folders, found.masks, strict=True):
            write_png(folder / _file(frame), mask.astype(np.uint8) * 255)
        write_png(_label_file(out, frame), found.labels)  # last: it says that the frame is whole
        areas[frame] = found.areas
        yield len(areas) / len(frames), f"frame {frame}"
    table = {text: np.array([areas[frame][index] for frame in frames]) for index, text in enumerate(prompts.prompts)}
    write_text(out / "areas.csv", table_of({"frame": np.asarray(frames), **table}))
    return table


def _file(frame: int) -> str:
    return f"{frame:06d}.png"


def _label_file(out: Path, frame: int) -> Path:
    return out / "labels" / _file(frame)


def folder_name(number: int, text: str) -> str:
    """A prompt as a folder's name: `02-liver`."""
    plain = re.sub(r"\W+", "-", text).strip("-")[:40].lower()
    return f"{number:02d}-{plain or 'prompt'}"


def _identity(scene: Scene, prompts: PromptSet) -> dict[str, Any]:
    """What must be the same for masks to go together."""
    digest = hashlib.sha256((scene.run.path / "model.safetensors").read_bytes()).hexdigest()[:16]
    asked: dict[str, Any] = {"prompts": list(prompts.prompts), "negatives": list(prompts.negatives)}
    asked |= {"decoder": prompts.decoder, "threshold": prompts.threshold}
    return {"run": scene.name, "model": digest, "size": list(scene.clip_size), **asked}


def _claim(out: Path, identity: dict[str, Any]) -> None:
    """Make the folder this query's own. DegenseError when it holds anything else."""
    if out.is_dir() and any(out.iterdir()):
        try:
            found = read_json(out / ASKED, 1 << 20)
        except (OSError, ValueError) as error:
            raise DegenseError(f"{out} is not empty and holds no masks to go on with; choose another folder.") from error
        if found != identity:
            raise DegenseError(f"{out} holds masks of other prompts, settings or another run; choose another folder.")
    elif out.exists() and not out.is_dir():
        raise DegenseError(f"{out} is a file; masks of several frames go into a folder.")
    else:
        write_text(out / ASKED, json.dumps(identity, ensure_ascii=False))


def _areas(folders: Sequence[Path], frame: int) -> np.ndarray:
    """Shares of the frame float64 [n] of the masks that were written before."""
    shares = []
    for folder in folders:
        file = folder / _file(frame)
        try:
            mask = read_index(file)
        except (DegenseError, OSError) as error:
            raise DegenseError(f"{file} is missing or damaged; delete the label map of frame {frame} to make it anew.") from error
        shares.append((mask > 0).mean())
    return np.array(shares)

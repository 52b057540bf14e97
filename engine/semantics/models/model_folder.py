"""The folder of a model: where it is, its configuration, and a digest that identifies it."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from degense.engine.data.files.numbered import shown
from degense.engine.errors import DegenseError, what_is_wrong
from degense.engine.untrusted import read_json

HUB_NAME = re.compile(r"[\w.-]+/[\w.-]+")
#: As open_clip publishes a model. As transformers does, it is config.json and model.safetensors, in one file or several.
OPEN_CLIP_CONFIG, OPEN_CLIP_WEIGHTS = "open_clip_config.json", "open_clip_model.safetensors"
MOST_BYTES = 16 << 20  # of a configuration
PIECE = 1 << 20
MOST_BRIGHT = 1000.0  # of means and deviations, and their inverse


def find_model(place: str) -> Path:
    """The folder of a model: `place` itself, or what the user's own cache holds of the hub's model of that name.

    DegenseError when it is neither, or a checkpoint that cannot be read.
    """
    path = Path(place).expanduser()
    described = any((path / name).exists() for name in ("config.json", OPEN_CLIP_CONFIG))
    if path.suffix in (".pth", ".pt", ".bin", ".ckpt") or (path.is_dir() and not described and any(path.glob("*.pt*"))):
        raise DegenseError(
            f"{shown(path)} is a pickled checkpoint (as of CAT-Seg or SurgVLP), which is not read; compute its features with its program "
            "and train with --teacher precomputed:FOLDER."
        )
    if path.is_dir():
        return path
    if not HUB_NAME.fullmatch(place):
        raise DegenseError(f"{shown(path)} is no folder; name the folder of a model, as in --teacher vlm:FOLDER.")
    transformers_library()
    from huggingface_hub import snapshot_download
    from huggingface_hub.errors import LocalEntryNotFoundError

    try:
        return Path(snapshot_download(place, local_files_only=True))
    except LocalEntryNotFoundError as error:
        raise DegenseError(f"{place} is neither a folder nor in your model cache; download it first (degense never does).") from error


def is_open_clip(folder: Path) -> bool:
    """Whether a model is to be read as open_clip publishes it: not where the same folder holds it as transformers saves it, too."""
    if not (folder / OPEN_CLIP_CONFIG).exists():
        return False
    saved = (folder / "config.json").exists() and any(folder.glob("model*.safetensors"))
    return not (saved and "model_type" in model_config(folder))  # timm's models have a config.json of another meaning


def model_config(folder: Path) -> dict[str, Any]:
    """The content of config.json. DegenseError in one sentence when there is none."""
    if not (folder / "config.json").exists():
        raise DegenseError(f"{shown(folder)} holds no config.json: it is no model.")
    return read_config(folder / "config.json")


def read_config(file: Path) -> dict[str, Any]:
    """The object in a JSON file. DegenseError in one sentence for anything else."""
    try:
        config = read_json(file, MOST_BYTES)
    except (OSError, ValueError) as error:
        raise DegenseError(f"{shown(file)} is not valid JSON ({error}).") from error
    if not isinstance(config, dict):
        raise DegenseError(f"{shown(file)} describes no model.")
    return config


def transformers_library() -> Any:
    """The package transformers, quiet. DegenseError when it is not installed."""
    try:
        import transformers
    except ImportError as error:
        raise DegenseError("a model needs the package transformers; install it with: pip install 'degense[vlm]'") from error
    transformers.utils.logging.disable_progress_bar()
    return transformers


def saved_by_transformers(folder: Path, kind: str, model: str) -> tuple[Any, Any]:
    """The model of a class of transformers, and its tokenizer. DegenseError in one sentence when there is no such `kind`."""
    what = f"{kind} with model.safetensors and its tokenizer"
    return from_transformers(folder, what, model, use_safetensors=True), from_transformers(folder, what, "AutoTokenizer")


def from_transformers(folder: Path, what: str, name: str, **options: Any) -> Any:
    """What a class of transformers makes of a folder. DegenseError in one sentence when it holds no such thing, called `what`."""
    kind = getattr(transformers_library(), name)
    try:
        return kind.from_pretrained(str(folder), local_files_only=True, **options)
    except Exception as error:  # whatever transformers, safetensors and tokenizers meet in a damaged folder
        raise DegenseError(f"{shown(folder)} holds no {what}: {what_is_wrong(error)}") from error


Three = tuple[float, float, float]


def brightness(folder: Path, preprocessing: dict[str, Any], mean: Three, deviation: Three) -> tuple[Tensor, Tensor]:
    """Mean and deviation of a model's pictures, float32 [3, 1, 1], where `preprocessing` says nothing those given.

    DegenseError for anything but three numbers each, and for a deviation that is not positive.
    """
    found = [preprocessing.get("image_mean", mean), preprocessing.get("image_std", deviation)]
    for name, three, least in (("image_mean", found[0], -MOST_BRIGHT), ("image_std", found[1], 1 / MOST_BRIGHT)):
        numbers = isinstance(three, (list, tuple)) and len(three) == 3 and all(type(one) in (int, float) for one in three)
        if not numbers or not all(least <= one <= MOST_BRIGHT for one in three):
            raise DegenseError(f"{shown(folder)} gives its pictures the {name} {str(three)[:80]}; it is damaged: download the model anew.")
    first, second = (torch.tensor(three, dtype=torch.float32).reshape(3, 1, 1) for three in found)
    return first, second


def model_digest(folder: Path) -> str:
    """Of the configuration, the size of the weights and a few pieces of them, 12 hexadecimal digits."""
    config, weights = (OPEN_CLIP_CONFIG, OPEN_CLIP_WEIGHTS) if is_open_clip(folder) else ("config.json", "*.safetensors")
    total = hashlib.sha256((folder / config).read_bytes())
    for file in sorted(folder.glob(weights)):
        size = file.stat().st_size
        total.update(f"{file.name} {size}".encode())
        with file.open("rb") as opened:
            for place in (0, size // 2, max(0, size - PIECE)):
                opened.seek(place)
                total.update(opened.read(PIECE))
    return total.hexdigest()[:12]

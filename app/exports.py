"""Formats that other tools read. Each is a generator of steps, so that command line and window show its progress and can stop it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from app.pictures import Movie, check_decoder, check_frame, get_layer, layer_picture, write_png
from app.terminal import Steps
from engine.errors import DegenseError, PromptError
from engine.files import write_text

if TYPE_CHECKING:
    from engine.layers import LayerRequest
    from engine.scene import Scene


@dataclass(frozen=True)
class ExportOptions:
    """What to export; None leaves the choice to the format or to the layers.

    Attributes
    ----------
    prompts : tuple of str
        Classes of the masks; empty for the classes of the scene.
    frame : float or None
        Instant of a single PLY; None for the reference frame.
    layer : str
        Layer of a movie.
    span : (float, float) or None
        Values of the first and the last colour of a movie of a scalar layer; None for the range of the whole sequence.
    """

    prompts: tuple[str, ...] = ()
    decoder: str | None = None
    threshold: float | None = None
    frame: float | None = None
    layer: str = "rgb"
    span: tuple[float, float] | None = None

    def layer_request(self, frame: float) -> LayerRequest:
        """The request for a layer at a frame with these settings; what is None keeps the layers' default."""
        from engine.layers import LayerRequest

        request = LayerRequest(frame, prompts=self.prompts)
        threshold = request.threshold if self.threshold is None else self.threshold
        return replace(request, decoder=self.decoder or request.decoder, threshold=threshold)


def export_ply(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """One instant as a Gaussian PLY."""
    from engine.store.ply import save_ply

    frame = check_frame(scene, scene.reference_frame if options.frame is None else options.frame)
    yield 0.0, f"frame {frame}"
    out.parent.mkdir(parents=True, exist_ok=True)
    save_ply(out, scene.splats(frame))
    return f"{out}: {len(scene.splats(frame))} Gaussians at frame {frame}"


def export_ply_sequence(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """One PLY for each frame, `NNNNNN.ply`."""
    from engine.store.ply import save_ply

    _empty_folder(out)
    for frame in range(scene.frames):
        yield frame / scene.frames, f"frame {frame}"
        save_ply(out / f"{frame:06d}.ply", scene.splats(frame))
    return f"{out}: {scene.frames} PLY files"


def export_masks_png(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """Label maps as clips have them: `labels/NNNNNN.png` (8-bit index into `classes.json`)."""
    classes = _classes(scene, options)
    _empty_folder(out)
    for frame, labels in _label_maps(scene, classes, options):
        yield frame / scene.frames, f"frame {frame}"
        write_png(out / "labels" / f"{frame:06d}.png", labels)
    write_text(out / "classes.json", json.dumps({"classes": list(classes)}))
    return f"{out}: label maps of {scene.frames} frames, {len(classes)} classes"


def export_coco(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """One COCO file; each class in each frame is an annotation with an uncompressed run-length mask."""
    classes = _classes(scene, options)
    width, height = scene.clip_size
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for frame, labels in _label_maps(scene, classes, options):
        yield frame / scene.frames, f"frame {frame}"
        images.append({"id": frame, "file_name": f"{frame:06d}.png", "width": width, "height": height})
        for index in range(len(classes)):
            mask = labels == index
            if mask.any():
                ys, xs = np.nonzero(mask)
                x, y = int(xs.min()), int(ys.min())
                annotations.append(
                    {
                        "id": len(annotations) + 1,
                        "image_id": frame,
                        "category_id": index + 1,
                        "iscrowd": 1,
                        "area": int(mask.sum()),
                        "bbox": [x, y, int(xs.max()) - x + 1, int(ys.max()) - y + 1],
                        "segmentation": {"size": [height, width], "counts": run_lengths(mask)},
                    }
                )
    now = datetime.now(timezone.utc).isoformat(timespec="seconds")
    data = {
        "info": {
            "description": f"Masks of {scene.name}, made by DeGense",
            "date_created": now,
        },
        "images": images,
        "categories": [{"id": index + 1, "name": name} for index, name in enumerate(classes)],
        "annotations": annotations,
    }
    write_text(out, json.dumps(data))
    return f"{out}: {len(annotations)} masks in {scene.frames} frames"


def export_movie(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """A layer over the whole sequence as .mp4."""
    if out.suffix.lower() != ".mp4":
        raise DegenseError(f"{out} must end in .mp4.")
    yield from write_movie(scene, out, range(scene.frames), options)
    return f"{out}: {options.layer}, {scene.frames} frames"


def write_movie(scene: Scene, out: Path, frames: Sequence[int], options: ExportOptions) -> Steps[None]:
    layer = get_layer(options.layer)
    with Movie(out, scene.fps) as movie:
        span = options.span
        if span is None and layer.kind == "scalar":
            yield 0.0, "finding the range of the whole sequence"
            from engine.layers import layer_range

            span = layer_range(scene, layer, options.layer_request(frames[0]), "sequence")
        for done, frame in enumerate(frames):
            yield done / len(frames), f"frame {frame}"
            movie.add(layer_picture(scene, layer, options.layer_request(frame), span))


@dataclass(frozen=True)
class Format:
    """One way out. `suffix` is empty for a folder."""

    title: str
    suffix: str
    export: Callable[[Scene, Path, ExportOptions], Steps[str]]


FORMATS = {
    "ply": Format("Gaussians of one frame (PLY)", ".ply", export_ply),
    "ply-sequence": Format("Gaussians of every frame (PLY)", "", export_ply_sequence),
    "masks-png": Format("Masks as label maps (PNG)", "", export_masks_png),
    "coco": Format("Masks as COCO (JSON)", ".json", export_coco),
    "movie": Format("Movie of the layer (MP4)", ".mp4", export_movie),
}


def get_format(name: str) -> Format:
    """The format of that name; DegenseError, with those there are, when there is none."""
    if name not in FORMATS:
        raise DegenseError(f"There is no format {name!r}; choose one of {', '.join(FORMATS)}.")
    return FORMATS[name]


def run_lengths(mask: np.ndarray) -> list[int]:
    """COCO's counts of a bool [H, W] mask: lengths of runs down the columns, zeros first."""
    flat = mask.ravel(order="F")
    changes = np.flatnonzero(np.diff(flat)) + 1
    lengths = np.diff(np.concatenate([[0], changes, [flat.size]])).tolist()
    return [0, *lengths] if flat[0] else lengths


def _classes(scene: Scene, options: ExportOptions) -> tuple[str, ...]:
    classes = options.prompts or tuple(scene.classes)
    if not classes:
        raise PromptError(f"{scene.name} has no classes of its own; say which masks to export with prompts.")
    return classes


def _label_maps(scene: Scene, classes: tuple[str, ...], options: ExportOptions) -> Iterator[tuple[int, np.ndarray]]:
    """Pairs of a frame and its uint8 [H, W] label map over `classes`."""
    check_decoder(options.decoder)
    vectors = scene.vectors(classes)
    for frame in range(scene.frames):
        yield frame, scene.query(frame).label_map(vectors, options.decoder or "rnse")


def _empty_folder(folder: Path) -> None:
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise DegenseError(f"{folder} is not empty; choose another folder.")
    folder.mkdir(parents=True, exist_ok=True)

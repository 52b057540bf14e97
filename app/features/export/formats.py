"""Formats that other tools read. Each is a generator of steps, so that command line and window show its progress and can stop it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from degense.app.features.annotate.label_sets import empty_folder, label_source, write_labels
from degense.app.features.viewer.layer_images import check_frame, get_layer, layer_rgb, movie, sequence_span
from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps

if TYPE_CHECKING:
    import numpy as np

    from degense.engine.layers import Layer, LayerRequest
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet


@dataclass(frozen=True)
class ExportOptions:
    """What to export; None leaves the choice to the format or to the layers."""

    prompt_set: PromptSet  # what is asked; without prompts, masks are of the classes of the scene
    frame: float | None = None  # instant of a single PLY; None for the reference frame
    layer: str = "rgb"  # layer of a movie
    #: Values of the first and the last colour of a movie of a scalar layer; None for the range of the whole sequence.
    span: tuple[float, float] | None = None
    #: Where label maps come from: what the run answers to prompts, or what was annotated. None: the
    #: annotations where there are any and nothing is prompted.
    source: Literal["masks", "annotations"] | None = None

    def layer_request(self, frame: float) -> LayerRequest:
        """The request for a layer at a frame with these settings."""
        from degense.engine.layers import LayerRequest

        return LayerRequest(frame, prompt_set=self.prompt_set)


def export_ply(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    from degense.engine.store.files import save_ply

    frame = check_frame(scene, scene.reference_frame if options.frame is None else options.frame)
    yield 0.0, f"frame {frame}"
    out.parent.mkdir(parents=True, exist_ok=True)
    save_ply(out, scene.splats(frame))
    return f"{out}: {len(scene.splats(frame))} Gaussians at frame {frame}"


def export_ply_sequence(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """One PLY for each frame, `NNNNNN.ply`."""
    from degense.engine.store.files import save_ply

    empty_folder(out)
    for frame in range(scene.frames):
        yield frame / scene.frames, f"frame {frame}"
        save_ply(out / f"{frame:06d}.ply", scene.splats(frame))
    return f"{out}: {scene.frames} PLY files"


def export_labels(name: str, scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """Label maps in one of the formats of `engine.annotation.formats`."""
    maps = label_source(scene, options.source, options.prompt_set)
    return (yield from write_labels(name, maps, out))


def export_movie(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    if out.suffix.lower() != ".mp4":
        raise DegenseError(f"{out} must end in .mp4.")
    yield from write_movie(scene, out, range(scene.frames), options)
    return f"{out}: {options.layer}, {scene.frames} frames"


def write_movie(scene: Scene, out: Path, frames: Sequence[int], options: ExportOptions) -> Steps[None]:
    layer = get_layer(options.layer)
    with movie(out, scene.fps) as add:
        yield from draw_frames(scene, layer, frames, options, lambda frame, picture: add(picture))


def draw_frames(
    scene: Scene, layer: Layer, frames: Sequence[int], options: ExportOptions, use: Callable[[int, np.ndarray], None]
) -> Steps[None]:
    """Draw a layer at frames, by default over its range in the whole sequence; `use` gets number and RGB, uint8 [H, W, 3], of each."""
    span = yield from sequence_span(scene, layer, options.layer_request(frames[0]), options.span)
    for done, frame in enumerate(frames):
        yield done / len(frames), f"frame {frame}"
        use(frame, layer_rgb(scene, layer, options.layer_request(frame), span))


@dataclass(frozen=True)
class Format:
    """One way out. `suffix` is empty for a folder."""

    title: str
    suffix: str
    export: Callable[[Scene, Path, ExportOptions], Steps[str]]


FORMATS = {
    "ply": Format("Gaussians of one frame (PLY)", ".ply", export_ply),
    "ply-sequence": Format("Gaussians of every frame (PLY)", "", export_ply_sequence),
    **{name: Format(f"Masks as {kind.title}", kind.suffix, partial(export_labels, name)) for name, kind in LABEL_FORMATS.items()},
    "movie": Format("Movie of the layer (MP4)", ".mp4", export_movie),
}


def get_format(name: str) -> Format:
    """The format of that name; DegenseError, with those there are, when there is none."""
    if name not in FORMATS:
        raise DegenseError(f"There is no format {name!r}; choose one of {', '.join(FORMATS)}.")
    return FORMATS[name]

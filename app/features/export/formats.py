"""Formats that other tools read. Each is a generator of steps, so that command line and window show its progress and can stop it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from degense.app.features.annotate.label_sets import at_frames, label_source, write_labels
from degense.app.features.movies.movie import MovieOptions, make_movie, view_of
from degense.app.features.viewer.layer_images import check_frame, get_layer, layer_rgb, sequence_span
from degense.engine.annotation.formats import LABEL_FORMATS
from degense.engine.errors import DegenseError
from degense.engine.files import replacing_folder
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
    frame: float | None = None  # instant of a single PLY, SPZ or glTF; None for the reference frame
    layer: str = "rgb"  # layer of a movie
    #: Values of the first and the last colour of a movie of a scalar layer; None for the range of the whole sequence.
    span: tuple[float, float] | None = None
    #: Where label maps come from: what the run answers to prompts, or what was annotated. None: the
    #: annotations where there are any and nothing is prompted.
    source: Literal["masks", "annotations"] | None = None
    #: Frames whose label maps are written; None for all.
    frames: Sequence[int] | None = None

    def layer_request(self, frame: float) -> LayerRequest:
        """The request for a layer at a frame with these settings."""
        from degense.engine.layers import LayerRequest

        return LayerRequest(frame, prompt_set=self.prompt_set)


def export_splats(suffix: str, scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """The Gaussians of one instant in one of the formats of `engine.store.splat_files`."""
    from degense.engine.store.splat_files import SPLAT_FILES

    frame = check_frame(scene, scene.reference_frame if options.frame is None else options.frame)
    yield 0.0, f"frame {frame}"
    out.parent.mkdir(parents=True, exist_ok=True)
    SPLAT_FILES[suffix](out, scene.splats(frame))
    return f"{out}: {len(scene.splats(frame))} Gaussians at frame {frame}"


def export_ply_sequence(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """One PLY for each frame, `NNNNNN.ply`."""
    from degense.engine.store.splat_files import save_ply

    with replacing_folder(out) as folder:
        for frame in range(scene.frames):
            yield frame / scene.frames, f"frame {frame}"
            save_ply(folder / f"{frame:06d}.ply", scene.splats(frame))
    return f"{out}: {scene.frames} PLY files"


def export_labels(name: str, scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """Label maps in one of the formats of `engine.annotation.formats`."""
    maps = label_source(scene, options.source, options.prompt_set)
    if options.frames is not None:
        maps = at_frames(maps, options.frames)
    return (yield from write_labels(name, maps, out))


def export_movie(scene: Scene, out: Path, options: ExportOptions) -> Steps[str]:
    """A layer over the whole clip, or over the frames of `options`; masks are not laid over it."""
    layer, frames = get_layer(options.layer).name, options.frames or range(scene.frames)
    view_state = replace(view_of(options.prompt_set, layer, options.span), masks_shown=False)
    return (yield from make_movie(scene, out, MovieOptions(view_state, (layer,), frames=(frames[0], frames[-1]))))


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
    "ply": Format("Gaussians of one frame (PLY)", ".ply", partial(export_splats, ".ply")),
    "spz": Format("Gaussians of one frame, compressed (SPZ)", ".spz", partial(export_splats, ".spz")),
    "gltf": Format("Gaussians of one frame (glTF)", ".glb", partial(export_splats, ".glb")),
    "ply-sequence": Format("Gaussians of every frame (PLY)", "", export_ply_sequence),
    "movie": Format("Movie of the layer (MP4)", ".mp4", export_movie),
    **{name: Format(kind.title, kind.suffix, partial(export_labels, name)) for name, kind in LABEL_FORMATS.items()},
}


def get_format(name: str) -> Format:
    """The format of that name; DegenseError, with those there are, when there is none."""
    if name not in FORMATS:
        raise DegenseError(f"There is no format {name!r}; choose one of {', '.join(FORMATS)}.")
    return FORMATS[name]

"""Pictures put together without a window: a layer in colours, masks over it, a colour bar beside it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from degense.app.session.view_state import ColourRange
from degense.engine.colour_maps import colour_table
from degense.engine.errors import DegenseError
from degense.engine.files import replacing
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.layers import Layer, LayerRequest
    from degense.engine.scene import Scene

BACKGROUND, INK = 24, 230
FONT = cv2.FONT_HERSHEY_SIMPLEX


def get_layer(name: str) -> Layer:
    """The layer of that name, or of the name that it had in an earlier version.

    DegenseError when there is none; the sentence lists those there are.
    """
    from degense.engine.layers import LAYERS
    from degense.engine.store.migrations import current_layer

    name = current_layer(name)
    if name not in LAYERS:
        raise DegenseError(f"There is no layer {name!r}; choose one of {', '.join(LAYERS)}.")
    return LAYERS[name]


def check_frame(scene: Scene, frame: float) -> float:
    """`frame`, when the scene has it; DegenseError otherwise."""
    if not 0 <= frame <= scene.frames - 1:
        raise DegenseError(f"There is no frame {frame:g} in {scene.name}; its frames are 0 to {scene.frames - 1}.")
    return int(frame) if float(frame).is_integer() else frame


def sequence_span(
    scene: Scene, layer: Layer, request: LayerRequest, chosen: tuple[float, float] | None, clip: float = ColourRange.clip
) -> Steps[tuple[float, float] | None]:
    """The values of the first and the last colour of a movie: those chosen, else the range of the whole sequence; None for colours."""
    if chosen is not None or layer.kind != "scalar":
        return chosen
    from degense.engine.layers import layer_range

    yield 0.0, "finding the range of the whole sequence"
    return layer_range(scene, layer, request, "sequence", clip)


def layer_rgb(scene: Scene, layer: Layer, request: LayerRequest, span: tuple[float, float] | None = None) -> np.ndarray:
    """A layer in colours, uint8 [H, W, 3]. Scalars are coloured from `span[0]` to `span[1]`, by default over this frame's own range."""
    from degense.engine.layers import layer_range
    from degense.engine.layers.layer import colourise

    low, high = span or (layer_range(scene, layer, request, "frame") if layer.kind == "scalar" else (0.0, 1.0))
    return colourise(layer.image(scene, request), low, high, layer.cmap)


def laid_over(rgb: np.ndarray, over: np.ndarray, opacity: float = 1.0) -> np.ndarray:
    """`rgb` uint8 [H, W, 3] with uint8 [H, W, 4] laid over it."""
    alpha = over[..., 3:].astype(np.float32) / 255 * opacity
    return (rgb * (1 - alpha) + over[..., :3] * alpha + 0.5).astype(np.uint8)


def beyond(values: np.ndarray, low: float, high: float) -> tuple[bool, bool]:
    """Whether some of the finite values lie below `low`, and above `high`."""
    return bool((values < low).any()), bool((values > high).any())


def with_colour_bar(
    image: np.ndarray,
    title: str,
    unit: str,
    low: float,
    high: float,
    cmap: str,
    *,
    hatched: bool = False,
    outside: tuple[bool, bool] = (False, False),
) -> np.ndarray:
    """The image with a labelled colour bar at its right, uint8 [H, W + bar, 3]; with a line for hatched pixels when there are any.

    `outside`: values lie below `low`, above `high`. The bar is as wide where none do: frames of a movie have one size.
    """
    height = image.shape[0]
    scale = max(0.4, min(0.8, height / 640))
    line = round(30 * scale)
    signs = "<= " if outside[0] else "", ">= " if outside[1] else ""
    labels = [f"{signs[1]}{high:.3g} {unit}".strip(), f"{(low + high) / 2:.3g}", f"{signs[0]}{low:.3g} {unit}".strip()]
    note = "hatched: a guess" if hatched else ""
    widest = [f">= {value:.3g} {unit}" for value in (low, high)]
    text_width = max(cv2.getTextSize(text, FONT, scale, 1)[0][0] for text in [*labels, *widest, title, note])
    bar = np.full((height, round(40 * scale) + text_width + 2 * line, 3), BACKGROUND, np.uint8)
    top, bottom, left, right = 2 * line, height - line * (2 if hatched else 1), line // 2, line // 2 + round(24 * scale)
    steps = np.linspace(255, 0, bottom - top).round().astype(int)
    bar[top:bottom, left:right] = colour_table(cmap)[steps][:, None]
    cv2.putText(bar, title, (left, line), FONT, scale, (INK,) * 3, 1, cv2.LINE_AA)
    cv2.putText(bar, note, (left, height - line // 2), FONT, scale, (INK,) * 3, 1, cv2.LINE_AA)
    for text, y in zip(labels, (top, (top + bottom) // 2, bottom), strict=True):
        cv2.line(bar, (right, min(y, bottom - 1)), (right + line // 4, min(y, bottom - 1)), (INK,) * 3)
        cv2.putText(bar, text, (right + line // 2, y + line // 4), FONT, scale, (INK,) * 3, 1, cv2.LINE_AA)
    return np.hstack([image, bar])


def write_png(path: Path, image: np.ndarray) -> None:
    """Write uint8 [H, W] or RGB [H, W, 3], atomically."""
    ok, data = cv2.imencode(".png", image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    if not ok:
        raise DegenseError(f"{path} cannot be written as PNG.")
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())


def write_npy(path: Path, values: np.ndarray) -> None:
    """Write an array, atomically."""
    with replacing(path) as temporary:
        np.save(temporary, values, allow_pickle=False)


@contextmanager
def movie(path: Path, fps: float) -> Iterator[Callable[[np.ndarray], None]]:
    """A function that appends a frame, uint8 [H, W, 3], to an .mp4, which appears at `path` when the block ends well."""
    writer = cv2.VideoWriter()

    def add(rgb: np.ndarray) -> None:
        rgb = np.pad(rgb, ((0, rgb.shape[0] % 2), (0, rgb.shape[1] % 2), (0, 0)), mode="edge")  # the codec needs even sides
        if not writer.isOpened() and not writer.open(str(temporary), cv2.VideoWriter_fourcc(*"mp4v"), fps, rgb.shape[1::-1]):
            raise DegenseError(f"{path}: this build of OpenCV cannot write .mp4 files; export PNG frames instead.")
        writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))

    with replacing(path) as temporary:
        try:
            yield add
        finally:
            writer.release()

"""Movies: one layer or several side by side, through time from the surgeon's camera, or along a path of cameras."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

import cv2
import numpy as np

from degense.app.features.cameras.state import CameraPath, Stop
from degense.app.features.movies.layer_stack import LayerStack
from degense.app.features.viewer.layer_images import FONT, INK, get_layer, laid_over, movie, sequence_span, with_colour_bar
from degense.app.features.viewer.view_rendering import View, ViewRequest, draw_view, layer_request
from degense.app.session.view_state import PROMPT_COLOURS, ColourRange, Prompt, ViewState
from degense.engine.errors import DegenseError
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.camera import Camera
    from degense.engine.scene import Scene
    from degense.engine.semantics.prompts import PromptSet

#: Stands for the recorded frames among the layers of a movie.
RECORDING = "recording"
#: Frames a second along a path, where nothing else is chosen; sides and number of pictures that a movie may have.
FLIGHT_FPS, LARGEST_SIDE, MOST_FPS, MOST_LAYERS = 25.0, 4096, 240.0, 4
#: Which instants a flight shows: those that the cameras were kept at, or all from the first frame to the last.
FlightTime = Literal["kept", "whole"]


@dataclass(frozen=True)
class MovieOptions:
    """What a movie shows. DegenseError for sizes, rates and layers that cannot be."""

    view_state: ViewState  # prompts, masks and colours
    layers: tuple[str, ...] = ("rgb",)  # side by side: `RECORDING`, or layers over each other as `LayerStack` writes them
    size: tuple[int, int] | None = None  # width and height of each picture, pixels; None for those of the clip
    fps: float | None = None  # None for that of the clip, or `FLIGHT_FPS` along a path
    frames: tuple[int, int] | None = None  # first and last of the clip; None for all
    stops: tuple[Stop, ...] = ()  # the path; empty for the surgeon's camera
    flight_time: FlightTime = "kept"
    titled: bool = False  # with the names of the layers and their colour bars

    def __post_init__(self) -> None:
        if not 1 <= len(self.layers) <= MOST_LAYERS:
            raise DegenseError(f"A movie shows 1 to {MOST_LAYERS} layers side by side, not {len(self.layers)}.")
        if self.size is not None and not all(16 <= side <= LARGEST_SIDE for side in self.size):
            raise DegenseError(f"The sides of a movie have 16 to {LARGEST_SIDE} pixels, not {self.size[0]} × {self.size[1]}.")
        if self.fps is not None and not 0 < self.fps <= MOST_FPS:
            raise DegenseError(f"A movie has up to {MOST_FPS:g} frames a second, not {self.fps:g}.")
        if self.flight_time not in get_args(FlightTime):
            raise DegenseError(f"The time of a flight is kept or whole, not {self.flight_time!r}.")
        if self.stops and RECORDING in self.layers:
            raise DegenseError("The recording cannot be seen from another camera; leave it out, or take the surgeon's camera.")


def view_of(prompts: PromptSet, layer: str = "rgb", span: tuple[float, float] | None = None) -> ViewState:
    """What the window would show of a layer with these prompts, in the colours that it gives them; `span` fixes the range."""
    asked = (Prompt(text, PROMPT_COLOURS[i % len(PROMPT_COLOURS)]) for i, text in enumerate(prompts.prompts))
    left_out = (Prompt(text, PROMPT_COLOURS[0], negative=True) for text in prompts.negatives)
    view_state = ViewState(layer=layer, prompts=(*asked, *left_out), threshold=prompts.threshold, decoder=prompts.decoder)
    return view_state if span is None else view_state.with_range(layer, ColourRange("fixed", *span))


#: First and last colour of layers of numbers, by name.
Spans = dict[str, tuple[float, float]]
#: One picture of a movie: the camera (None for the surgeon's) and the frame.
Shot = tuple["Camera | None", float]


def make_movie(scene: Scene, out: Path, options: MovieOptions) -> Steps[str]:
    """Write an .mp4. Yields (fraction, words).

    DegenseError for another suffix, a path of one camera, and what the scene cannot show.
    """
    if out.suffix.lower() != ".mp4":
        raise DegenseError(f"{out} must end in .mp4.")
    if RECORDING in options.layers and scene.clip is None:
        raise DegenseError(f"The recording cannot be shown, because it is missing: {scene.clip_missing}")
    panels = []
    for name in options.layers:
        stack = None if name == RECORDING else LayerStack.read(name)
        spans = {} if stack is None else (yield from _spans(scene, stack, options.view_state))
        panels.append(_Panel(scene, stack, spans, options))
    shots, fps = plan(scene, options)
    with movie(out, fps) as add:
        for done, shot in enumerate(shots):
            yield done / len(shots), f"frame {done + 1} of {len(shots)}"
            add(np.hstack([panel.draw(shot) for panel in panels]))
    return f"{out}: {', '.join(options.layers)}, {len(shots)} frames"


def plan(scene: Scene, options: MovieOptions) -> tuple[list[Shot], float]:
    """The pictures of a movie, and how many a second. DegenseError for a path of one camera."""
    fps = options.fps or (FLIGHT_FPS if options.stops else scene.fps)
    return (_flight if options.stops else _recording)(scene, options, fps), fps


def _spans(scene: Scene, stack: LayerStack, view_state: ViewState) -> Steps[Spans]:
    """The values of the first and last colour of each layer of numbers: those fixed in the view, else the range of the whole sequence.

    DegenseError when the scene cannot show one of the layers.
    """
    stack.check(scene, tuple(prompt.text for prompt in view_state.visible_prompts))
    spans = {}
    for name, _ in stack.layers:
        chosen = view_state.range(name)
        fixed = (chosen.low, chosen.high) if chosen.mode == "fixed" else None
        span = yield from sequence_span(scene, get_layer(name), layer_request(view_state, 0), fixed, chosen.clip)
        if span is not None:
            spans[name] = span
    return spans


def _recording(scene: Scene, options: MovieOptions, fps: float) -> list[Shot]:
    """The surgeon's view at the speed of the clip; at another rate than the clip's, instants between its frames."""
    first, last = options.frames or (0, scene.frames - 1)
    count = max(1, round((last - first + 1) * fps / scene.fps))
    return [(None, min(float(last), first + i * scene.fps / fps)) for i in range(count)]


def _flight(scene: Scene, options: MovieOptions, fps: float) -> list[Shot]:
    """Along the path; from the first frame to the last of what is shown where the time runs through it all."""
    path = CameraPath(options.stops)
    count = max(2, round(path.seconds * fps) + 1)
    first, last = options.frames or (0, scene.frames - 1)
    shots: list[Shot] = []
    for i in range(count):
        camera, kept = path.at(i / fps)
        frame = first + (last - first) * i / (count - 1) if options.flight_time == "whole" else min(kept, scene.frames - 1.0)
        shots.append((camera.filled(*(options.size or scene.clip_size)), frame))
    return shots


class _Panel:
    """One of the pictures side by side."""

    def __init__(self, scene: Scene, stack: LayerStack | None, spans: Spans, options: MovieOptions) -> None:
        self._scene, self._stack, self._spans, self._options = scene, stack, spans, options

    def draw(self, shot: Shot) -> np.ndarray:
        """uint8 [H, W, 3]."""
        camera, frame = shot
        if self._stack is None:
            observed = self._scene.observed(round(frame))
            assert observed is not None
            picture, outside = self._fitted(observed), (False, False)
        else:
            picture, outside = self._rendered(self._stack, camera, frame)
        return self._titled(picture, outside) if self._options.titled else picture

    def _rendered(self, stack: LayerStack, camera: Camera | None, frame: float) -> tuple[np.ndarray, tuple[bool, bool]]:
        """The picture, and whether values lie below and above what the colour bar shows."""
        scene, size, view_state = self._scene, self._options.size, stack.view_state(self._options.view_state)
        compared = any(get_layer(name).needs_clip for name, _ in stack.layers)  # what compares with the recording has its size
        if camera is None and size is not None and not compared and not scene.renderer.only_surgeons:
            camera = scene.camera(frame).letterboxed(*size)
        view = _last(draw_view(scene, ViewRequest(frame, view_state, self._spans, splats=False, camera=camera)))
        picture = view.rgb if view.masks is None else laid_over(view.rgb, view.masks, view_state.overlay_opacity)
        return self._fitted(picture), view.beyond

    def _fitted(self, picture: np.ndarray) -> np.ndarray:
        """The picture at the size of the movie, whole, with black margins where its shape is another."""
        width, height = self._options.size or self._scene.clip_size
        if picture.shape[:2] == (height, width):
            return picture
        scale = min(width / picture.shape[1], height / picture.shape[0])
        inner = max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale))
        resized = cv2.resize(picture, inner, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC)
        out = np.zeros((height, width, 3), np.uint8)
        left, top = (width - inner[0]) // 2, (height - inner[1]) // 2
        out[top : top + inner[1], left : left + inner[0]] = resized
        return out

    def _titled(self, picture: np.ndarray, outside: tuple[bool, bool]) -> np.ndarray:
        stack = self._stack
        layer = stack.numbers if stack is not None else None
        if layer is not None and (span := self._spans.get(layer.name)) is not None:
            cmap = self._options.view_state.range(layer.name).cmap or layer.cmap
            unit = layer.unit(self._scene)
            return with_colour_bar(picture, layer.title, unit, *span, cmap, hatched=bool(layer.guess), outside=outside)
        picture, scale = picture.copy(), max(0.4, min(0.8, picture.shape[0] / 640))
        title = stack.title if stack is not None else "Recording"
        for ink, thickness in ((0, 3), (INK, 1)):
            cv2.putText(picture, title, (round(12 * scale), round(30 * scale)), FONT, scale, (ink,) * 3, thickness, cv2.LINE_AA)
        return picture


def _last(steps: Generator[View, None, View]) -> View:
    """The finished view of `draw_view`."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            view: View = end.value
            return view

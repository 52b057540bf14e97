"""What a pixel or a Gaussian can show: the types of the registry, and from a layer's values to colours and their range."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from degense.engine.camera import Camera
from degense.engine.colour_maps import CLASS_COLOURS, hatched
from degense.engine.colour_maps import colourise as colourise_values
from degense.engine.layer_titles import LAYER_TITLES
from degense.engine.scene import NO_OBSERVABILITY, Scene
from degense.engine.scene.uncertainty import is_guess
from degense.engine.semantics.prompts import NO_PROMPTS, PromptSet

Kind = Literal["colour", "scalar", "mask"]
RangeMode = Literal["frame", "sequence"]
#: Channels of displacement: its values, and how far off they may be. Frames of the surgeon's camera are cached: one drawing for both.
MOVED = ("displacement", "uncertainty")


@dataclass(frozen=True)
class LayerRequest:
    """What to show."""

    frame: float
    camera: Camera | None = None  # None: the surgeon's
    prompt_set: PromptSet = NO_PROMPTS  # for `similarity` and `mask`
    pixelwise: bool = False  # decode masks pixel by pixel, as a preview that needs no superpixels


@dataclass(frozen=True)
class LayerImage:
    """A layer drawn from a camera."""

    #: `colour`: float32 [H, W, 3] in [0, 1]. `scalar`: float32 [H, W], NaN where nothing is known. `mask`: uint8 [H, W], 0
    #: nothing, k + 1 where prompt k owns the pixel.
    values: np.ndarray
    unit: str
    kind: Kind
    uncertain: np.ndarray | None = None  # bool [H, W]; pixels whose value is a guess; None where the layer cannot tell


@dataclass(frozen=True)
class Layer:
    """One entry of the registry."""

    name: str  # a key of `LAYER_TITLES`
    kind: Kind
    description: str  # formula and units, shown to the user
    pixels: Callable[[Scene, LayerRequest], np.ndarray]  # as `LayerImage.values`
    splats: Callable[[Scene, LayerRequest], np.ndarray]  # [N, 3] unclipped colours, or [N] scalars (NaN unknown) or mask values
    unit: Callable[[Scene], str] = lambda scene: ""
    cmap: str = "viridis"  # of `COLOUR_MAPS`
    signed: bool = False  # its range is symmetric about zero
    from_zero: bool = False  # its range starts at zero
    least_range: float = 1e-6  # its range is at least so long: what is smaller is error of the measurement, and stays dark
    fixed_range: tuple[float, float] | None = None  # the range that it always has; None where the values decide
    of_motion: bool = False  # large values are findings about motion, whose worst frames and places are worth a list
    guess: str = ""  # what is hatched where the displacement is a guess, for legends; empty where no value is a guess
    guesses: Callable[[Scene, LayerRequest], np.ndarray] | None = (
        None  # which pixels these are, bool [H, W], where the layer has its own rule
    )
    since_reference: bool = True  # of motion: measured from the reference frame, where it is 0 by definition, which is no guess
    needs_semantics: bool = False
    needs_clip: bool = False
    needs_prompt: bool = False
    needs_observability: bool = False

    @property
    def title(self) -> str:
        return LAYER_TITLES[self.name]

    def image(self, scene: Scene, request: LayerRequest) -> LayerImage:
        """Draw the layer. DegenseError when the scene cannot show it."""
        return LayerImage(self.pixels(scene, request), self.unit(scene), self.kind, self.uncertain(scene, request))

    def uncertain(self, scene: Scene, request: LayerRequest) -> np.ndarray | None:
        """Pixels whose displacement is a guess (`is_guess`), bool [H, W]; None where none is, or the scene cannot tell."""
        if self.guesses is not None:
            return self.guesses(scene, request)
        if not self._revealable(scene, request):
            return None
        drawn = scene.render(_measured_at(scene, request), request.camera, MOVED)
        return is_guess(drawn["uncertainty"], drawn["displacement"], scene.states.depth)

    def uncertain_splats(self, scene: Scene, request: LayerRequest) -> np.ndarray | None:
        """As `uncertain`, bool [N] of the Gaussians."""
        if self.guesses is not None or not self._revealable(scene, request) or scene.observability is None:
            return None
        return scene.states.guesses(_measured_at(scene, request)).cpu().numpy()

    def _revealable(self, scene: Scene, request: LayerRequest) -> bool:
        measured = self.since_reference and request.frame == scene.reference_frame
        return bool(self.guess) and scene.observability is not None and not measured

    def missing(self, scene: Scene, prompts: tuple[str, ...]) -> str:
        """Why the scene cannot show this layer now, in one sentence; empty when it can."""
        if self.needs_semantics and not scene.has_semantics:
            return "this run was trained without semantics"
        if self.needs_clip and scene.clip is None:
            return f"this layer compares with the recording, which is missing: {scene.clip_missing}"
        if self.needs_observability and scene.observability is None:
            return f"this run {NO_OBSERVABILITY}"
        if self.needs_prompt and not prompts:
            return "type a prompt first"
        return ""


def _measured_at(scene: Scene, request: LayerRequest) -> float:
    """The frame whose displacement is in question: at the reference frame, where it is 0, the one beside it."""
    if request.frame != scene.reference_frame:
        return request.frame
    return request.frame + 1 if request.frame + 1 < scene.frames else max(0.0, request.frame - 1)


#: Frames, spread over the sequence, whose values make up the range of the whole sequence.
SEQUENCE_SAMPLES = 9
#: Percentage of the values cut off at each end, so that a few stray pixels do not darken all others.
DEFAULT_CLIP = 1.0
#: Okabe–Ito without black: the first of the classes.
MASK_COLOURS = np.array(CLASS_COLOURS[:7], np.uint8)


def colourise(image: LayerImage, low: float, high: float, cmap: str = "viridis") -> np.ndarray:
    """uint8 [H, W, 3]. Scalars run through `cmap` from `low` to `high`, hatched where they are uncertain; mask k takes the k-th class
    colour, nothing is black."""
    if image.kind == "colour":
        return (np.clip(image.values, 0, 1) * 255 + 0.5).astype(np.uint8)
    if image.kind == "scalar":
        colours = colourise_values(image.values, cmap, low, high)
        return colours if image.uncertain is None else hatched(colours, image.uncertain)
    table = np.zeros((256, 3), np.uint8)
    table[1:] = MASK_COLOURS[np.arange(255) % len(MASK_COLOURS)]
    return table[image.values]


def layer_range(scene: Scene, layer: Layer, request: LayerRequest, mode: RangeMode, clip: float = DEFAULT_CLIP) -> tuple[float, float]:
    """Colour range (low, high) of a scalar layer: percentiles `clip` and 100 − `clip` of this frame, or over frames spread across the whole
    sequence. Layers that grow from zero start there; signed ones are symmetric about it. ValueError for a `clip` outside [0, 50).
    """
    if not 0 <= clip < 50:
        raise ValueError(f"a range can leave out 0 to 50 percent at each end, not {clip}")
    if layer.fixed_range is not None:
        return layer.fixed_range
    frames = [request.frame] if mode == "frame" else np.unique(np.linspace(0, scene.frames - 1, SEQUENCE_SAMPLES).round())
    values = []
    for frame in frames:
        pixels = layer.pixels(scene, replace(request, frame=float(frame)))
        values.append(pixels[np.isfinite(pixels)])
    known = np.concatenate(values)
    if known.size == 0:
        return 0.0, 1.0
    if layer.signed:
        high = max(float(np.percentile(np.abs(known), 100 - clip)), layer.least_range)
        return -high, high
    low, high = np.percentile(known, [clip, 100 - clip])
    if layer.from_zero:
        low = 0.0
    return float(low), float(max(high, low + layer.least_range))

"""What both views show at one instant, drawn without a window."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import cv2
import numpy as np

from degense.app.features.viewer.layer_images import beyond, get_layer
from degense.app.session.view_state import ViewState
from degense.engine.colour_maps import colourise, greyed, mask_overlay
from degense.engine.errors import DegenseError, is_out_of_memory
from degense.engine.gpu import gpu_usable

if TYPE_CHECKING:
    from degense.engine.camera import Camera
    from degense.engine.clip import Clip
    from degense.engine.layers import Layer, LayerRequest
    from degense.engine.scene import Scene
    from degense.widgets.splats.gaussians import Gaussians
    from degense.widgets.splats.snapshot_surface import SnapshotRequest

#: Layers that show the answer to prompts.
PROMPTED = ("similarity", "mask")
#: Pixels of a clip that are not reconstructed. Blue: nothing in a body is.
EXCLUDED = (86, 180, 233)
NO_MASK = 40
#: Opacity of the inside of a mask against its outline, before the user's opacity.
MASK_FILL = 0.6
#: From this coverage on splats hide what lies behind them in 3D.
HIDES = 0.5
GPU_FULL = "The memory of the GPU is not enough: the processor draws this scene from now on. Open it again to try the GPU once more."


@dataclass(frozen=True)
class ViewRequest:
    """One instant to draw."""

    frame: float
    view_state: ViewState
    spans: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # first and last colour of layers; else of this frame
    splats: bool = True  # whether the Gaussians are wanted too, for the 3D view
    #: While time runs or is scrubbed: masks are decoded pixel by pixel, which needs no superpixels. The exact ones follow in the end.
    quick: bool = False
    camera: Camera | None = None  # where the frame is rendered from; None for the surgeon's camera
    #: Reads the labels of a frame that is shown as it was recorded instead of the layer, where the recording is there: what one labels.
    labels: Callable[[], object] | None = None


@dataclass(frozen=True)
class View:
    """One instant, drawn."""

    frame: float
    camera: Camera
    rgb: np.ndarray  # uint8 [H, W, 3]
    layer: str  # that the colour bar tells of
    span: tuple[float, float] | None  # of the colour bar, as unit and cmap; None for layers that are colours already
    unit: str
    cmap: str
    observed: np.ndarray | None  # uint8 [H, W, 3]; the clip's own frame, when it is compared and still there
    splats: Gaussians | None
    #: uint8 [H, W, 4]; masks of the visible prompts; None when there are none, or not yet (`complete` is False then).
    masks: np.ndarray | None = None
    complete: bool = True
    beyond: tuple[bool, bool] = (False, False)  # whether values lie below and above the span
    spans: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # of every drawn layer of numbers
    uncertain: str = ""  # what the hatched pixels mean; empty when there are none
    notice: str = ""  # what the user should know of how it was drawn


def layer_request(view_state: ViewState, frame: float) -> LayerRequest:
    """The request of a view state to the layers."""
    from degense.engine.layers import LayerRequest

    return LayerRequest(frame, prompt_set=view_state.prompt_set)


def draw_shown(scene: Scene, request: ViewRequest) -> Generator[View, None, View]:
    """`draw_view` of a scene that is open in a window. Where the memory of the GPU is not enough, the processor draws it from here on."""
    try:
        return (yield from draw_view(scene, request))
    except Exception as error:
        if not is_out_of_memory(error) or scene.device.type == "cpu":
            raise
    scene.move_to("cpu")
    return replace((yield from draw_view(scene, request)), notice=GPU_FULL)


def draw_view(scene: Scene, request: ViewRequest) -> Generator[View, None, View]:
    """Draw an instant. Yields the view without masks as soon as it is there, so that what is more urgent than masks can be done; returns it
    with them."""
    from degense.engine.scene.clip_query import encode_prompts

    view_state, frame = request.view_state, request.frame
    _read(request.labels)
    layers = drawn_layers(scene, view_state)
    masked = view_state.visible_prompts if view_state.masks_shown and not any(layer.name in PROMPTED for layer, _ in layers) else ()
    if masked:
        scene.splats(frame, semantics=True)  # frame and masks from one evaluation of the field
    query = replace(layer_request(view_state, frame), camera=request.camera, pixelwise=request.quick)
    frame_layers = [_coloured(scene, layer, query, request) for layer, _ in layers]
    numbers = numbers_of(layers, view_state)
    shown = frame_layers[numbers]
    view = View(
        frame=frame,
        camera=request.camera or scene.camera(frame),
        rgb=blended([part.rgb for part in frame_layers], [opacity for _, opacity in layers]),
        layer=layers[numbers][0].name,
        span=shown.span,
        unit=shown.unit,
        cmap=shown.cmap,
        beyond=shown.beyond,
        spans={layer.name: part.span for (layer, _), part in zip(layers, frame_layers, strict=True) if part.span is not None},
        observed=scene.observed(round(frame)) if view_state.compare != "off" and request.camera is None else None,
        splats=splat_arrays(scene, layers, query, view_state, [part.span for part in frame_layers]) if request.splats else None,
        uncertain=shown.uncertain,
    )
    if request.labels is not None and (recorded := scene.observed(round(frame))) is not None:
        view = replace(view, rgb=recorded, span=None, uncertain="")
    if not masked:
        return view
    early = replace(view, complete=False)
    yield early
    semantics = scene.query(frame, query.camera)
    yield early  # by now the 3D view may have been asked for
    labels = semantics.decode(encode_prompts(scene, query.prompt_set), query.pixelwise).labels
    # Numbers and differences keep their colours: outlines only.
    fill = 0.0 if shown.span is not None or view_state.compare == "difference" else MASK_FILL
    return replace(view, masks=mask_overlay([(labels == index, prompt.colour) for index, prompt in enumerate(masked)], fill))


def drawn_layers(scene: Scene, view_state: ViewState) -> list[tuple[Layer, float]]:
    """The layers that make up the frame with their opacities, from the bottom up; those that the scene cannot show are left out.

    DegenseError when the chosen one is among these.
    """
    texts = tuple(prompt.text for prompt in view_state.visible_prompts)
    layers = []
    for blend in view_state.drawn:
        layer = get_layer(blend.name)
        if not (missing := layer.missing(scene, texts)):
            layers.append((layer, blend.opacity))
        elif blend.name == view_state.layer:
            raise DegenseError(f"{layer.title} cannot be shown: {missing}.")
    return layers


def numbers_of(layers: list[tuple[Layer, float]], view_state: ViewState) -> int:
    """Which of the drawn layers the colour bar tells of: the chosen one, or the topmost of numbers where that has none."""
    chosen = next(index for index, (layer, _) in enumerate(layers) if layer.name == view_state.layer)
    scalars = [index for index, (layer, _) in enumerate(layers) if layer.kind == "scalar"]
    return chosen if chosen in scalars or not scalars else scalars[-1]


def blended(images: list[np.ndarray], opacities: list[float]) -> np.ndarray:
    """Images laid over each other from the bottom up, uint8 or float32 of one shape; the lowest covers everything."""
    below = images[0]
    for image, opacity in zip(images[1:], opacities[1:], strict=True):
        below = cv2.addWeighted(image, opacity, below, 1 - opacity, 0)
    return below


@dataclass(frozen=True)
class _Coloured:
    """A layer in colours, uint8 [H, W, 3], and what its colour bar says; `span` is None for layers that are colours already."""

    rgb: np.ndarray
    span: tuple[float, float] | None
    unit: str
    cmap: str
    beyond: tuple[bool, bool]
    uncertain: str


def _coloured(scene: Scene, layer: Layer, query: LayerRequest, request: ViewRequest) -> _Coloured:
    from degense.engine.layers import layer_range
    from degense.engine.layers.layer import colourise as layer_colours

    view_state = request.view_state
    if layer.name == "rgb":
        return _Coloured(scene.render_rgb(query.frame, query.camera), None, "", layer.cmap, (False, False), "")
    chosen = view_state.range(layer.name)
    image, cmap = layer.image(scene, query), chosen.cmap or layer.cmap
    span = (request.spans.get(layer.name) or layer_range(scene, layer, query, "frame", chosen.clip)) if image.kind == "scalar" else None
    rgb = mask_colours(view_state)[image.values] if image.kind == "mask" else layer_colours(image, *(span or (0.0, 1.0)), cmap)
    guess = layer.guess if image.uncertain is not None and image.uncertain.any() else ""
    return _Coloured(rgb, span, image.unit, cmap, beyond(image.values, *span) if span else (False, False), guess)


def splat_arrays(
    scene: Scene, layers: list[tuple[Layer, float]], query: LayerRequest, view_state: ViewState, spans: list[tuple[float, float] | None]
) -> Gaussians:
    """The Gaussians of an instant in the colours of the layers, tinted where a visible prompt finds them."""
    from degense.widgets.splats.gaussians import Gaussians

    splats = scene.splats(query.frame)
    colours = [_splat_colours(scene, layer, query, view_state, span) for (layer, _), span in zip(layers, spans, strict=True)]
    mixed = blended(colours, [opacity for _, opacity in layers])
    means, quats, scales, opacities = (tensor.cpu().numpy() for tensor in (splats.means, splats.quats, splats.scales, splats.opacities))
    return Gaussians(means, quats, scales, opacities, mixed)


def _splat_colours(scene: Scene, layer: Layer, query: LayerRequest, view_state: ViewState, span: tuple[float, float] | None) -> np.ndarray:
    """A layer's colours of the Gaussians, float32 [N, 3] (1 is full): the model's own unclipped, since only pixels are clipped."""
    values = layer.splats(scene, query)
    if layer.kind == "mask":
        return mask_colours(view_state)[values].astype(np.float32) / 255
    if layer.kind == "scalar":
        colours = colourise(values, view_state.range(layer.name).cmap or layer.cmap, *(span or (0.0, 1.0)))
        uncertain = layer.uncertain_splats(scene, query)
        return (colours if uncertain is None else greyed(colours, uncertain)).astype(np.float32) / 255
    if query.prompt_set.prompts and view_state.masks_shown:
        values = tinted(values, get_layer("mask").splats(scene, query), view_state)
    return values.astype(np.float32)


def tinted(colours: np.ndarray, found: np.ndarray, view_state: ViewState) -> np.ndarray:
    """Colours [N, 3] (1 is full) mixed with those of the prompts that found each Gaussian (`found` [N]: 0 none, k the k-th)."""
    share = np.where(found > 0, MASK_FILL * view_state.overlay_opacity, 0.0)[:, None]
    return colours * (1 - share) + mask_colours(view_state)[found] / 255 * share


def mask_colours(view_state: ViewState) -> np.ndarray:
    """Colours of the mask layer's values, uint8 [256, 3]: dark grey for nothing, then the visible prompts in their order."""
    table = np.full((256, 3), NO_MASK, np.uint8)
    for index, prompt in enumerate(view_state.visible_prompts, 1):
        table[index] = prompt.colour
    return table


def _read(labels: Callable[[], object] | None) -> None:
    """Read labels here, where nobody waits for the drive; a file that is damaged is told of where it is shown."""
    if labels is not None:
        with suppress(DegenseError):
            labels()


def draw_clip(clip: Clip, frame: int, labels: Callable[[], object] | None = None) -> View:
    """A frame of a clip that has no run, with the pixels that will not be reconstructed laid over it; `labels` as in `ViewRequest`."""
    _read(labels)
    invalid = ~clip.valid(frame)
    masks = mask_overlay([(invalid, EXCLUDED)], MASK_FILL) if invalid.any() else None
    return View(frame, clip.cameras[frame], clip.frame(frame), "rgb", None, "", "", None, None, masks)


@lru_cache
def _device() -> str:
    """Where splats of the 3D view are drawn; asked once, since to look for compiled kernels reads folders."""
    return "cuda" if gpu_usable() else "cpu"


def draw_snapshot(request: SnapshotRequest) -> np.ndarray:
    """Splats as the 3D view wants them, drawn by the rasterizer, with the guides over them, uint8 [H, W, 3]; where the memory of the GPU is
    not enough, by the processor."""
    try:
        return _snapshot(request, _device())
    except Exception as error:
        if not is_out_of_memory(error) or _device() == "cpu":
            raise
    return _snapshot(request, "cpu")


def _snapshot(request: SnapshotRequest, device: str) -> np.ndarray:
    import torch

    from degense.engine.raster import camera_depths, rasterize
    from degense.engine.splats import Splats

    values = (*request.gaussians, np.empty((len(request.gaussians.means), 0), np.float32))
    splats = Splats(*(torch.from_numpy(np.ascontiguousarray(array)) for array in values)).to(device)
    features, background = splats.colors, torch.tensor(request.background, dtype=torch.float32, device=device) / 255
    if request.guides:
        features = torch.cat([features, camera_depths(splats.means, request.camera)[:, None]], 1)
        background = torch.cat([background, background.new_zeros(1)])
    drawn = rasterize(splats, features, request.camera, background=background)
    image = drawn.image[..., :3].clamp_(0, 1).mul_(255).add_(0.5).byte().cpu().numpy()  # in place: each copy takes megabytes
    if not request.guides:
        return image
    from degense.widgets.splats.guides import lay_over

    depth = torch.where(drawn.alpha > HIDES, drawn.image[..., 3] / drawn.alpha, torch.inf)
    return lay_over(image, depth.cpu().numpy(), request.guides, request.camera, request.stretch)

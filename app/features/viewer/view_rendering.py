"""What both views show at one instant, drawn without a window."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.viewer.layer_images import beyond, get_layer
from degense.app.session.view_state import ViewState
from degense.engine.colour_maps import colourise, greyed, mask_overlay
from degense.engine.errors import DegenseError
from degense.widgets.splats.gaussians import Gaussians

if TYPE_CHECKING:
    from degense.engine.camera import Camera
    from degense.engine.clip import Clip
    from degense.engine.layers import Layer, LayerRequest
    from degense.engine.scene import Scene
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


@dataclass(frozen=True)
class ViewRequest:
    """One instant to draw."""

    frame: float
    view_state: ViewState
    span: tuple[float, float] | None = None  # values of the first and last colour; None for the range of this frame
    splats: bool = True  # whether the Gaussians are wanted too, for the 3D view
    #: While time runs or is scrubbed: masks are decoded pixel by pixel, which needs no superpixels. The exact ones follow in the end.
    quick: bool = False
    camera: Camera | None = None  # where the frame is rendered from; None for the surgeon's camera
    recorded: bool = False  # show the recorded frame instead of the layer, where it is there: what one labels


@dataclass(frozen=True)
class View:
    """One instant, drawn."""

    frame: float
    camera: Camera
    rgb: np.ndarray  # uint8 [H, W, 3]
    span: tuple[float, float] | None  # of the colour bar, as unit and cmap; None for layers that are colours already
    unit: str
    cmap: str
    observed: np.ndarray | None  # uint8 [H, W, 3]; the clip's own frame, when it is compared and still there
    splats: Gaussians | None
    #: uint8 [H, W, 4]; masks of the visible prompts; None when there are none, or not yet (`complete` is False then).
    masks: np.ndarray | None = None
    complete: bool = True
    beyond: tuple[bool, bool] = (False, False)  # whether values lie below and above the span
    uncertain: str = ""  # what the hatched pixels mean; empty when there are none


def layer_request(view_state: ViewState, frame: float) -> LayerRequest:
    """The request of a view state to the layers."""
    from degense.engine.layers import LayerRequest

    return LayerRequest(frame, prompt_set=view_state.prompt_set)


def draw_view(scene: Scene, request: ViewRequest) -> Generator[View, None, View]:
    """Draw an instant. Yields the view without masks as soon as it is there; returns it with them."""
    from degense.engine.layers import layer_range
    from degense.engine.layers.layer import colourise as layer_colours
    from degense.engine.scene.clip_query import decode_frame

    view_state, frame = request.view_state, request.frame
    layer = get_layer(view_state.layer)
    masked = view_state.visible_prompts if view_state.masks_shown and layer.name not in PROMPTED else ()
    if missing := layer.missing(scene, tuple(prompt.text for prompt in view_state.visible_prompts)):
        raise DegenseError(f"{layer.title} cannot be shown: {missing}.")
    if masked:
        scene.splats(frame, semantics=True)  # frame and masks from one evaluation of the field
    query = replace(layer_request(view_state, frame), camera=request.camera, pixelwise=request.quick)
    image = layer.image(scene, query)
    scalar = image.kind == "scalar"
    cmap = view_state.range(layer.name).cmap or layer.cmap
    span = (request.span or layer_range(scene, layer, query, "frame", view_state.range(layer.name).clip)) if scalar else None
    rgb = mask_colours(view_state)[image.values] if image.kind == "mask" else layer_colours(image, *(span or (0.0, 1.0)), cmap)
    view = View(
        frame=frame,
        camera=request.camera or scene.camera(frame),
        rgb=rgb,
        span=span,
        unit=image.unit,
        cmap=cmap,
        beyond=beyond(image.values, *span) if span else (False, False),
        observed=scene.observed(round(frame)) if view_state.compare != "off" and request.camera is None else None,
        splats=splat_arrays(scene, layer, query, view_state, span, cmap) if request.splats else None,
        uncertain=layer.guess if image.uncertain is not None and image.uncertain.any() else "",
    )
    if request.recorded and (recorded := scene.observed(round(frame))) is not None:
        view = replace(view, rgb=recorded, span=None, uncertain="")
    if not masked:
        return view
    yield replace(view, complete=False)
    labels = decode_frame(scene, query.prompt_set, frame, query.camera, query.pixelwise).labels
    fill = 0.0 if scalar or view_state.compare == "difference" else MASK_FILL  # numbers and differences keep their colours: outlines only
    return replace(view, masks=mask_overlay([(labels == index, prompt.colour) for index, prompt in enumerate(masked)], fill))


def splat_arrays(
    scene: Scene, layer: Layer, query: LayerRequest, view_state: ViewState, span: tuple[float, float] | None, cmap: str
) -> Gaussians:
    """The Gaussians of an instant in the layer's colours, tinted where a visible prompt finds them."""
    splats = scene.splats(query.frame)
    values = layer.splats(scene, query)
    if layer.kind == "colour":
        if query.prompt_set.prompts and view_state.masks_shown:
            values = tinted(values, get_layer("mask").splats(scene, query), view_state)
        colours = (values.clip(0, 1) * 255 + 0.5).astype(np.uint8)
    elif layer.kind == "mask":
        colours = mask_colours(view_state)[values]
    else:
        colours = colourise(values, cmap, *(span or (0.0, 1.0)))
        if (uncertain := layer.uncertain_splats(scene, query)) is not None:
            colours = greyed(colours, uncertain)
    means, quats, scales, opacities = (tensor.cpu().numpy() for tensor in (splats.means, splats.quats, splats.scales, splats.opacities))
    return Gaussians(means, quats, scales, opacities, colours)


def tinted(colours: np.ndarray, found: np.ndarray, view_state: ViewState) -> np.ndarray:
    """Colours [N, 3] in [0, 1] mixed with those of the prompts that found each Gaussian (`found` [N]: 0 none, k the k-th)."""
    share = np.where(found > 0, MASK_FILL * view_state.overlay_opacity, 0.0)[:, None]
    return colours * (1 - share) + mask_colours(view_state)[found] / 255 * share


def mask_colours(view_state: ViewState) -> np.ndarray:
    """Colours of the mask layer's values, uint8 [256, 3]: dark grey for nothing, then the visible prompts in their order."""
    table = np.full((256, 3), NO_MASK, np.uint8)
    for index, prompt in enumerate(view_state.visible_prompts, 1):
        table[index] = prompt.colour
    return table


def draw_clip(clip: Clip, frame: int) -> View:
    """A frame of a clip that has no run, with the pixels that will not be reconstructed laid over it."""
    invalid = ~clip.valid(frame)
    masks = mask_overlay([(invalid, EXCLUDED)], MASK_FILL) if invalid.any() else None
    return View(frame, clip.cameras[frame], clip.frame(frame), None, "", "", None, None, masks)


def draw_snapshot(request: SnapshotRequest) -> np.ndarray:
    """Splats as the 3D view wants them, drawn by the rasterizer, with the guides over them, uint8 [H, W, 3]."""
    import torch

    from degense.engine.raster import camera_depths, rasterize
    from degense.engine.splats import Splats

    *shapes, colours = request.gaussians
    values = (*shapes, colours.astype(np.float32) / 255, np.empty((len(colours), 0), np.float32))
    device = "cuda" if torch.cuda.is_available() else "cpu"
    splats = Splats(*(torch.from_numpy(np.ascontiguousarray(array)) for array in values)).to(device)
    features, background = splats.colors, torch.tensor(request.background, dtype=torch.float32, device=device) / 255
    if request.guides:
        features = torch.cat([features, camera_depths(splats.means, request.camera)[:, None]], 1)
        background = torch.cat([background, background.new_zeros(1)])
    drawn = rasterize(splats, features, request.camera, background=background)
    image = (drawn.image[..., :3].clamp(0, 1) * 255 + 0.5).byte().cpu().numpy()
    if not request.guides:
        return image
    from degense.widgets.splats.guides import lay_over

    depth = torch.where(drawn.alpha > HIDES, drawn.image[..., 3] / drawn.alpha, torch.inf)
    return lay_over(image, depth.cpu().numpy(), request.guides, request.camera)

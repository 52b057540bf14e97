"""The layers, one place for the window and the command line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.layers.appearance import APPEARANCE
from degense.engine.layers.kinematics import ROTATION, SCALE, SPEED
from degense.engine.layers.layer import MOVED, Layer, LayerRequest
from degense.engine.motion.observed import contradicted
from degense.engine.scene import NO_OBSERVABILITY, Scene
from degense.engine.scene.clip_query import decode_frame, decode_splats, splat_semantics
from degense.engine.scene.uncertainty import DOUBTFUL, NEIGHBOURS, RELATIVE, SPREADS, SURE
from degense.engine.semantics.prompts import PromptSet

LEAST_WARP = 3.0  # pixels to which the colours of the warp layer reach at least: a few tenths, which flow itself is off by, stay dark


def _as_colours(scene: Scene, latents: np.ndarray) -> np.ndarray:
    if not scene.has_semantics:
        raise DegenseError(f"{scene.name} was trained without semantics, so it has no features to show")
    direction = latents / np.maximum(np.linalg.norm(latents, axis=-1, keepdims=True), 1e-6)
    return np.clip(direction @ scene.states.feature_axes * 0.5 + 0.5, 0, 1).astype(np.float32)


def _features(scene: Scene, request: LayerRequest) -> np.ndarray:
    return _as_colours(scene, scene.render(request.frame, request.camera, ("latent",))["latent"])


def _features_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return _as_colours(scene, scene.splats(request.frame, semantics=True).semantics.cpu().numpy())


def _prompted(request: LayerRequest) -> PromptSet:
    if not request.prompt_set.prompts:
        raise DegenseError("this layer shows what a prompt finds; give at least one prompt")
    return request.prompt_set


def _included(scene: Scene, request: LayerRequest) -> np.ndarray:
    return np.concatenate([scene.included(text) for text in _prompted(request).prompts])


def _similarity(scene: Scene, request: LayerRequest) -> np.ndarray:
    return scene.query(request.frame, request.camera).similarity(_included(scene, request))


def _similarity_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    included = _included(scene, request)
    return splat_semantics(scene, request.frame).similarity(included)[0]


def _mask(scene: Scene, request: LayerRequest) -> np.ndarray:
    return decode_frame(scene, _prompted(request), request.frame, request.camera, request.pixelwise).numbers


def _mask_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return decode_splats(scene, _prompted(request), request.frame).numbers


def _channel(name: str) -> Callable[[Scene, LayerRequest], np.ndarray]:
    return lambda scene, request: scene.render(request.frame, request.camera, (name,))[name]


def _rgb_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return scene.splats(request.frame).colors.cpu().numpy()


def _depth_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    camera = request.camera or scene.camera(request.frame)
    return camera.project(scene.splats(request.frame).means.cpu().numpy())[1].astype(np.float32)


def _displacement(scene: Scene, request: LayerRequest) -> np.ndarray:
    together = request.camera is None and scene.observability is not None
    return scene.render(request.frame, request.camera, MOVED if together else MOVED[:1])["displacement"]


def _observability_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    if scene.observability is None:
        raise DegenseError(f"{scene.name} {NO_OBSERVABILITY}")
    return scene.observability.cpu().numpy()


def _uncertainty_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    if scene.observability is None:
        raise DegenseError(f"{scene.name} {NO_OBSERVABILITY}")
    return scene.states.uncertainty(request.frame).cpu().numpy()


def _displacement_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    return scene.states.displacement(request.frame).cpu().numpy()


def _warp(scene: Scene, request: LayerRequest) -> np.ndarray:
    frame = round(request.frame)
    if request.camera is not None:
        raise DegenseError("warp is measured in the recording's own view; look through the surgeon's camera to see it")
    modelled = scene.render(frame, None, ("motion",))["motion"]
    return contradicted(modelled, scene.observed_motion.at(frame))


def _warp_guessed(scene: Scene, request: LayerRequest) -> np.ndarray:
    observed = scene.observed_motion.at(round(request.frame))
    return ~observed.seen & np.isfinite(observed.spread)


def _warp_splats(scene: Scene, request: LayerRequest) -> np.ndarray:
    """Each Gaussian takes the warp of the pixel it falls on, when it lies on the visible surface there."""
    warp = _warp(scene, LayerRequest(round(request.frame)))
    camera = scene.camera(request.frame)
    position, z = camera.project(scene.splats(request.frame).means.cpu().numpy())
    depth = scene.render(round(request.frame), None, ("depth",))["depth"]
    column, row = np.floor(position).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    column, row = np.where(inside, column, 0), np.where(inside, row, 0)
    on_surface = inside & (np.abs(z - depth[row, column]) < 0.05 * np.abs(z))
    return np.where(on_surface, warp[row, column], np.nan).astype(np.float32)


LAYERS: dict[str, Layer] = {
    layer.name: layer
    for layer in (
        Layer("rgb", "colour", "The reconstructed colours, alpha-blended.", _channel("rgb"), _rgb_splats),
        Layer(
            "depth",
            "scalar",
            "Distance along the viewing axis, Σ z·w / Σ w over the Gaussians of a pixel.",
            _channel("depth"),
            _depth_splats,
            lambda scene: scene.unit,
            "cividis",
        ),
        Layer(
            "features",
            "colour",
            "Direction of the semantic latent, along the three axes in which this scene's latents differ most, as red, green and blue.",
            _features,
            _features_splats,
            needs_semantics=True,
        ),
        Layer(
            "similarity",
            "scalar",
            "Cosine between the pixel's latent and the prompt's text vector; with several prompts the largest.",
            _similarity,
            _similarity_splats,
            lambda scene: "cosine",
            "magma",
            fixed_range=(0.0, 1.0),
            needs_semantics=True,
            needs_prompt=True,
        ),
        Layer(
            "mask",
            "mask",
            "Which prompt finds each pixel: superpixel means of the similarity, guided filter, threshold, holes filled (decoder rnse), "
            "or the plain decoders. Where masks overlap, the most similar prompt.",
            _mask,
            _mask_splats,
            needs_semantics=True,
            needs_prompt=True,
        ),
        Layer(
            "displacement",
            "scalar",
            "How far tissue has moved since the reference frame: ‖μ(t) − μ(reference)‖, blended over the Gaussians of a pixel. "
            "Instruments, blood and char that come and go are looked through: what counts is the tissue behind them. "
            f"Hatched where it may be off by more than {DOUBTFUL:.0%} of the scene's depth and {RELATIVE:.0%} of itself: a guess "
            f"(layer Displacement uncertainty). Elsewhere nine of ten places are within {SURE:.1%} of the depth.",
            _displacement,
            _displacement_splats,
            lambda scene: scene.unit,
            guess="hatched: a guess, motion not seen well",
            from_zero=True,
            of_motion=True,
        ),
        Layer(
            "uncertainty",
            "scalar",
            "How far off the displacement may be; in nine of ten places it is nearer. "
            f"{SPREADS:g}·√mean‖u − uᵢ‖² over the nearest {NEIGHBOURS} Gaussians whose motion the recording reveals, u the displacements: "
            "a place without evidence shows what its neighbours say, and is as uncertain as they differ from it.",
            _channel("uncertainty"),
            _uncertainty_splats,
            lambda scene: scene.unit,
            "magma",
            guess="hatched: displacement here counts as a guess",
            from_zero=True,
            needs_observability=True,
        ),
        SPEED,
        ROTATION,
        SCALE,
        APPEARANCE,
        Layer(
            "warp",
            "scalar",
            "How far the motion since the reference frame, projected to pixels, is from what the recording shows; some tenths of a pixel "
            "are its own error. Hatched where the recording does not show how a place moved, because it is plain, hidden or looks "
            "otherwise than before, as burnt tissue does: there the motion of what is around it is the measure, as much of that as the "
            "place had before, and the more that varies the nearer is the value to a pixel or so, unless the model is far from all of it.",
            _warp,
            _warp_splats,
            lambda scene: "px",
            "magma",
            guesses=_warp_guessed,
            guess="hatched: measured against the motion around it",
            from_zero=True,
            least_range=LEAST_WARP,
            of_motion=True,
            needs_clip=True,
        ),
        Layer(
            "observability",
            "scalar",
            "In which share of the frames the recording reveals how far tissue has moved: seen, no instrument, optical flow the same "
            "forwards and backwards, on texture that pins it down.",
            _channel("observability"),
            _observability_splats,
            cmap="cividis",
            fixed_range=(0.0, 1.0),
            needs_observability=True,
        ),
    )
}

"""Curves over time at a place: values of layers, similarities and areas, and their table."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.view_rendering import layer_request
from degense.app.session.targets import Found, Target, material
from degense.app.session.view_state import ViewState
from degense.engine.layer_titles import with_unit
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.engine.layers import Layer, LayerRequest
    from degense.engine.scene import Scene

#: Layers that are always followed; they cost little.
ALWAYS = ("displacement", "speed", "rotation", "scale")
#: Share of the place between the two edges of a band, in percentiles.
BAND = (10.0, 90.0)


@dataclass(frozen=True)
class Curves:
    """Values over time at a place."""

    frames: np.ndarray  # int [T]
    #: Of each followed layer, float [3, T], the mean over the place and its 10th and 90th percentile, in its unit; NaN where
    #: nothing is known.
    layers: dict[str, np.ndarray]
    units: dict[str, str]
    where: str  # which place, in words
    similarity: dict[str, np.ndarray] = field(default_factory=dict)  # cosine to each prompt, float [T]
    area: np.ndarray | None = None  # float [T]; of a mask: share of the frame it covers
    trail: np.ndarray | None = None  # float [T, 3]; where the material is, world coordinates


def followed_layers(scene: Scene, view_state: ViewState) -> list[Layer]:
    """Those of `ALWAYS`, and the layer that is shown when it holds numbers."""
    layers = [get_layer(name) for name in ALWAYS]
    shown = get_layer(view_state.layer)
    if (
        shown.kind == "scalar"
        and shown not in layers
        and not shown.missing(scene, tuple(prompt.text for prompt in view_state.visible_prompts))
    ):
        layers.append(shown)
    return layers


def follow(scene: Scene, place: Target, view_state: ViewState) -> Steps[Curves]:
    """Follow a place through the whole sequence. Yields (fraction, words).

    A spot or a region is followed as material: the mean over its Gaussians, wherever they go. What a prompt finds is decoded in each
    frame anew: the mean over the pixels of its mask. DegenseError when nothing is reconstructed at the place, or the prompt cannot be
    answered.
    """
    layers = followed_layers(scene, view_state)
    texts = tuple(prompt.text for prompt in view_state.visible_prompts)
    values = {layer.name: np.full((3, scene.frames), np.nan) for layer in layers}
    curves = Curves(np.arange(scene.frames), values, {layer.name: layer.unit(scene) for layer in layers}, str(place))
    yield 0.0, "finding the place"
    if isinstance(place, Found):
        curves = replace(curves, area=np.zeros(scene.frames))
        measure = _pixels(scene, place, curves)
    else:
        curves = replace(curves, trail=np.zeros((scene.frames, 3)))
        if scene.has_semantics:
            curves = replace(curves, similarity={text: np.zeros(scene.frames) for text in texts})
        measure = _gaussians(scene, *material(scene, place), curves)
    for frame in range(scene.frames):
        yield frame / scene.frames, f"frame {frame}"
        request = layer_request(view_state, frame)
        for layer, (numbers, weights) in measure(request, layers).items():
            values[layer][:, frame] = summary(numbers, weights)
    return curves


Measure = Callable[["LayerRequest", "list[Layer]"], "dict[str, tuple[np.ndarray, np.ndarray]]"]


def _gaussians(scene: Scene, indices: np.ndarray, weights: np.ndarray, curves: Curves) -> Measure:
    assert not curves.similarity or scene.basis is not None
    included = {text: scene.basis.project(scene.included(text)) for text in curves.similarity} if scene.basis is not None else {}

    def measure(request: LayerRequest, layers: list[Layer]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        assert curves.trail is not None
        curves.trail[int(request.frame)] = weights @ scene.splats(request.frame).means[indices].cpu().numpy()
        if included:
            latent = weights @ scene.splats(request.frame, semantics=True).semantics[indices].cpu().numpy()
            latent /= max(1e-12, float(np.linalg.norm(latent)))
            for text, rows in included.items():
                curves.similarity[text][int(request.frame)] = (rows @ latent).max()
        return {layer.name: (layer.splats(scene, request)[indices], weights) for layer in layers}

    return measure


def _pixels(scene: Scene, place: Found, curves: Curves) -> Measure:
    from degense.engine.scene.clip_query import decode_frame

    def measure(request: LayerRequest, layers: list[Layer]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        [mask] = decode_frame(scene, replace(request.prompt_set, prompts=(place.prompt,)), request.frame).masks
        assert curves.area is not None
        curves.area[int(request.frame)] = mask.mean()
        return {layer.name: (layer.pixels(scene, request)[mask], np.ones(int(mask.sum()))) for layer in layers}

    return measure


def summary(numbers: np.ndarray, weights: np.ndarray) -> tuple[float, float, float]:
    """Weighted mean, 10th and 90th weighted percentile of what is finite; NaN when nothing is."""
    known = np.isfinite(numbers)
    numbers, weights = numbers[known].astype(np.float64), weights[known]
    if not weights.sum() > 0:
        return np.nan, np.nan, np.nan
    order = np.argsort(numbers)
    share = (np.cumsum(weights[order]) - 0.5 * weights[order]) / weights.sum()
    low, high = np.interp(np.array(BAND) / 100, share, numbers[order])
    return float(np.average(numbers, weights=weights)), float(low), float(high)


def means(curves: Curves, frame: int) -> list[tuple[str, str]]:
    """Name and text of each mean over the place at a frame."""
    rows = [(name, f"{band[0, frame]:.3g} {curves.units[name]}".strip()) for name, band in curves.layers.items()]
    return rows if curves.area is None else [*rows, ("area", f"{curves.area[frame]:.2%} of the frame")]


def to_csv(curves: Curves) -> str:
    """A table with a row for each frame; units stand in the heads of the columns."""
    columns: dict[str, np.ndarray] = {"frame": curves.frames}
    for name, band in curves.layers.items():
        for kind, values in zip(("mean", *(f"{share:.0f}th percentile" for share in BAND)), band, strict=True):
            columns[with_unit(f"{name} {kind}", curves.units[name])] = values
    columns |= {f"similarity to {text} [cosine]": values for text, values in curves.similarity.items()}
    if curves.area is not None:
        columns["area [share of the picture]"] = curves.area
    return table_of(columns)


def table_of(columns: dict[str, np.ndarray]) -> str:
    """Comma-separated values with a head; what is not finite is left empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow("" if isinstance(value, float) and not np.isfinite(value) else f"{value:.6g}" for value in row)
    return out.getvalue()

"""Layers over each other in one picture of a movie, as they are written: `rgb+displacement:0.5`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from degense.app.features.viewer.layer_images import get_layer
from degense.app.session.view_state import LAYER_ORDER, LayerBlend, ViewState
from degense.engine.errors import DegenseError

if TYPE_CHECKING:
    from degense.engine.layers import Layer
    from degense.engine.scene import Scene

#: Opacity of a layer of which none is written.
OPACITY = LayerBlend("").opacity


@dataclass(frozen=True)
class LayerStack:
    """Names and opacities from the bottom up; the lowest covers everything."""

    layers: tuple[tuple[str, float], ...]

    @staticmethod
    def read(text: str) -> LayerStack:
        """What `str` wrote. DegenseError for a layer that there is not, one that is named twice, and what is no opacity."""
        layers: list[tuple[str, float]] = []
        for part in text.split("+"):
            name, colon, share = part.partition(":")
            layer = get_layer(name.strip()).name
            if layer in (other for other, _ in layers):
                raise DegenseError(f"{text} names {layer} twice; name each layer once.")
            if colon and not layers:
                raise DegenseError(f"In {text}, {layer} is the lowest and covers everything; leave out its opacity.")
            layers.append((layer, _opacity(share, text) if colon else OPACITY if layers else 1.0))
        return LayerStack(tuple(layers))

    @staticmethod
    def of(drawn: Sequence[LayerBlend]) -> LayerStack:
        """These layers of a view, of which there is at least one."""
        return LayerStack(((drawn[0].name, 1.0), *((blend.name, blend.opacity) for blend in drawn[1:])))

    def __str__(self) -> str:
        (lowest, _), *others = self.layers
        return "+".join([lowest, *(f"{name}:{opacity:g}" for name, opacity in others)])

    @property
    def title(self) -> str:
        return " + ".join(get_layer(name).title for name, _ in self.layers)

    @property
    def numbers(self) -> Layer:
        """That of which a colour bar tells: the topmost of numbers, else the topmost."""
        found = [get_layer(name) for name, _ in self.layers]
        return next((layer for layer in reversed(found) if layer.kind == "scalar"), found[-1])

    def view_state(self, of: ViewState) -> ViewState:
        """A view of these layers, alike in everything else."""
        shown = tuple(LayerBlend(name, True, opacity) for name, opacity in self.layers)
        rest = tuple(blend for blend in LAYER_ORDER if blend.name not in dict(self.layers))
        return replace(of, layer=self.layers[-1][0], blend=(*shown, *rest), compare="off")

    def check(self, scene: Scene, prompts: tuple[str, ...]) -> None:
        """DegenseError when a scene cannot show one of them."""
        for name, _ in self.layers:
            layer = get_layer(name)
            if missing := layer.missing(scene, prompts):
                raise DegenseError(f"{layer.title} cannot be shown: {missing}.")


def _opacity(text: str, whole: str) -> float:
    try:
        opacity = float(text)
    except ValueError:
        opacity = -1.0
    if not 0 <= opacity <= 1:
        raise DegenseError(f"In {whole}, {text!r} is no opacity; give a number from 0 to 1, such as rgb+displacement:0.5.")
    return opacity

"""Ranges of the colours of a layer over the whole sequence, computed in the worker."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from degense.app.features.viewer.layer_images import get_layer
from degense.app.features.viewer.view_rendering import layer_request
from degense.app.session.view_state import ViewState
from degense.engine.progress import Steps

if TYPE_CHECKING:
    from degense.app.shell.shell import Shell
    from degense.engine.scene import Scene


Key = tuple[str, tuple[str, ...], float]  # a layer, the prompts that it answers, and the share that is left out at each end


class SequenceRanges:
    """The value of the first and the last colour of each layer that was shown; `found` is called when one that was missing is known."""

    def __init__(self, shell: Shell, found: Callable[[], None], failed: Callable[[str], None]) -> None:
        self._shell, self._found, self._failed = shell, found, failed
        self._ranges: dict[Key, tuple[float, float]] = {}
        self._asked: Key | None = None  # what the worker computes

    def clear(self) -> None:
        self._ranges.clear()
        self._asked = None
        self._shell.worker.cancel("range")

    def ranges(self, scene: Scene, view_state: ViewState) -> dict[str, tuple[float, float]]:
        """The ranges of the layers that are drawn, by name. Left out are those that have that of their frame, and those not known yet.

        One that is missing is computed, that of the chosen layer first.
        """
        ranges, missing = {}, []
        for name in sorted((blend.name for blend in view_state.drawn), key=lambda name: name != view_state.layer):
            chosen, layer = view_state.range(name), get_layer(name)
            texts = tuple(prompt.text for prompt in view_state.visible_prompts) if layer.needs_prompt else ()
            key = (name, texts, chosen.clip)
            if chosen.mode == "fixed":
                ranges[name] = chosen.low, chosen.high
            elif chosen.mode == "sequence" and layer.kind == "scalar" and key in self._ranges:
                ranges[name] = self._ranges[key]
            elif chosen.mode == "sequence" and layer.kind == "scalar" and not layer.missing(scene, texts):
                missing.append(key)
        if missing and missing[0] != self._asked:
            self._compute(missing[0], scene, replace(view_state, layer=missing[0][0]))
        return ranges

    def _compute(self, key: Key, scene: Scene, view_state: ViewState) -> None:
        shell, self._asked = self._shell, key

        def found(span: tuple[float, float]) -> None:
            self._ranges[key], self._asked = span, None
            shell.set_busy()
            self._found()

        def failed(message: str) -> None:
            self._asked = None
            shell.set_busy()
            self._failed(message)

        def progress(step: tuple[float, str]) -> None:
            shell.set_busy("Range of the whole sequence", step[0])

        shell.worker.submit("range", lambda: _sequence_range(scene, view_state), found, failed, progress)


def _sequence_range(scene: Scene, view_state: ViewState) -> Steps[tuple[float, float]]:
    """The range of a layer over the whole sequence. Its frames are drawn one a step, and cached by the scene."""
    from degense.engine.layers.layer import SEQUENCE_SAMPLES, layer_range

    layer, request = get_layer(view_state.layer), layer_request(view_state, 0)
    frames = [round(index * (scene.frames - 1) / max(1, SEQUENCE_SAMPLES - 1)) for index in range(SEQUENCE_SAMPLES)]
    for done, frame in enumerate(frames):
        yield done / len(frames), "range"
        layer.image(scene, replace(request, frame=float(frame)))
    return layer_range(scene, layer, request, "sequence", view_state.range(view_state.layer).clip)

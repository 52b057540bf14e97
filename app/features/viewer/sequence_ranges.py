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


class SequenceRanges:
    """The value of the first and the last colour of each layer that was shown; `found` is called when one that was missing is known."""

    def __init__(self, shell: Shell, found: Callable[[], None], failed: Callable[[str], None]) -> None:
        self._shell, self._found, self._failed = shell, found, failed
        self._ranges: dict[tuple[str, tuple[str, ...], float], tuple[float, float]] = {}

    def clear(self) -> None:
        self._ranges.clear()
        self._shell.worker.cancel("range")

    def range(self, scene: Scene, view_state: ViewState) -> tuple[float, float] | None:
        """The range of the layer that is shown; None for that of its frame, also until the one of the sequence is known."""
        chosen, layer = view_state.range(view_state.layer), get_layer(view_state.layer)
        if chosen.mode == "fixed":
            return chosen.low, chosen.high
        if chosen.mode == "frame" or layer.kind != "scalar":
            return None
        texts = tuple(prompt.text for prompt in view_state.visible_prompts) if layer.needs_prompt else ()
        key = (view_state.layer, texts, chosen.clip)
        if key not in self._ranges and not layer.missing(scene, texts):
            self._compute(key, scene, view_state)
        return self._ranges.get(key)

    def _compute(self, key: tuple[str, tuple[str, ...], float], scene: Scene, view_state: ViewState) -> None:
        shell = self._shell

        def found(span: tuple[float, float]) -> None:
            self._ranges[key] = span
            shell.set_busy()
            self._found()

        def failed(message: str) -> None:
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

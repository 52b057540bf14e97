"""What is shown of a scene and how: the undoable, saveable part of a session, as one immutable value."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from degense.engine.colour_maps import CLASS_COLOURS
from degense.engine.errors import RunError, what_is_wrong
from degense.engine.layer_titles import LAYER_TITLES

if TYPE_CHECKING:
    from degense.engine.semantics.prompts import PromptSet

RangeMode = Literal["frame", "sequence", "fixed"]
Compare = Literal["off", "wipe", "blink", "difference"]
Colour = tuple[int, int, int]

#: The first seven of the classes (Okabe and Ito), in the order of the engine's mask layer; white last.
PROMPT_COLOURS: tuple[Colour, ...] = (*CLASS_COLOURS[:7], (255, 255, 255))


#: Each decoder that works pixel by pixel, and the one that decides alike on regions and along the edges of the frame; and back.
REFINED = {"threshold": "rnse", "argmax": "rnse+argmax"}
COARSE = {"rnse": "threshold", "rnse-paper": "threshold", "rnse+argmax": "argmax"}


def decoder_refined(decoder: str, refined: bool) -> str:
    """The decoder that decides as `decoder` does, refined or coarse."""
    return (REFINED if refined else COARSE).get(decoder, decoder)


@dataclass(frozen=True)
class Prompt:
    """A text whose mask is shown, or, when `negative`, one that takes pixels from the masks of the others.

    Texts are unique in a view state, whatever their case.
    """

    text: str
    colour: Colour
    visible: bool = True
    negative: bool = False


@dataclass(frozen=True)
class ColourRange:
    """How the values of a scalar layer become colours."""

    mode: RangeMode = "sequence"  # the range of this frame, of the whole sequence, or fixed from `low` to `high`
    low: float = 0.0
    high: float = 1.0
    cmap: str = ""  # colour map; empty for the layer's own
    clip: float = 1.0  # percentage of the values left out at each end of the ranges of a frame and of the sequence


@dataclass(frozen=True)
class LayerBlend:
    """How a layer takes part in the frame."""

    name: str
    visible: bool = False  # drawn besides the chosen layer
    opacity: float = 0.6  # over what lies below it; the lowest layer that is drawn covers everything


#: All layers from the bottom up, as they lie before anybody moves them.
LAYER_ORDER = tuple(LayerBlend(name) for name in LAYER_TITLES)


@dataclass(frozen=True)
class ViewState:
    """Layers, prompts and colours of the view. Change it with `dataclasses.replace` through `Session.edit`."""

    layer: str = "rgb"  # the chosen one: always drawn, its numbers are shown and its worst places listed
    blend: tuple[LayerBlend, ...] = LAYER_ORDER  # all layers from the bottom up
    prompts: tuple[Prompt, ...] = ()
    threshold: float = 0.5  # cosine from which a pixel belongs to a mask
    decoder: str = "rnse"
    masks_shown: bool = True  # whether the masks of the visible prompts lie over the layer
    overlay_opacity: float = 0.75
    compare: Compare = "off"
    ranges: tuple[tuple[str, ColourRange], ...] = field(default=())

    @property
    def drawn(self) -> tuple[LayerBlend, ...]:
        """The layers that make up the frame, from the bottom up."""
        return tuple(blend for blend in self.blend if blend.visible or blend.name == self.layer)

    def range(self, layer: str) -> ColourRange:
        return dict(self.ranges).get(layer, ColourRange())

    def with_range(self, layer: str, colour_range: ColourRange) -> ViewState:
        return replace(self, ranges=tuple(sorted({**dict(self.ranges), layer: colour_range}.items())))

    def prompt(self, text: str) -> Prompt:
        """The prompt with this text; KeyError when there is none."""
        for prompt in self.prompts:
            if prompt.text.casefold() == text.casefold():
                return prompt
        raise KeyError(text)

    @property
    def visible_prompts(self) -> tuple[Prompt, ...]:
        """Those whose masks are shown."""
        return tuple(prompt for prompt in self.prompts if prompt.visible and not prompt.negative)

    @property
    def negative_texts(self) -> tuple[str, ...]:
        """What takes pixels from the masks."""
        return tuple(prompt.text for prompt in self.prompts if prompt.visible and prompt.negative)

    @property
    def prompt_set(self) -> PromptSet:
        """What is asked of the scene. PromptError for a decoder that there is not."""
        from degense.engine.semantics.prompts import PromptSet

        return PromptSet(tuple(prompt.text for prompt in self.visible_prompts), self.negative_texts, self.decoder, self.threshold)

    def next_colour(self) -> Colour:
        """The first palette colour that no prompt has, or the one used least."""
        used = [prompt.colour for prompt in self.prompts]
        return min(PROMPT_COLOURS, key=used.count)

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(data: Any, source: str) -> ViewState:
        """The view state that `to_json` wrote. RunError when the data is not a view state; the sentence names `source`."""
        from degense.engine.store.migrations import current_layer

        try:
            _only_known(data, ViewState)
            return ViewState(
                layer=current_layer(str(data["layer"])),
                blend=_blend(data.get("blend", ())),
                prompts=tuple(_prompt(item) for item in data["prompts"]),
                threshold=float(data["threshold"]),
                decoder=str(data["decoder"]),
                masks_shown=bool(data["masks_shown"]),
                overlay_opacity=min(1.0, max(0.0, float(data["overlay_opacity"]))),
                compare=_one_of(data["compare"], Compare),
                ranges=tuple((current_layer(str(layer)), _colour_range(item)) for layer, item in data["ranges"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise RunError(f"{source} does not hold a saved view ({what_is_wrong(error)}); delete it to start with a fresh one.") from error


def _prompt(data: dict[str, Any]) -> Prompt:
    _only_known(data, Prompt)
    red, green, blue = (min(255, max(0, int(channel))) for channel in data["colour"])
    return Prompt(str(data["text"])[:200], (red, green, blue), bool(data["visible"]), bool(data.get("negative", False)))


def _blend(data: Any) -> tuple[LayerBlend, ...]:
    """The layers from the bottom up: those of `data` that there still are, and on top of them those that it does not know."""
    from degense.engine.store.migrations import current_layer

    for item in data:
        _only_known(item, LayerBlend)
    known = [
        LayerBlend(current_layer(str(item["name"])), bool(item["visible"]), min(1.0, max(0.0, float(item["opacity"])))) for item in data
    ]
    kept = {blend.name: blend for blend in known if blend.name in LAYER_TITLES}
    return (*kept.values(), *(blend for blend in LAYER_ORDER if blend.name not in kept))


def _colour_range(data: dict[str, Any]) -> ColourRange:
    _only_known(data, ColourRange)
    clip = min(49.0, max(0.0, float(data.get("clip", 1.0))))
    return ColourRange(_one_of(data["mode"], RangeMode), float(data["low"]), float(data["high"]), str(data["cmap"]), clip)


def _one_of(value: Any, choices: Any) -> Any:
    if value not in get_args(choices):
        raise ValueError(f"{value!r} is none of {', '.join(get_args(choices))}")
    return value


def _only_known(data: Any, kind: type) -> None:
    """ValueError for anything but a dictionary of the kind's fields; those that came later may be missing."""
    if not isinstance(data, dict) or not set(data) <= {item.name for item in fields(kind)}:
        raise ValueError(f"not the fields of a {kind.__name__.lower()}")

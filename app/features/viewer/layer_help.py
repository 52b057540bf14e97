"""What each layer shows, for the help page: the formula, the unit, and how to read it."""

from __future__ import annotations

from html import escape

from degense.engine.layers import LAYERS
from degense.engine.layers.layer import Layer

#: The formula of each layer. wᵢ = αᵢ · Π (1 − αⱼ) over the Gaussians in front: the weight with which Gaussian i is seen in a pixel.
FORMULAS = {
    "rgb": "C = Σ wᵢ cᵢ(t)",
    "depth": "D = Σ wᵢ zᵢ(t) / Σ wᵢ",
    "features": "z / ‖z‖ with z = Σ wᵢ fᵢ(t)",
    "similarity": "⟨z, Bᵀv⟩ / (‖z‖ ‖v‖), v the prompt's text vector, B the basis of the latents",
    "mask": "similarity ≥ threshold, averaged over regions and cleaned by the decoder",
    "displacement": "Σ wᵢ ‖μᵢ(t) − μᵢ(t₀)‖ / Σ wᵢ over the Gaussians that last, where they cover the pixel; else over all",
    "uncertainty": "Σ wᵢ eᵢ / Σ wᵢ, eᵢ = 1.4 √mean‖uⱼ − uᵢ‖², u = μ(t) − μ(t₀), j the nearest Gaussians whose motion is revealed",
    "speed": "Σ wᵢ ‖μᵢ(t + h) − μᵢ(t − h)‖ / 2h / Σ wᵢ, h one frame",
    "rotation": "Σ wᵢ rᵢ / Σ wᵢ, rᵢ = 2 atan2(‖Im(qᵢ q̄ᵢ₀)‖, |Re(qᵢ q̄ᵢ₀)|) the angle of the turn since t₀",
    "scale": "Σ wᵢ gᵢ / Σ wᵢ, gᵢ = Σₖ log₂(sᵢₖ(t) / sᵢₖ(t₀)): 1 has doubled its volume, −1 has halved it",
    "appearance": "‖Lab(C) − Lab(C₀)‖, C₀ = Σ wᵢ cᵢ(t₀) / Σ wᵢ over the Gaussians that last, where they are at t",
    "warp": "‖m − o‖, m the model's motion in pixels, o the optical flow of the recording; or the error to expect by the flow around",
    "observability": "Σ wᵢ sᵢ / Σ wᵢ, sᵢ the share of frames that reveal the motion of Gaussian i",
}
#: Units as the layer list has them, where no run is open.
UNITS = {
    "depth": "mm where the clip's depth is metric, else scene units",
    "similarity": "cosine, −1 to 1",
    "displacement": "mm where the clip's depth is metric, else scene units",
    "uncertainty": "mm where the clip's depth is metric, else scene units",
    "speed": "mm a second where the clip's depth is metric, else scene units a second",
    "rotation": "degrees, 0 to 180",
    "scale": "log₂ of the ratio of volumes",
    "appearance": "ΔE, CIE 1976",
    "warp": "pixels of the recording",
    "observability": "share of the frames, 0 to 1",
}


def layer_help(units: dict[str, str]) -> str:
    """The page as HTML, with the layers' units in the run that is open; empty when there is none."""
    parts = [
        "<p>Every layer is drawn from the Gaussians of the instant. In a pixel, Gaussian i has the weight "
        "w<sub>i</sub> = α<sub>i</sub> · Π (1 − α<sub>j</sub>) over those in front of it; t₀ is the reference frame. "
        "Grey is not known; hatched is a guess.</p>"
    ]
    for layer in LAYERS.values():
        unit = units.get(layer.name) or UNITS.get(layer.name, "")
        parts.append(f"<h3>{escape(layer.title)}</h3><p><code>{escape(FORMULAS[layer.name])}</code></p><p>{escape(layer.description)}</p>")
        notes = [f"Unit: {escape(unit)}."] if unit else []
        notes += [f"{words}." for words in _needs(layer)]
        if notes:
            parts.append(f"<p><i>{' '.join(notes)}</i></p>")
    parts.append("<p><b>For research, not a medical device.</b></p>")
    return "".join(parts)


def _needs(layer: Layer) -> list[str]:
    wanted = (
        (layer.needs_semantics, "Needs a run that was trained with semantics"),
        (layer.needs_prompt, "Needs a prompt"),
        (layer.needs_clip, "Needs the recording"),
        (layer.needs_observability, "Needs a run that keeps the observability of its motion"),
    )
    return [words for needed, words in wanted if needed]

"""One HTML file with a scene and a viewer in it, which opens from disk and asks nothing of a network."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from degense.app.features.share.sampling import sample
from degense.app.session.sample import ASSETS
from degense.engine.colour_maps import CLASS_COLOURS, UNKNOWN, colour_table
from degense.engine.errors import DegenseError
from degense.engine.files import write_text
from degense.engine.progress import Steps
from degense.engine.raster import limits
from degense.engine.semantics.prompts import PromptSet

if TYPE_CHECKING:
    from degense.engine.camera import Camera
    from degense.engine.scene import Scene

#: The viewer's source: a page in which the parts take the place of their names in braces.
SOURCE = ASSETS / "share"
PARTS = ("viewer.css", "splats.vert.glsl", "splats.frag.glsl", "scene.js", "camera.js", "drawing.js", "viewer.js")
Colour = tuple[int, int, int]


def check_suffix(out: Path) -> None:
    """DegenseError for another suffix than .html."""
    if out.suffix.lower() != ".html":
        raise DegenseError(f"{out} must end in .html.")


def share(scene: Scene, out: Path, prompts: PromptSet, colours: Sequence[Colour] = ()) -> Steps[str]:
    """Write a scene as one page, with masks of the prompts in `colours`, or of the scene's classes where nothing is prompted.

    DegenseError for another suffix than .html, PromptError for a word that is not understood.
    """
    check_suffix(out)
    texts = prompts.prompts or scene.classes
    asked = PromptSet(texts, prompts.negatives, prompts.decoder, prompts.threshold) if scene.has_semantics and texts else None
    frames, samples = yield from sample(scene, asked)
    yield 0.92, "finding the range of the displacement"
    header = {
        "name": scene.name,
        "unit": scene.unit,
        "fps": scene.fps,
        "size": scene.clip_size,
        "gaussians": len(scene.splats(0.0)),
        "lastFrame": scene.frames - 1,
        "referenceFrame": scene.reference_frame,
        "pivot": np.median(scene.splats(0.0).means.cpu().numpy(), 0).tolist(),
        "frames": frames.tolist(),
        "cameras": [_camera(camera) for camera in scene.cameras],
        "masks": _masks(texts if asked else (), colours),
        "displacement": _displacement(scene),
        "limits": {"near": limits.NEAR, "eps2d": limits.EPS2D, "margin": limits.FOV_MARGIN, "minAlpha": limits.MIN_ALPHA},
        "arrays": samples.arrays,
    }
    yield 0.95, "writing"
    packed = base64.b64encode(gzip.compress(b"".join(samples.parts), 6, mtime=0)).decode("ascii")
    write_text(out, _page(scene.name, header, packed))
    return f"{out}: {header['gaussians']} Gaussians at {len(frames)} times, {out.stat().st_size / 1e6:.1f} MB"


def _camera(camera: Camera) -> dict[str, Any]:
    return {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "view": camera.viewmat.ravel().tolist()}


def _masks(texts: Sequence[str], colours: Sequence[Colour]) -> list[dict[str, Any]]:
    chosen = [*colours, *CLASS_COLOURS] if colours else CLASS_COLOURS
    return [{"text": text, "colour": chosen[i % len(chosen)]} for i, text in enumerate(texts)]


def _displacement(scene: Scene) -> dict[str, Any]:
    """What the colours of the displacement mean: as in the window, over the range of the whole sequence."""
    from degense.engine.layers import LAYERS, LayerRequest, layer_range

    layer = LAYERS["displacement"]
    _, high = layer_range(scene, layer, LayerRequest(0.0), "sequence")
    return {"high": high, "colours": np.asarray(colour_table(layer.cmap)).ravel().tolist(), "unknown": UNKNOWN}


def _page(name: str, header: dict[str, Any], packed: str) -> str:
    # "<" could end the element that the JSON stands in
    told = json.dumps(header, separators=(",", ":")).replace("<", "\\u003c")
    texts = {"title": html.escape(name), "header": told, "data": packed}
    texts |= {part: (SOURCE / part).read_text(encoding="utf-8") for part in PARTS}
    return re.sub(r"\{([\w.]+)\}", lambda place: texts[place[1]], (SOURCE / "viewer.html").read_text(encoding="utf-8"))

"""Binary glTF 2.0 (.glb) with the extension KHR_gaussian_splatting: points with the attributes of a Gaussian each."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from degense.engine.errors import DegenseError
from degense.engine.files import replacing
from degense.engine.splats import Splats
from degense.engine.store.splat_files.axes import right_up_back
from degense.engine.store.splat_files.ply import SH0

EXTENSION = "KHR_gaussian_splatting"
MAGIC, VERSION, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 2, 0x4E4F534A, 0x004E4942
FLOAT, UNSIGNED_BYTE, POINTS, ARRAY_BUFFER = 5126, 5121, 0, 34962
TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def save_gltf(path: Path, splats: Splats) -> None:
    """Write one instant, without semantics. DegenseError for none, since an accessor holds one element at least."""
    if not len(splats):
        raise DegenseError("There is no Gaussian to write; glTF cannot hold none.")
    attributes = _attributes(right_up_back(splats).detach().to("cpu"))
    views, accessors, start = [], [], 0
    for index, values in enumerate(attributes.values()):
        views.append({"buffer": 0, "byteOffset": start, "byteLength": values.nbytes, "target": ARRAY_BUFFER})
        accessors.append(_accessor(index, values))
        start += values.nbytes
    accessors[0] |= {"min": attributes["POSITION"].min(0).tolist(), "max": attributes["POSITION"].max(0).tolist()}
    kernel = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display", "sortingMethod": "cameraDistance", "projection": "perspective"}
    primitive = {
        "attributes": {name: index for index, name in enumerate(attributes)},
        "mode": POINTS,
        "extensions": {EXTENSION: kernel},
    }
    document = {
        "asset": {"version": "2.0", "generator": "DeGense"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{"byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), JSON_CHUNK) + text + struct.pack("<II", start, BINARY_CHUNK)
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<III", MAGIC, VERSION, 12 + len(chunks) + start) + chunks)
        for values in attributes.values():
            file.write(values.tobytes())


def _attributes(splats: Splats) -> dict[str, np.ndarray]:
    """Each attribute, float32 or uint8 [N, c]: scales as they are, opacities in [0, 1], quaternions xyzw, a colour for plain viewers."""
    opacities, colors = splats.opacities.clamp(0, 1).numpy()[:, None], splats.colors.numpy()
    floats = {
        "POSITION": splats.means.numpy(),
        f"{EXTENSION}:ROTATION": splats.quats.numpy()[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": splats.scales.numpy(),
        f"{EXTENSION}:OPACITY": opacities,
        f"{EXTENSION}:SH_DEGREE_0_COEF_0": (colors - 0.5) / SH0,
    }
    plain = (np.hstack([colors.clip(0, 1), opacities]) * 255 + 0.5).astype(np.uint8)
    return {name: np.ascontiguousarray(values, "<f4") for name, values in floats.items()} | {"COLOR_0": plain}


def _accessor(index: int, values: np.ndarray) -> dict[str, Any]:
    kind = {"componentType": FLOAT} if values.dtype.kind == "f" else {"componentType": UNSIGNED_BYTE, "normalized": True}
    return {"bufferView": index, **kind, "count": len(values), "type": TYPES[values.shape[1]]}

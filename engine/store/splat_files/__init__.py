"""The Gaussians of one instant as files of other tools."""

from degense.engine.store.splat_files.gltf import save_gltf
from degense.engine.store.splat_files.ply import save_ply
from degense.engine.store.splat_files.spz import save_spz

#: What writes each, by its suffix.
SPLAT_FILES = {".ply": save_ply, ".spz": save_spz, ".glb": save_gltf}

__all__ = ["SPLAT_FILES", "save_gltf", "save_ply", "save_spz"]

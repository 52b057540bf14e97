"""One phantom, ready to be photographed at any clip time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.camera import Camera
from engine.phantom.anatomy import REFERENCE_DEPTH, Anatomy, build_anatomy
from engine.phantom.motion import BURN, CHAR_RISE, Script, write_script
from engine.phantom.render import CHAR_BEGUN, SAMPLES, cover, shade
from engine.phantom.tools import grasper, hook

FOCAL = 0.9  # of the width: 58° across
MESH_CELLS = (96, 480)  # across the view


@dataclass(frozen=True)
class View:
    """What the camera sees at one time.

    Attributes
    ----------
    rgb : float64 [H, W, 3]
        Display values in [0, 1], without noise.
    depth : float32 [H, W]
        Camera z, mm.
    labels : uint8 [H, W]
    displacement : float32 [H, W, 3]
        mm, world frame; NaN where no tissue is seen.
    cautery : bool [H, W]
    """

    rgb: np.ndarray
    depth: np.ndarray
    labels: np.ndarray
    displacement: np.ndarray
    cautery: np.ndarray


class PhantomScene:
    """Tissue, tools, light and camera of one seed.

    Parameters
    ----------
    width, height : int
        Pixels.
    seed : int
    camera_motion : float
        Amplitude of the camera's path, mm.
    """

    def __init__(self, width: int, height: int, seed: int, camera_motion: float):
        self.width, self.height = width, height
        self.focal = FOCAL * width
        margin = 1.12 + 0.022 * camera_motion
        half_x = 0.5 * width / self.focal * REFERENCE_DEPTH * margin
        half_y = 0.5 * height / self.focal * REFERENCE_DEPTH * margin + 2.0
        cells = int(np.clip(width, *MESH_CELLS) * margin)
        rng = np.random.default_rng(seed)
        self.anatomy: Anatomy = build_anatomy(rng, (half_x, half_y), cells, 3, BURN)
        self.script: Script = write_script(self.anatomy, rng, camera_motion)
        rows, columns = self.anatomy.mesh.shape
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        right, below = corner + 1, corner + columns
        self._triangles = np.stack([corner, right, below, right, below + 1, below], -1).reshape(-1, 3).astype(np.int32)
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        self._texels = np.stack([x, y], -1).reshape(-1, 2) * float(self.anatomy.finer)

    def camera(self, s: float) -> Camera:
        """The camera at clip time s."""
        return Camera(self.width, self.height, self.focal, self.focal, self.width / 2, self.height / 2, self.script.viewmat(s))

    def view(self, s: float) -> View:
        """Photograph at clip time s in [0, 1]."""
        camera = self.camera(s)
        rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
        displacement = self.script.displacement(s)
        surface = self.anatomy.rest + displacement
        normals = np.cross(np.gradient(surface, axis=1), np.gradient(surface, axis=0)).reshape(-1, 3)
        normals *= -1 / np.linalg.norm(normals, axis=1, keepdims=True)  # towards the camera
        tools = [grasper(self.anatomy, self.script, s), hook(self.anatomy, s)]

        vertices = np.concatenate([surface.reshape(-1, 3), *(tool.vertices for tool in tools)]) @ rotation.T + translation
        normals = np.concatenate([normals, *(tool.normals for tool in tools)]) @ rotation.T
        attributes = np.zeros((len(vertices), 5))
        tissue = len(self._texels)
        attributes[:tissue, :2], attributes[:tissue, 2:] = self._texels, displacement.reshape(-1, 3)
        attributes[tissue:, :3] = np.concatenate([tool.colours for tool in tools])
        offsets = tissue + np.cumsum([0] + [len(tool.vertices) for tool in tools])
        triangles = np.concatenate([self._triangles, *(tool.triangles + np.int32(o) for tool, o in zip(tools, offsets, strict=False))])
        tool_labels = np.concatenate([np.full(len(tool.triangles), tool.label, np.uint8) for tool in tools])

        z = np.ascontiguousarray(vertices[:, 2])
        focal, centre = self.focal * SAMPLES, np.array([self.width, self.height]) * SAMPLES / 2
        pixels = vertices[:, :2] / np.where(np.abs(z) < 1e-9, 1e-9, z)[:, None] * focal + centre
        owner = np.full((self.height * SAMPLES, self.width * SAMPLES), -1, np.int32)
        cover(pixels, z, triangles, np.zeros(owner.shape), owner, 0)
        colour, depth, labels, moved, char = shade(
            owner,
            pixels,
            z,
            triangles,
            normals,
            attributes,
            tool_labels,
            len(self._triangles),
            self.anatomy.texture,
            self.anatomy.labels,
            np.ascontiguousarray(rotation.T[:2]),
            np.array([focal, focal, *centre]),
            s,
            CHAR_RISE,
        )
        rgb = np.clip(colour, 0, 1) ** (1 / 2.2)
        return View(rgb, depth.astype(np.float32), labels, moved.astype(np.float32), char > CHAR_BEGUN)

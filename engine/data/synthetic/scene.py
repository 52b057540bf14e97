"""One phantom, ready to be photographed at any clip time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from degense.engine.camera import Camera
from degense.engine.data.synthetic.anatomy import REFERENCE_DEPTH
from degense.engine.data.synthetic.cautery import Cautery
from degense.engine.data.synthetic.render import CHANGE_BEGUN, SAMPLES, Mesh, TissueSurface, cover, shade
from degense.engine.data.synthetic.stage import PhantomStage
from degense.engine.data.synthetic.texture import Sheet, fractal

#: What makes the stage of a phantom, by the name of its kind; `engine.research.surgeries` adds its own.
KINDS: dict[str, type[PhantomStage]] = {"cautery": Cautery}
FOCAL = 0.9  # of the width: 58° across
MESH_CELLS = (96, 480)  # across the view


@dataclass(frozen=True)
class PhantomFrame:
    """What the camera sees at one time."""

    rgb: np.ndarray  # float64 [H, W, 3]; display values in [0, 1], without noise
    depth: np.ndarray  # float32 [H, W]; camera z, mm
    labels: np.ndarray  # uint8 [H, W]
    displacement: np.ndarray  # float32 [H, W, 3]; mm, world frame; NaN where no tissue is seen
    cautery: np.ndarray  # bool [H, W]
    #: bool [H, W]; pixels that a tool shows in, be it in a corner: they are no tissue to score, unlike what `labels` says of their centres.
    tools: np.ndarray


class PhantomScene:
    """Tissue, tools, light and camera of one seed; see `engine.data.synthetic.clip.PhantomOptions`."""

    def __init__(self, kind: str, width: int, height: int, seed: int, camera_motion: float):
        self.width, self.height, self.camera_motion = width, height, camera_motion
        self.focal = FOCAL * width
        margin = KINDS[kind].margin(seed, camera_motion)
        half_x = 0.5 * width / self.focal * REFERENCE_DEPTH * margin
        half_y = 0.5 * height / self.focal * REFERENCE_DEPTH * margin + 2.0
        cells = int(np.clip(width, *MESH_CELLS) * margin)
        self.stage: PhantomStage = KINDS[kind]((half_x, half_y), cells, seed)
        self._triangles = _grid_triangles([patch.rest.shape[:2] for patch in self.stage.patches])
        self._texels = np.concatenate([patch.texels.reshape(-1, 2) for patch in self.stage.patches])

    def camera(self, s: float) -> Camera:
        """The camera at clip time s."""
        viewmat = self.stage.viewmat(s, self.camera_motion)
        return Camera(self.width, self.height, self.focal, self.focal, self.width / 2, self.height / 2, viewmat)

    def points(self, s: float, vertices: np.ndarray) -> np.ndarray:
        """Where material points are at clip time s, mm, world axes, float64 [K, 3]; `vertices` counts through all patches."""
        stage = self.stage
        places = [(patch.rest + moved).reshape(-1, 3) for patch, moved in zip(stage.patches, stage.displacements(s), strict=True)]
        return np.concatenate(places)[vertices]

    @property
    def vertices(self) -> int:
        """How many material points there are."""
        return len(self._texels)

    def _smoke(self, drifted: tuple[float, float]) -> np.ndarray:
        """Share of the thickest smoke in each pixel, float64 [H, W], after it has drifted by parts of the width."""
        x = np.linspace(-60, 60, self.width) + 120 * drifted[0] % 80
        y = (np.linspace(-60, 60, self.height) * self.height / self.width) + 120 * drifted[1] % 80
        cloud = fractal(Sheet(x - 40, y - 40), np.random.default_rng(11), 40.0, 3)
        return np.clip(0.5 + 0.4 * cloud, 0, 1).astype(np.float64)

    def view(self, s: float) -> PhantomFrame:
        """Photograph at clip time s in [0, 1]."""
        stage, camera = self.stage, self.camera(s)
        rotation, translation = camera.viewmat[:3, :3], camera.viewmat[:3, 3]
        displacements = stage.displacements(s)
        surfaces = [patch.rest + moved for patch, moved in zip(stage.patches, displacements, strict=True)]
        instruments = stage.tools(s)

        vertices = np.concatenate([*(surface.reshape(-1, 3) for surface in surfaces), *(tool.vertices for tool in instruments)])
        vertices = vertices @ rotation.T + translation
        normals = np.concatenate([*(_normals(surface) for surface in surfaces), *(tool.normals for tool in instruments)]) @ rotation.T
        attributes = np.zeros((len(vertices), 5))
        tissue = len(self._texels)
        attributes[:tissue, :2], attributes[:tissue, 2:] = self._texels, np.concatenate([d.reshape(-1, 3) for d in displacements])
        attributes[tissue:, :3] = np.concatenate([np.zeros((0, 3)), *(tool.colours for tool in instruments)])
        offsets = tissue + np.cumsum([0] + [len(tool.vertices) for tool in instruments])
        triangles = np.concatenate(
            [self._triangles, *(tool.triangles + np.int32(o) for tool, o in zip(instruments, offsets, strict=False))]
        )
        tool_labels = np.concatenate([np.zeros(0, np.uint8), *(np.full(len(tool.triangles), tool.label, np.uint8) for tool in instruments)])

        z = np.ascontiguousarray(vertices[:, 2])
        focal, centre = self.focal * SAMPLES, np.array([self.width, self.height]) * SAMPLES / 2
        pixels = vertices[:, :2] / np.where(np.abs(z) < 1e-9, 1e-9, z)[:, None] * focal + centre
        owner = np.full((self.height * SAMPLES, self.width * SAMPLES), -1, np.int32)
        cover(pixels, z, triangles, np.zeros(owner.shape), owner, 0)
        mesh = Mesh(pixels, z, triangles, normals, attributes, len(self._triangles), tool_labels)
        axes = np.ascontiguousarray(rotation.T[:2])
        optics, changed = stage.optics(s), np.array(stage.changed_labels, np.uint8)
        light = np.array([optics.falloff, optics.gleam, optics.exposure])
        surface = TissueSurface(stage.texture, stage.organs, axes, stage.change, changed, s, stage.change_time, light)
        shaded = shade(owner, mesh, surface, np.array([focal, focal, *centre]))
        rgb = np.clip(shaded.colour, 0, 1) ** (1 / 2.2)
        if optics.smoke > 0:
            veil = optics.smoke * self._smoke(optics.drifted)[..., None]
            rgb = rgb * (1 - veil) + 0.62 * veil
        tools = np.any((owner >= len(self._triangles)).reshape(self.height, SAMPLES, self.width, SAMPLES), axis=(1, 3))
        depth, moved = shaded.depth.astype(np.float32), shaded.displacement.astype(np.float32)
        return PhantomFrame(rgb, depth, shaded.label, moved, shaded.change > CHANGE_BEGUN, tools)


def _normals(surface: np.ndarray) -> np.ndarray:
    """Unit normals [h · w, 3] of a grid of vertices, towards the camera."""
    normals = np.cross(np.gradient(surface, axis=1), np.gradient(surface, axis=0)).reshape(-1, 3)
    normals *= -1 / np.linalg.norm(normals, axis=1, keepdims=True)
    return normals


def _grid_triangles(shapes: list[tuple[int, int]]) -> np.ndarray:
    """Two triangles for each cell of each grid (rows, columns), int32 [F, 3]; vertices are counted through all grids."""
    found, first = [], 0
    for rows, columns in shapes:
        corner = first + (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        right, below = corner + 1, corner + columns
        found.append(np.stack([corner, right, below, right, below + 1, below], -1).reshape(-1, 3).astype(np.int32))
        first += rows * columns
    return np.concatenate(found)

"""Random patterns on a rectangle of tissue, in millimetres, so that a seed looks the same at every resolution."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.interpolate import RectBivariateSpline


@dataclass(frozen=True)
class Sheet:
    """A regular grid over the tissue: x to the right, y down, millimetres."""

    x: np.ndarray  # float64 [W]
    y: np.ndarray  # float64 [H]

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.y), len(self.x)

    @property
    def step(self) -> float:
        """Distance of neighbouring grid points, mm."""
        return float(self.x[1] - self.x[0])

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """x and y of every grid point, float64 [H, W] each."""
        return tuple(np.meshgrid(self.x, self.y))


def mesh_and_texture(half: tuple[float, float], cells: int, finer: int) -> tuple[Sheet, Sheet]:
    """Grids of the vertices and of the texture, `finer` times finer, over ±`half` mm, with `cells` mesh cells across the width."""
    step = 2 * half[0] / cells
    rows = int(np.ceil(half[1] / step))
    mesh = Sheet(np.linspace(-half[0], half[0], cells + 1), step * np.arange(-rows, rows + 1))
    fine = step / finer
    return mesh, Sheet(mesh.x[0] + fine * np.arange(cells * finer + 1), mesh.y[0] + fine * np.arange(2 * rows * finer + 1))


EXTENT = 100.0  # noise is defined on ±EXTENT mm, whatever part of it a sheet covers


def noise(sheet: Sheet, rng: np.random.Generator, cell: float) -> np.ndarray:
    """Smooth random field, float32 [H, W], about zero mean and unit variance, with features of about `cell` mm."""
    lattice = np.arange(-EXTENT - 3 * cell, EXTENT + 4 * cell, cell)
    values = rng.standard_normal((len(lattice), len(lattice)))
    return (RectBivariateSpline(lattice, lattice, values)(sheet.y, sheet.x) * 1.35).astype(np.float32)


def fractal(sheet: Sheet, rng: np.random.Generator, coarse: float, octaves: int) -> np.ndarray:
    """Sum of `octaves` noise fields, each half as coarse and 0.6 times as strong as the one before; unit variance, float32 [H, W]."""
    weights = 0.6 ** np.arange(octaves)
    total = sum(w * noise(sheet, rng, coarse / 2**k) for k, w in enumerate(weights))
    return (total / np.linalg.norm(weights)).astype(np.float32)


def vessels(sheet: Sheet, rng: np.random.Generator, trunks: int, radius: float, straightness: float) -> np.ndarray:
    """A branching net of vessels, float32 [H, W] in [0, 1]: how much of a grid point is vessel.

    Of the vessels, `trunks` branch. `radius` is a trunk's at its root, mm; branches are thinner. `straightness` is 1 for straight vessels,
    0 for meandering ones.
    """
    canvas = np.zeros(sheet.shape, np.uint8)
    shift = 4
    todo = [(*rng.uniform(-70, 70, 2), rng.uniform(0, 2 * np.pi), radius, 0) for _ in range(trunks)]
    while todo:
        x, y, heading, thick, depth = todo.pop()
        start, bend = thick, 0.0
        while thick > 0.3 * start and thick > 0.06:
            bend = 0.7 * bend + rng.normal(0, 0.35 * (1 - straightness))
            heading += bend
            nx, ny = x + 1.2 * np.cos(heading), y + 1.2 * np.sin(heading)
            ends = (np.array([[x, y], [nx, ny]]) - [sheet.x[0], sheet.y[0]]) / sheet.step * 2**shift
            (ax, ay), (bx, by) = np.rint(ends).astype(int).tolist()
            # A vessel thinner than a grid cell is drawn one cell wide and fainter.
            cells = 2 * thick / sheet.step
            cv2.line(canvas, (ax, ay), (bx, by), int(255 * min(1.0, cells)), max(1, round(cells)), cv2.LINE_AA, shift)
            x, y, thick = nx, ny, thick * rng.uniform(0.93, 0.995)
            if depth < 3 and rng.random() < 0.13:
                todo.append((x, y, heading + rng.choice([-1, 1]) * rng.uniform(0.4, 1.1), thick * rng.uniform(0.45, 0.75), depth + 1))
    return cv2.GaussianBlur(canvas, (0, 0), max(0.6, 0.12 / sheet.step)).astype(np.float32) / 255


def slope(height: np.ndarray, step: float) -> np.ndarray:
    """Gradient of a relief [H, W] (mm) on a grid of `step` mm, float32 [H, W, 2] (along x, along y), without unit."""
    dy, dx = np.gradient(height, step)
    return np.stack([dx, dy], -1).astype(np.float32)

"""A video of C3VD, a colonoscope in a model of known shape: `NNNN_color.png`, `NNNN_depth.tiff` and `pose.txt`.

Depth is along the optical axis, 16 bits for 0 to 100 mm; 0 and the largest value are unknown. A line of `pose.txt` is the camera-to-world
matrix of a frame, 16 numbers, column by column (as the data set's own loader reads it) or row by row; where the translation stands tells.
The lens is that of the data set's calibration (Scaramuzza's polynomial). Frames and depth are resampled to a pinhole camera of the focal
length that is set, or of the resolution that the lens has in the middle, which has no room for the outermost part of so wide a view.
"""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from degense.engine.camera import Camera
from degense.engine.clip import Clip
from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.cameras import ClipCameras, check_rotations, clip_cameras
from degense.engine.data.files.depth import DepthFiles
from degense.engine.data.files.images import ImageFiles, check_sizes
from degense.engine.data.files.masks import border_words, brightest, field_of_view
from degense.engine.data.files.numbered import last_number, regular_file, shown
from degense.engine.data.files.remapped import RemappedFrames
from degense.engine.data.files.stored import clip_with_prior, counted, looked_at
from degense.engine.errors import ClipError

COLOUR, DEPTH = re.compile(r"(\d+)_color\.png"), re.compile(r"(\d+)_depth\.tiff")
POSES = "pose.txt"
MOST_BYTES = 1 << 24
MILLIMETRES, LARGEST = 100.0, 65535
#: The published calibration: size, centre, the polynomial's coefficients of ρ⁰, ρ², ρ³ and ρ⁴, and the affine part c, d, e.
SIZE, CENTRE = (1350, 1080), (678.544839263292, 542.975887548343)
POLYNOMIAL = (769.243600037458, -0.000812770624150226, 6.25674244578925e-07, -1.19662182144280e-09)
AFFINE = ((0.999986882249990, 0.00288273829525059), (-0.00296316513429569, 1.0))


class _Depths(DepthFiles):
    """Depth in millimetres, resampled at `places` (nearest pixel)."""

    def __init__(self, files: list[Path], size: tuple[int, int], places: np.ndarray):
        super().__init__(files, size, MILLIMETRES / LARGEST)
        self._places = places

    def read(self, index: int) -> np.ndarray:
        depth = super().read(index)
        depth[depth > MILLIMETRES * (1 - 0.5 / LARGEST)] = 0.0
        return cv2.remap(depth, self._places, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)


def is_c3vd(folder: Path) -> bool:
    """Whether a folder looks like a video of the data set."""
    return (folder / POSES).is_file() and any(COLOUR.fullmatch(file.name) for file in folder.iterdir())


def open_c3vd(path: Path, options: ClipOptions) -> Clip:
    """Open a video. ClipError when it cannot be read."""
    frames, depths = (_numbered(path, pattern) for pattern in (COLOUR, DEPTH))
    if not frames:
        raise ClipError(f"{shown(path)} holds no pictures (0000_color.png, …).")
    if [last_number(file) for file in frames] != [last_number(file) for file in depths]:
        raise ClipError(
            f"{shown(path)} holds {len(depths)} depth maps (0000_depth.tiff, …) for {len(frames)} frames; each frame needs one."
        )
    stored = ImageFiles(frames)
    check_sizes(depths, stored.size)
    focal = options.focal or POLYNOMIAL[0] * stored.size[0] / SIZE[0]
    places = lens_of(stored.size, focal)
    pictures = RemappedFrames(stored, (slice(None), slice(None)), places)
    cameras = _cameras(path, len(frames), stored.size, focal, options)
    some = [pictures.read(i) for i in looked_at(len(frames))]
    field = field_of_view(brightest(some))
    words = {
        "frames": counted(frames, stored.size) + ", resampled to a pinhole camera",
        "masks": border_words(field, "dark border"),
        "labels": "none",
    }
    clip = clip_with_prior(path, pictures, some, field, cameras, words, unit="mm")
    clip.distances = _Depths(depths, stored.size, places)
    clip.provenance["depth"] = "measured, from NNNN_depth.tiff, mm, 0 = unknown"
    return clip


def lens_of(size: tuple[int, int], focal: float) -> np.ndarray:
    """Where each pixel of a pinhole camera, principal point in the middle, is in a frame of a size, float32 [H, W, 2].

    The ray of a pixel p of a frame is (u, f(‖u‖)) with u = A⁻¹ (p − centre) and the polynomial f; here the ray is known
    and ρ = ‖u‖ is looked up in a table.
    """
    scale = size[0] / SIZE[0]
    rho = np.linspace(0, float(np.hypot(*SIZE)) / 2, 4096)
    along = POLYNOMIAL[0] + POLYNOMIAL[1] * rho**2 + POLYNOMIAL[2] * rho**3 + POLYNOMIAL[3] * rho**4
    ahead = along > 0
    slope = rho[ahead] / along[ahead]  # tan of the angle to the optical axis, which grows with ρ
    x, y = np.meshgrid(*((np.arange(side) + 0.5 - side / 2) / focal for side in size))
    radius = np.hypot(x, y)
    stretch = np.interp(radius, slope, rho[ahead], right=np.nan) / np.maximum(radius, 1e-9)
    u = np.stack([x * stretch, y * stretch], -1)
    places = (u @ np.array(AFFINE).T + CENTRE + 0.5) * scale - 0.5  # pixels with their middles at whole numbers, as OpenCV has them
    return np.nan_to_num(places, nan=-1e4).astype(np.float32)


def _numbered(path: Path, pattern: re.Pattern) -> list[Path]:
    found = [(int(match.group(1)), file) for file in path.iterdir() if (match := pattern.fullmatch(file.name))]
    return [regular_file(file, path) for _, file in sorted(found)]


def _cameras(path: Path, count: int, size: tuple[int, int], focal: float, options: ClipOptions) -> ClipCameras:
    file = regular_file(path / POSES, path)
    if file.stat().st_size > MOST_BYTES:
        raise ClipError(f"{shown(file)} is larger than {MOST_BYTES >> 20} MB; that is no list of poses.")
    try:
        lines = file.read_text("utf-8").replace(",", " ").splitlines()
        poses = np.array([[float(word) for word in line.split()] for line in lines if line.strip()]).reshape(-1, 4, 4)
    except ValueError as error:
        raise ClipError(f"{shown(file)} must have 16 numbers in each line.") from error
    poses = poses if np.abs(poses[:, 3, :3]).max(initial=0) < 1e-9 and np.abs(poses[:, :3, 3]).any() else poses.transpose(0, 2, 1)
    if len(poses) != count or not np.isfinite(poses).all() or not np.allclose(poses[:, 3], [0, 0, 0, 1], atol=1e-6):
        raise ClipError(f"{shown(file)} must have one rigid camera-to-world matrix for each of the {count} frames.")
    check_rotations(poses[:, :3, :3], file)
    viewmats = np.linalg.inv(poses) @ poses[0]
    words = f"{focal:.6g} pixels, " + ("as set" if options.focal else "the resolution of the published lens in the middle")
    cameras = [Camera(*size, focal, focal, size[0] / 2, size[1] / 2, viewmat) for viewmat in viewmats]
    return clip_cameras(cameras, f"the camera moves, from {POSES}", words, options)

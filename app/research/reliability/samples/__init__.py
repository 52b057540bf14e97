"""Small sound files of every kind that the program reads, from which the damaged ones are made."""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path

import cv2
import numpy as np

from degense.app.session.sample import demo_run
from degense.engine.annotation import folder as annotation_folder
from degense.engine.annotation.annotations import Annotations
from degense.engine.annotation.edits import named_classes
from degense.engine.annotation.formats import LABEL_FORMATS, MapSet
from degense.engine.clip import UNLABELLED
from degense.engine.data.synthetic.clip import PhantomOptions, make_phantom

FRAMES, WIDTH, HEIGHT = 4, 64, 48
SHAPE = (HEIGHT, WIDTH)
NAMES = tuple(f"{index:06d}" for index in range(FRAMES))
CLASSES = ("liver", "gallbladder", "grasper")


def phantom(folder: Path) -> Path:
    """A clip of a few small frames with all that may lie beside them."""
    make_phantom(folder, PhantomOptions(frames=FRAMES, width=WIDTH, height=HEIGHT, tool_masks=True))
    return folder


def jpeg_clip(folder: Path) -> Path:
    """Bare pictures: one JPEG a frame."""
    (folder / "images").mkdir(parents=True)
    for index, picture in enumerate(pictures()):
        cv2.imwrite(str(folder / "images" / f"{index:06d}.jpg"), picture)
    return folder


def endonerf(folder: Path) -> Path:
    """As EndoNeRF has it: `poses_bounds.npy` beside pictures, masks and depth."""
    source = phantom(folder)
    shutil.rmtree(source / "depth")
    (source / "camera.json").unlink()
    poses = np.concatenate([np.tile(np.eye(3, 4), (FRAMES, 1, 1)), np.tile([[HEIGHT], [WIDTH], [80.0]], (FRAMES, 1, 1))], 2)
    np.save(source / "poses_bounds.npy", np.concatenate([poses.reshape(FRAMES, 15), np.tile([1.0, 100.0], (FRAMES, 1))], 1))
    return source


def nerfstudio(folder: Path) -> Path:
    """Pictures with a `transforms.json`."""
    jpeg_clip(folder)
    frames = [{"file_path": f"images/{index:06d}.jpg", "transform_matrix": np.eye(4).tolist()} for index in range(FRAMES)]
    lens = {"w": WIDTH, "h": HEIGHT, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0, "k1": 0.01, "camera_model": "OPENCV"}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}), encoding="utf-8")
    return folder


def colmap_text(folder: Path) -> Path:
    """Pictures with a sparse model in text files."""
    jpeg_clip(folder)
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text(f"# cameras\n1 PINHOLE {WIDTH} {HEIGHT} 60 60 32 24\n", encoding="utf-8")
    lines = [f"{i + 1} 1 0 0 0 0 0 {i}e-3 1 {i:06d}.jpg\n1.5 2.5 1" for i in range(FRAMES)]
    (model / "images.txt").write_text("\n".join(["# images", *lines]) + "\n", encoding="utf-8")
    (model / "points3D.txt").write_text("1 0.1 0.2 3.0 9 9 9 0.1 1 0\n2 -0.1 0.2 3.5 9 9 9 0.1 2 0\n", encoding="utf-8")
    return folder


def colmap_binary(folder: Path) -> Path:
    """The same in binary files."""
    jpeg_clip(folder)
    model = folder / "sparse" / "0"
    model.mkdir(parents=True)
    (model / "cameras.bin").write_bytes(struct.pack("<QIiQQ4d", 1, 1, 1, WIDTH, HEIGHT, 60, 60, 32, 24))
    images = b"".join(
        struct.pack("<I7dI", i + 1, 1, 0, 0, 0, 0, 0, i / 1000, 1) + f"{i:06d}.jpg\0".encode() + struct.pack("<Q2dQ", 1, 1.5, 2.5, 1)
        for i in range(FRAMES)
    )
    (model / "images.bin").write_bytes(struct.pack("<Q", FRAMES) + images)
    points = b"".join(struct.pack("<Q3d3BdQ2I", i, 0.1, 0.2, 3 + i, 9, 9, 9, 0.1, 1, 1, 0) for i in range(3))
    (model / "points3D.bin").write_bytes(struct.pack("<Q", 3) + points)
    return folder


def video(path: Path, views: int = 1) -> Path:
    """A movie file, of so many views one above the other."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25, (WIDTH, views * HEIGHT))
    for picture in pictures():
        writer.write(np.vstack([picture] * views))
    writer.release()
    return path


def labels(name: str, folder: Path) -> Path:
    """Label maps in one of the formats of other tools."""
    path = folder / f"labels{LABEL_FORMATS[name].suffix}"
    classes = named_classes(("Liver", "Gallbladder", "Fat") if name == "cholecseg8k" else ("instrument-shaft", "kidney-parenchyma"))
    for _ in LABEL_FORMATS[name].write(MapSet(classes, SHAPE, NAMES, (0, 2), lambda frame: label_map(len(classes))), path):
        pass
    return path


def annotated(folder: Path) -> Path:
    """The folder of annotations of a clip."""
    work = Annotations(named_classes(CLASSES), SHAPE, FRAMES, lambda frame: None)
    work.replace_labels({0: label_map(3), 2: label_map(2)}, "sample")
    annotation_folder.save(work, folder / annotation_folder.NAME)
    return folder / annotation_folder.NAME


def points(kind: str, folder: Path) -> Path:
    """Points that are followed, as .json, .csv or .npz."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"points.{kind}"
    if kind == "json":
        path.write_text(json.dumps({str(i): [[1.5 + i, 2.5], None, [30, 20]] for i in range(FRAMES)}), encoding="utf-8")
    elif kind == "csv":
        rows = [f"{i},{x},20.5,{k}" for i in range(FRAMES) for k, x in enumerate((3.5, 40.0))]
        path.write_text("\n".join(["frame,x,y,point", *rows]) + "\n", encoding="utf-8")
    else:
        np.savez(path, points=np.full((3, FRAMES, 2), 0.5, np.float32), occluded=np.zeros((3, FRAMES), bool))
    return path


def run(folder: Path) -> Path:
    """A finished run: the sample that comes with the program, as an earlier version wrote it."""
    shutil.copytree(demo_run(), folder, ignore=shutil.ignore_patterns("previews"))
    return folder


def pictures() -> list[np.ndarray]:
    """Frames of the clips: BGR, uint8 [H, W, 3], a texture that moves."""
    rng = np.random.default_rng(0)
    base = cv2.GaussianBlur(rng.integers(0, 255, (HEIGHT, WIDTH * 2, 3), np.uint8), (0, 0), 2)
    return [np.ascontiguousarray(base[:, index : index + WIDTH]) for index in range(FRAMES)]


def label_map(count: int) -> np.ndarray:
    """A label map uint8 [H, W] with a hole, an island and unlabelled pixels."""
    found = np.full(SHAPE, UNLABELLED, np.uint8)
    for value in range(count):
        found[8 + 10 * value : 16 + 10 * value, 6:40] = value
    found[10:13, 10:14] = UNLABELLED
    found[2:4, 50:60] = 0
    return found

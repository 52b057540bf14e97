"""Small sound clips laid out as public data sets have them, from which damaged ones are made."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from degense.app.research.reliability.samples import FRAMES, HEIGHT, SHAPE, WIDTH, label_map, pictures, video
from degense.engine.data.readers.cholecseg8k import CLASSES as CHOLEC_CLASSES
from degense.engine.data.readers.endovis18 import CLASSES as ENDOVIS_CLASSES
from degense.engine.data.readers.endovis18 import SIZE as ENDOVIS_SIZE

#: A matrix as OpenCV writes it into YAML.
MATRIX = "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {values} ]\n"


def servct(folder: Path) -> Path:
    """As SERV-CT has it: left views, their calibrations and depth."""
    for index, picture in enumerate(pictures()):
        _save(folder / "Left_rectified" / f"{index:03d}.png", picture)
        _save(folder / "Ground_truth_CT" / "DepthL" / f"{index:03d}.png", np.full(SHAPE, 5000, np.uint16))
        lens = {"P1": {"data": [60, 0, 32, 0, 0, 60, 24, 0, 0, 0, 1, 0]}}
        _write(folder / "Rectified_calibration" / f"{index:03d}.json", json.dumps(lens))
    return folder


def c3vd(folder: Path) -> Path:
    """As C3VD has it: frames, depth and camera-to-world matrices."""
    poses = []
    for index, picture in enumerate(pictures()):
        _save(folder / f"{index:04d}_color.png", picture)
        _save(folder / f"{index:04d}_depth.tiff", np.full(SHAPE, 30_000, np.uint16))
        pose = np.eye(4)
        pose[0, 3] = 1.0 + index
        poses.append(",".join(map(str, pose.T.ravel())))
    _write(folder / "pose.txt", "\n".join(poses) + "\n")
    return folder


def cholecseg8k(folder: Path) -> Path:
    """As CholecSeg8k has it: frames with watershed masks, one with a colour mask alone."""
    codes = np.array([code for _, code, _ in CHOLEC_CLASSES], np.uint8)
    colours = np.array([colour for _, _, colour in CHOLEC_CLASSES], np.uint8)
    classes = np.minimum(label_map(3), len(CHOLEC_CLASSES) - 1)
    for index, picture in enumerate(pictures()):
        _save(folder / f"frame_{index}_endo.png", picture)
        if index == 0:
            _save(folder / f"frame_{index}_endo_color_mask.png", colours[classes][..., ::-1])
        else:
            _save(folder / f"frame_{index}_endo_watershed_mask.png", codes[classes])
    return folder


def endovis18(folder: Path) -> Path:
    """As EndoVis 2018 has it: left frames, colour masks with the table of their colours, and the calibration."""
    colours = np.array([colour for _, colour in ENDOVIS_CLASSES], np.uint8)
    classes = np.minimum(label_map(4), len(ENDOVIS_CLASSES) - 1)
    size = (ENDOVIS_SIZE[0] // 20, ENDOVIS_SIZE[1] // 20)  # the calibration is for frames of these proportions
    for index, picture in enumerate(pictures()):
        _save(folder / "left_frames" / f"frame{index:03d}.png", cv2.resize(picture, size))
        _save(folder / "labels" / f"frame{index:03d}.png", cv2.resize(colours[classes][..., ::-1], size, interpolation=cv2.INTER_NEAREST))
    table = [{"name": name, "color": colour, "classid": number} for number, (name, colour) in enumerate(ENDOVIS_CLASSES)]
    _write(folder / "labels.json", json.dumps(table))
    lines = ("Camera-0-F: 1080.1 1080.2", "Camera-0-C: 600.5 500.5", "Camera-0-K: 0.001 -0.002 0.0 0.0 0.0")
    _write(folder / "camera_calibration.txt", "\n".join(lines) + "\n")
    return folder


def stir(folder: Path) -> Path:
    """As STIR has it: the video of a view, its calibration, and the tattoos at the beginning and the end; the folder of the sequence."""
    sequence = folder / "left" / "seq00"
    (sequence / "frames").mkdir(parents=True)
    video(sequence / "frames" / "00000ms-00160ms-visible.mp4")
    lens = [[1000.0, 0, 640.0], [0, 1010.0, 512.0], [0, 0, 1]]
    _write(folder / "calib.json", json.dumps({"leftcameramat": lens, "leftdistortioncoeffs": [[0, 0, 0, 0, 0]]}))
    for name, shift in (("icgstartseg", 0), ("icgendseg", 3)):
        picture = np.zeros((*SHAPE, 3), np.uint8)
        picture[10:14, 20 + shift : 26 + shift] = picture[30:34, 40 + shift : 46 + shift] = 255
        _save(sequence / "segmentation" / f"{name}.png", picture)
    return sequence


def vl_surgpt(folder: Path) -> Path:
    """As VL-SurgPT has it: STIR's tree with a file of points."""
    sequence = folder / "left" / "seq00"
    (sequence / "frames").mkdir(parents=True)
    video(sequence / "frames" / "clip.mp4")
    points = {str(frame): [[20.5 + frame, 12.5], None if frame == 1 else [40, 30]] for frame in range(FRAMES)}
    _write(sequence / "annotation" / "labels.json", json.dumps(points))
    return sequence


def surgt(folder: Path) -> Path:
    """As SurgT has it: a stereo video, its calibration and the boxes of one piece of tissue."""
    folder.mkdir(parents=True)
    video(folder / "video.mp4", views=2)
    said = f"name_video: video.mp4\nvideo_stack: vertical\nresolution: {{width: {WIDTH}, height: {HEIGHT}}}\n"
    _write(folder / "info.yaml", said + "name_ground_truth:\n- gt_rectified_0.yaml\n")
    lens = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    matrices = {"M1": lens, "M2": lens, "R": np.eye(3), "T": np.array([[-4.0, 0, 0]]), "D1": np.zeros((1, 5)), "D2": np.zeros((1, 5))}
    text = "%YAML:1.0\n---\n"
    for name, values in matrices.items():
        rows, columns = values.shape
        text += MATRIX.format(name=name, rows=rows, columns=columns, values=", ".join(map(str, values.ravel().tolist())))
    _write(folder / "calibration.yaml", text)
    boxes = [f"{frame}: [true, false, [[{10 + frame}, 20, 8, 6], [{7 + frame}, 20, 8, 6]]]" for frame in range(FRAMES)]
    _write(folder / "gt_rectified_0.yaml", "\n".join(boxes) + "\n")
    return folder


def _save(path: Path, picture: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), picture)


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")

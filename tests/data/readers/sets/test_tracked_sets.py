"""STIR, VL-SurgPT and SurgT, in made-up trees of their layouts: the clips, their cameras, and where their points are."""

import json

import cv2
import numpy as np
import pytest

from degense.engine.data.clip_options import ClipOptions
from degense.engine.data.files.point_files import read_points
from degense.engine.data.readers import detect, open_clip
from degense.engine.data.readers.detect import list_clips
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, fails, save, write_video

FRAMES = 6
MATRIX = "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: f\n   data: [ {data} ]\n"


def write_stir(root, labels=None):
    """One sequence; tattoos at (20, 10) and (50, 30) that end at (24, 12) and (50, 40)."""
    sequence = root / "1" / "left" / "seq00"
    (sequence / "frames").mkdir(parents=True)
    write_video(sequence / "frames" / "00000ms-00240ms-visible.mp4", np.random.default_rng(0), FRAMES)
    if labels is not None:
        (sequence / "annotation").mkdir()
        (sequence / "annotation" / "labels.json").write_text(json.dumps(labels))
        return sequence
    lens = [[1000.0, 0, 640.0], [0, 1010.0, 512.0], [0, 0, 1]]
    calibration = {"leftcameramat": lens, "leftdistortioncoeffs": [[0, 0, 0, 0, 0]], "rightcameramat": lens}
    (root / "1" / "calib.json").write_text(json.dumps(calibration))
    for name, middles in {"icgstartseg": [(20, 10), (50, 30)], "icgendseg": [(24, 12), (50, 40)]}.items():
        picture = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        for x, y in middles:
            picture[y - 2 : y + 2, x - 3 : x + 3] = 255
        save(sequence / "segmentation" / f"{name}.png", picture)
    return sequence


def write_surgt(folder, boxes, turned=False):
    """A case whose views stand one above the other, and the file of its one piece of tissue."""
    folder.mkdir(parents=True, exist_ok=True)
    write_video(folder / "video.mp4", np.random.default_rng(1), FRAMES, (WIDTH, 2 * HEIGHT))
    (folder / "info.yaml").write_text(
        f"name_video: video.mp4\nvideo_stack: vertical\nresolution: {{width: {WIDTH}, height: {HEIGHT}}}\n"
        "name_ground_truth:\n- gt_rectified_0.yaml\n"
    )
    turn = cv2.Rodrigues(np.array([0.0, 0.02, 0.0]) * turned)[0]
    matrices = {"R": turn, "T": np.array([[-4.0, 0, 0]]), "D1": np.zeros((1, 5)), "D2": np.zeros((1, 5))}
    matrices |= {name: np.array([[90.0, 0, 47.5], [0, 90, 31.5], [0, 0, 1]]) for name in ("M1", "M2")}
    text = "%YAML:1.0\n---\n"
    for name, values in matrices.items():
        text += MATRIX.format(name=name, rows=len(values), cols=values.shape[1], data=", ".join(map(repr, map(float, values.ravel()))))
    (folder / "calibration.yaml").write_text(text)
    (folder / "gt_rectified_0.yaml").write_text(boxes)
    return folder


BOXES = """
0: !!python/tuple
- true
- false
- - [10, 20, 8, 6]
  - [7, 20, 8, 6]
1: [true, true, [[11, 20, 8, 6], [8, 20, 8, 6]]]
2: [false, false, null]
3: [true, false, [[12, 22, 8, 6], [9, 22, 8, 6]]]
99: [true, false, [[0, 0, 1, 1], [0, 0, 1, 1]]]
"""


def test_a_sequence_of_stir_opens_with_its_camera_and_its_tattoos(tmp_path):
    sequence = write_stir(tmp_path)
    assert detect(sequence) == "stir"
    clip = open_clip(sequence)
    assert (len(clip), clip.size, clip.name, clip.path) == (FRAMES, (WIDTH, HEIGHT), "seq00", sequence)
    assert clip.cameras[0].fx == pytest.approx(1000 * WIDTH / 1280)
    assert clip.cameras[0].cy == pytest.approx(512 * WIDTH / 1280 + 0.5)
    assert "calib.json" in clip.provenance["focal"]
    assert open_clip(sequence, ClipOptions(focal=77.0)).cameras[0].fx == 77

    for path in (sequence, sequence / "segmentation" / "icgstartseg.png"):
        points = read_points(path, FRAMES, (WIDTH, HEIGHT))
        assert sorted(points.queries.tolist()) == [[0, 20, 10], [0, 50, 30]]
        assert sorted(points.ends.tolist()) == [[24, 12], [50, 40]]
    halved = read_points(sequence, FRAMES, (WIDTH // 2, HEIGHT // 2))
    assert sorted(halved.queries[:, 1:].tolist()) == [[10, 5], [25, 15]]
    assert {entry.layout for entry in list_clips(tmp_path)} == {"stir"}


def test_ends_are_paired_with_the_nearest_point(tmp_path):
    points = read_points(write_stir(tmp_path), FRAMES, (WIDTH, HEIGHT))
    followed = np.zeros((2, FRAMES, 2))
    first = int(points.queries[0, 1] == 20)  # which of the two began at (50, 30)
    followed[first, -1], followed[1 - first, -1] = (40, 38), (23, 23)
    paired = points.paired(followed)
    assert paired.pixels[first, -1].tolist() == [50, 40]
    assert paired.pixels[1 - first, -1].tolist() == [24, 12]
    assert np.isnan(paired.pixels[:, 1:-1]).all()
    assert paired.ends is None


def test_vl_surgpt_shares_the_tree(tmp_path):
    sequence = write_stir(tmp_path, {"0": [[3, 4], None], "5": [[5, 6], [7, 8]]})
    assert detect(sequence) == "stir"
    points = read_points(sequence, FRAMES, (WIDTH, HEIGHT))
    assert points.queries.tolist() == [[0, 3, 4], [5, 7, 8]]
    assert points.ends is None


@pytest.mark.parametrize("turned", [False, True])
def test_a_case_of_surgt_is_its_rectified_left_view(tmp_path, turned):
    case = write_surgt(tmp_path / "case_1" / "1", BOXES, turned)
    assert detect(case) == "surgt"
    clip = open_clip(case)
    assert (len(clip), clip.size) == (FRAMES, (WIDTH, HEIGHT))
    stacked = open_clip(case / "video.mp4").frame(2)
    difference = np.abs(clip.frame(2).astype(int) - stacked[:HEIGHT])[8:-8, 8:-8].mean()
    if turned:
        assert difference > 1  # resampled
    else:  # alpha 0 crops what is not seen, here nothing
        assert difference < 1
        assert clip.cameras[0].fx == pytest.approx(90)
    points = read_points(case, FRAMES, clip.size)
    assert points.queries.tolist() == [[0, 14, 23]]
    assert points.pixels[0, 3].tolist() == [16, 25]
    assert np.isnan(points.pixels[0, 1]).all()  # difficult: neither known nor hidden
    assert points.hidden[0].tolist() == [False, False, True, False, False, False]
    assert read_points(case / "info.yaml", FRAMES, clip.size).queries.tolist() == [[0, 14, 23]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("gt_rectified_0.yaml", "0: !!python/object/apply:os.system ['true']"),
        ("gt_rectified_0.yaml", "0: [true, false, [[1, 2]]]"),
        ("gt_rectified_0.yaml", '"1": [true, false, [[1, 2, 3, 4]]]'),
        ("gt_rectified_0.yaml", "1.5: [true, false, null]"),
        ("gt_rectified_0.yaml", "0: [true, false, []]"),
        ("gt_rectified_0.yaml", "["),
        ("info.yaml", "name_video: video.mp4"),
        ("info.yaml", "[1]"),
        ("info.yaml", "[" * 50_000),
        ("info.yaml", "name_video: ../../x\nvideo_stack: vertical\nresolution: {width: 8, height: 8}\nname_ground_truth: []"),
        ("calibration.yaml", "%YAML:1.0\n---\nM1: 3\n"),
        ("calibration.yaml", "%YAML:1.0\n---\nM1: " + "[" * 400_000),
        ("calibration.yaml", "%YAML:1.0\n---\nM1: " + "[" * 16_000),
        ("calibration.yaml", "%YAML:1.0\n---\n" + MATRIX.format(name="M1", rows=3, cols=3, data=", ".join(["0."] * 9))),
    ],
    ids=range(14),
)
def test_what_is_damaged_or_hostile_is_refused_in_a_sentence(tmp_path, name, content):
    case = write_surgt(tmp_path, BOXES)
    (case / name).write_text(content)
    refused = []
    for read in (open_clip, lambda path: read_points(path, FRAMES, (WIDTH, HEIGHT))):
        try:
            read(case)
        except ClipError as error:
            refused.append(str(error))
    assert refused
    assert all(sentence.endswith(".") and "\n" not in sentence for sentence in refused)


def test_folders_without_points_and_broken_cameras_are_named(tmp_path):
    with pytest.raises(ClipError, match=r"neither labels\.json, nor"):
        read_points(tmp_path, FRAMES, (WIDTH, HEIGHT))
    sequence = write_stir(tmp_path)
    (tmp_path / "1" / "calib.json").write_text('{"leftcameramat": [[1]]}')
    fails(sequence, "leftcameramat")
    write_video(sequence / "frames" / "second.mp4", np.random.default_rng(0), 2)
    fails(sequence, "holds 2 videos")

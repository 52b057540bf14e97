"""Raw EndoVis 2018 sequences, in made-up trees of the official layout."""

import json

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import detect, open_clip
from degense.engine.data.readers.endovis18 import CLASSES
from degense.engine.errors import ClipError
from tests.data.readers.makers import disc, save, tissue

WIDTH, HEIGHT = 80, 64  # 5 : 4, as the published frames

# written down from the challenge's labels.json, independently of the reader's
TABLE = {"background-tissue": "000000", "instrument-shaft": "00ff00", "instrument-clasper": "00ffff", "instrument-wrist": "7dff0c"}
TABLE |= {"kidney-parenchyma": "ff3700", "covered-kidney": "18377d", "thread": "bb9b19", "clamps": "00ff7d"}
TABLE |= {"suturing-needle": "ffff7d", "suction-instrument": "7b0faf", "small-intestine": "7c9b05", "ultrasound-probe": "0cff8d"}
CALIBRATION = """Camera-0-F: 1084.20 1080.00                               // left camera x,y focal dist in pixels
Camera-0-C: 640.00 512.00                                 // left camera x,y center in pixels
Camera-0-K: -0.00069 0.00195 0.00018 0.00000 0.00000      // left camera radial distortion
Camera-1-F: 1.0 1.0
Extrinsic-T: -4.37042 0.00810 -0.03388
"""


def colours():
    return np.array([list(bytes.fromhex(code)) for code in TABLE.values()], np.uint8)


def write_release(root, sequences=("seq_1",), count=4, labels=True, table=True):
    """A release of the data set; the label map of all frames."""
    random = np.random.default_rng(0)
    maps = random.integers(0, len(TABLE), (HEIGHT, WIDTH)).astype(np.uint8)
    for name in sequences:
        for i in range(count):
            frame = np.where(disc(WIDTH, HEIGHT)[..., None], tissue(random, WIDTH, HEIGHT), 2).astype(np.uint8)
            save(root / name / "left_frames" / f"frame{i:03d}.png", frame)
            save(root / name / "right_frames" / f"frame{i:03d}.png", frame)
            if labels:
                mask = colours()[maps]
                mask[3, :] = (1, 2, 3)
                alpha = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
                save(root / name / "labels" / f"frame{i:03d}.png", np.concatenate([mask, alpha], -1))
        (root / name / "camera_calibration.txt").write_text(CALIBRATION)
    if table:
        entries = [{"name": n, "color": list(bytes.fromhex(c)), "classid": i} for i, (n, c) in enumerate(TABLE.items())]
        (root / "labels.json").write_text(json.dumps(entries[::-1]))
    maps[3, :] = UNLABELLED
    return maps


def test_the_published_table():
    assert {name: bytes(colour).hex() for name, colour in CLASSES} == TABLE
    assert [name for name, _ in CLASSES] == list(TABLE)


@pytest.mark.parametrize("table", [True, False])
def test_a_sequence_opens_with_its_labels_cameras_and_field_of_view(tmp_path, table):
    maps = write_release(tmp_path, table=table)
    path = tmp_path / "seq_1"
    assert detect(path) == "endovis18"
    clip = open_clip(path)
    assert (len(clip), clip.size, clip.classes) == (4, (WIDTH, HEIGHT), tuple(TABLE))
    assert clip.labelled_frames == [0, 1, 2, 3]
    np.testing.assert_array_equal(clip.labels(2), maps)
    camera = clip.cameras[0]
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((1084.2 / 16, 67.5, 40, 32))
    assert "camera_calibration.txt, scaled from 1280" in clip.provenance["focal"]
    assert clip.poses == "auto"
    assert ("labels.json" if table else "published table") in clip.provenance["labels"]
    assert "1.6 % of the pixels have no class's colour" in clip.provenance["labels"]
    assert not clip.valid(0)[~disc(WIDTH, HEIGHT)].any()
    assert "left view" in clip.provenance["frames"]


def test_another_table_beside_the_frames_wins(tmp_path):
    write_release(tmp_path, count=1)
    own = [{"name": "kidney", "color": [255, 55, 0], "classid": 0}, {"name": "rest", "color": [0, 0, 0], "classid": 1}]
    (tmp_path / "seq_1" / "labels.json").write_text(json.dumps(own))
    clip = open_clip(tmp_path / "seq_1")
    assert clip.classes == ("kidney", "rest")
    assert set(np.unique(clip.labels(0))) == {0, 1, UNLABELLED}


def _entry(**changes):
    return json.dumps([{"name": "a", "color": [0, 0, 0], "classid": 0, **changes}])


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("labels.json", "{", "labels.json is not valid JSON"),
        ("labels.json", "[3]", r"labels.json must look like"),
        ("labels.json", _entry(classid=1), "without a gap"),
        ("labels.json", _entry(color=[0, 0, 256]), "from 0 to 255"),
        ("labels.json", json.dumps([json.loads(_entry())[0], json.loads(_entry(classid=1, name="b"))[0]]), "one colour or one name"),
        ("seq_1/camera_calibration.txt", "Camera-0-F: nan 3", "camera_calibration.txt needs lines such as"),
        ("seq_1/camera_calibration.txt", "Camera-0-F: 1000 1000\nCamera-0-C: 9000 3", "camera_calibration.txt needs lines such as"),
    ],
)
def test_errors_name_the_file_and_the_reason(tmp_path, file, text, words):
    write_release(tmp_path, count=1)
    (tmp_path / file).write_text(text)
    with pytest.raises(ClipError, match=words):
        open_clip(tmp_path / "seq_1")


def test_wrong_pictures_are_named(tmp_path):
    write_release(tmp_path, count=2)
    save(tmp_path / "seq_1" / "labels" / "frame007.png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    with pytest.raises(ClipError, match=r"frame007\.png belongs to no frame in left_frames/"):
        open_clip(tmp_path / "seq_1")
    save(tmp_path / "seq_1" / "labels" / "frame001.png", np.zeros((4, 4, 3), np.uint8))
    (tmp_path / "seq_1" / "labels" / "frame007.png").unlink()
    with pytest.raises(ClipError, match=r"frame001\.png is 4 × 4 pixels"):
        open_clip(tmp_path / "seq_1")
    for frame in (tmp_path / "seq_1" / "left_frames").iterdir():
        frame.unlink()
    with pytest.raises(ClipError, match="left_frames holds no pictures"):
        open_clip(tmp_path / "seq_1")

"""Raw CholecSeg8k folders."""

import numpy as np
import pytest

from degense.engine.clip import UNLABELLED
from degense.engine.data.readers import detect, open_clip
from degense.engine.data.readers.cholecseg8k import CLASSES, CODES, NAMES, from_watershed
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, disc, save, tissue

# written down from the data set's table, independently of the reader's
GREY = {"Black Background": 50, "Abdominal Wall": 11, "Liver": 21, "Gastrointestinal Tract": 13, "Fat": 12, "Grasper": 31}
GREY |= {"Connective Tissue": 23, "Blood": 24, "Cystic Duct": 25, "L-hook Electrocautery": 32, "Gallbladder": 22, "Hepatic Vein": 33}
GREY |= {"Liver Ligament": 5}
HEX = {"Black Background": "7f7f7f", "Abdominal Wall": "d28c8c", "Liver": "ff7272", "Gastrointestinal Tract": "e7469c", "Fat": "bab74b"}
HEX |= {"Grasper": "aaff00", "Connective Tissue": "ff5500", "Blood": "ff0000", "Cystic Duct": "ffff00", "L-hook Electrocautery": "a9ffb8"}
HEX |= {"Gallbladder": "ffa0a5", "Hepatic Vein": "003280", "Liver Ligament": "6f4a00"}


def write_clip(path, first=80, count=5, colour_only=False, masks=True):
    rng = np.random.default_rng(first)
    labels = np.where(disc(), rng.integers(1, 13, (HEIGHT, WIDTH)), 0).astype(np.uint8)
    for k in range(first, first + count):
        frame = np.where(disc()[..., None], tissue(rng), 3).astype(np.uint8)
        save(path / f"frame_{k}_endo.png", frame)
        if masks:
            grey = np.array([GREY[n] for n in NAMES], np.uint8)[labels]
            grey[5, :] = 255  # a white outline
            colours = np.array([[int(HEX[n][i : i + 2], 16) for i in (0, 2, 4)] for n in NAMES], np.uint8)[labels]
            colours[5, :] = 255
            save(path / f"frame_{k}_endo_color_mask.png", colours)
            save(path / f"frame_{k}_endo_mask.png", colours)
            if not colour_only:
                save(path / f"frame_{k}_endo_watershed_mask.png", np.dstack([grey, grey, grey]))
    labels[5, :] = UNLABELLED
    return labels


def test_codes_are_those_of_the_published_table():
    assert len(CLASSES) == 13
    for name, grey, colour in CLASSES:
        assert grey == GREY[name]
        assert bytes(colour).hex() == HEX[name]
        assert NAMES[from_watershed(np.array([[grey]], np.uint8))[0, 0]] == name
        assert NAMES[CODES.labels(np.array([[colour]], np.uint8))[0, 0]] == name


def test_unknown_codes_are_unlabelled():
    known = set(GREY.values())
    codes = np.arange(256, dtype=np.uint8)[None]
    labels = from_watershed(codes)[0]
    assert {int(c) for c in codes[0][labels != UNLABELLED]} == known
    rng = np.random.default_rng(0)
    colours = rng.integers(0, 256, (50, 50, 3)).astype(np.uint8)
    table = {bytes.fromhex(HEX[n]): i for i, n in enumerate(NAMES)}
    expected = [[table.get(bytes(p), UNLABELLED) for p in row] for row in colours]
    np.testing.assert_array_equal(CODES.labels(colours), expected)


@pytest.mark.parametrize("colour_only", [False, True])
def test_frames_in_numeric_order_with_labels_and_field_of_view(tmp_path, colour_only):
    labels = write_clip(tmp_path / "video01_00098", first=98, colour_only=colour_only)  # 98 … 102: text order would differ
    clip = open_clip(tmp_path / "video01_00098")
    assert detect(tmp_path / "video01_00098") == "cholecseg8k"
    assert [f.name for f in clip.pictures.files] == [f"frame_{k}_endo.png" for k in range(98, 103)]
    assert clip.classes == NAMES
    assert clip.labelled_frames == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(clip.labels(3), labels)
    valid = clip.valid(0)
    assert not valid[~disc()].any()
    assert valid[disc()].mean() > 0.85
    assert ("colour" if colour_only else "watershed") in clip.provenance["labels"]
    assert "unlabelled" in clip.provenance["labels"]
    assert "labelled Black Background" in clip.provenance["masks"]


def test_without_masks_the_dark_border_tells_the_field_of_view(tmp_path):
    write_clip(tmp_path, masks=False)
    clip = open_clip(tmp_path)
    assert clip.classes == ()
    assert clip.labels(0) is None
    assert not clip.valid(0)[~disc()].any()
    assert "dark border" in clip.provenance["masks"]


def test_a_folder_of_several_clips_lists_them(tmp_path):
    write_clip(tmp_path / "video01/video01_00080", count=1)
    write_clip(tmp_path / "video01/video01_00160", count=1)
    for path in (tmp_path / "video01", tmp_path):
        with pytest.raises(ClipError, match=r"video01_00080, .*video01_00160; open one of them\."):
            open_clip(path)

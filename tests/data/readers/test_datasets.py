"""Folders of clips: what is listed, what it says of each, and what is wrong with which."""

import json

import pytest

from degense.app.cli.main import main
from degense.engine.data.readers import open_clip
from degense.engine.data.readers.detect import list_clips
from degense.engine.errors import ClipError
from tests.data.readers import test_cholecseg8k, test_endovis18
from tests.data.readers.makers import save


def test_both_data_sets_are_listed_with_splits_and_classes(tmp_path):
    endovis = tmp_path / "EndoVis"
    test_endovis18.write_release(endovis / "train_data" / "release_1", ("seq_1", "seq_2"))
    test_endovis18.write_release(endovis / "test_data", ("seq_1",), count=3)
    entries = {str(e.path.relative_to(endovis)): e for e in list_clips(endovis)}
    assert {name: (e.split, e.frames, e.labelled) for name, e in entries.items()} == {
        "test_data/seq_1": ("test", 3, 3),
        "train_data/release_1/seq_1": ("train", 4, 4),
        "train_data/release_1/seq_2": ("train", 4, 4),
    }
    assert entries["test_data/seq_1"].classes == tuple(test_endovis18.TABLE)

    cholec = tmp_path / "CholecSeg8k"
    for name in ("video01_00080", "video01_00160"):
        test_cholecseg8k.write_clip(cholec / "video01" / name)
    assert {e.path.name: (e.layout, e.split, e.test_frames) for e in list_clips(cholec)} == {
        "video01_00080": ("cholecseg8k", "test", 1),
        "video01_00160": ("cholecseg8k", "train", 1),
    }
    with pytest.raises(ClipError, match=r"holds 3: .*open one of them"):
        open_clip(endovis)


def test_the_command_tells_what_is_wrong_with_which_clip(tmp_path, capsys):
    test_endovis18.write_release(tmp_path, ("seq_1", "seq_2"))
    broken = tmp_path / "seq_2" / "left_frames" / "frame002.png"
    broken.write_bytes(broken.read_bytes()[:200])
    (tmp_path / "loop").symlink_to(tmp_path)
    assert main(["datasets", str(tmp_path), "--json", str(tmp_path / "list.json")]) == 0
    first, second, last = capsys.readouterr().out.strip().splitlines()
    assert first.startswith("seq_1: endovis18, train, 4 frames (1 held out), 80 × 64, 4 labelled: background-tissue, instrument-shaft")
    assert second.startswith("seq_2: ")
    assert "frame002.png" in second
    assert last == "2 clips, 4 frames; 1 cannot be opened"
    entries = json.loads((tmp_path / "list.json").read_text())
    assert [bool(entry["problem"]) for entry in entries] == [False, True]
    assert main(["datasets", str(tmp_path / "seq_1")]) == 0
    assert "1 clips, 4 frames" in capsys.readouterr().out


def test_a_folder_without_clips_is_an_error(tmp_path, capsys):
    save(tmp_path / "notes" / "a.png", test_endovis18.colours()[None])
    assert main(["datasets", str(tmp_path)]) == 2
    assert "holds no clips: no images/, no folder of a known data set" in capsys.readouterr().err
    assert main(["datasets", str(tmp_path / "nowhere")]) == 2

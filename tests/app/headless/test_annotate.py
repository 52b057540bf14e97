"""`degense annotate`, `degense import`, and strokes that survive the death of the program."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from degense.app.cli.main import main
from degense.app.features.annotate.state import AnnotationState
from degense.app.session.session import Session
from degense.app.session.state_folder import held
from degense.engine.annotation.folder import INDEX, NAME
from degense.engine.annotation.painting import brush
from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from tests.app.painting import FakeScene, annotating

#: Paints a stroke twenty times a second until it is killed; prints how many are done.
PAINTER = """
import sys, time
from pathlib import Path
from degense.engine.annotation.painting import brush
from tests.app.painting import FakeScene, annotating

session, annotations = annotating()
session.open_scene(FakeScene(Path(sys.argv[1])))
for number in range(10_000):
    x, y = 2.5 + 4 * (number % 11), 2.5 + 4 * (number // 11 % 9)
    annotations.tool.choose(label=number % 2)
    annotations.paint("Dab", brush((x, y), (x, y), 1.5, (40, 48)))
    if number == 5:
        session.save()
    print(number + 1, flush=True)
    time.sleep(0.05)
"""


def painted(folder: Path) -> tuple[Session, AnnotationState, int]:
    """The session that opens the folder, its annotations, and how many dabs are in it."""
    session, annotations = annotating()
    session.open_scene(FakeScene(folder))
    if session.store.unsaved:
        session.recover()
    labels = annotations.work.labels(0)
    return session, annotations, sum(labels[2 + 4 * (n // 11), 2 + 4 * (n % 11)] == n % 2 for n in range(99))


def test_kill_minus_nine_while_painting_loses_no_finished_stroke(tmp_path):
    done = 0
    with subprocess.Popen([sys.executable, "-c", PAINTER, str(tmp_path)], stdout=subprocess.PIPE, text=True, cwd=Path.cwd()) as child:
        for line in child.stdout:
            done = int(line)
            if done == 30:
                os.kill(child.pid, signal.SIGKILL)
    session, _, there = painted(tmp_path)
    assert there >= done
    session.save()
    session.close()
    session, _, again = painted(tmp_path)  # and now without the journal
    assert again == there
    session.close()


def test_damaged_annotations_do_not_open_as_empty(tmp_path):
    session, annotations, _ = painted(tmp_path)
    annotations.paint("Dab", brush((9, 9), (9, 9), 3, (40, 48)))
    session.save()
    session.close()
    index = tmp_path / NAME / INDEX
    index.write_text(index.read_text()[:-20])
    with pytest.raises(DegenseError, match="annotations"):
        painted(tmp_path)
    assert (tmp_path / NAME / INDEX).read_text().startswith("{")


def test_a_full_disk_keeps_the_old_annotations(tmp_path, monkeypatch):
    session, annotations, _ = painted(tmp_path)
    annotations.paint("Dab", brush((9, 9), (9, 9), 3, (40, 48)))
    session.save()
    annotations.paint("Dab", brush((30, 30), (30, 30), 3, (40, 48)))

    def full(source, target):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("degense.engine.files.os.replace", full)
        with pytest.raises(DegenseError, match="No space left"):
            session.save()
    assert session.dirty
    session.close()
    other, others, _ = painted(tmp_path)  # the journal has the rest
    assert others.work.labels(0)[30, 30] == 0
    other.close()


def test_records_from_elsewhere_are_checked(tmp_path):
    session, annotations, _ = painted(tmp_path)
    for record in ({}, {"pieces": 3}, {"pieces": [{"frame": 99}]}, {"classes": [["a", [1, 2]]]}, [], {"classes": [["", [1, 2, 3]]]}):
        with pytest.raises(DegenseError):
            annotations.replay(record, "journal")
    session.close()


def test_colours_of_a_journal_that_are_none_are_brought_into_range(tmp_path):
    session, annotations, _ = painted(tmp_path)
    annotations.replay({"classes": [["a", [2233, -1, 3]], ["b", [1, 2, 3]], ["c", [4, 5, 6]]]}, "journal")
    annotations.paint("Dab", brush((9, 9), (9, 9), 3, (40, 48)))
    session.save()
    session.close()
    session, annotations, _ = painted(tmp_path)
    assert annotations.work.classes[0].colour == (255, 0, 3)
    session.close()


@pytest.fixture
def frame_map(tiny_clip, tmp_path) -> Path:
    path = tmp_path / "frame.png"
    Image.fromarray(open_clip(tiny_clip).labels(6)).save(path)
    return path


def test_what_no_labelled_frame_shows_can_be_a_class(tmp_path, capsys):
    """Grasper and hook come after the labelled frame: called unknown, so that a training does not take them for the nearest class."""
    make_phantom(tmp_path / "clip", PhantomOptions(frames=8, width=96, height=80), lambda fraction, words: None)
    clip, frame_map = open_clip(tmp_path / "clip"), tmp_path / "frame.png"
    first = clip.labels(0)
    Image.fromarray(first).save(frame_map)
    base = ["annotate", str(tmp_path / "clip"), "--labels", str(frame_map), "--frame", "0", "--unknown", "--out"]
    assert main([*base, str(tmp_path / "out")]) == 0
    classes = json.loads((tmp_path / "out/classes.json").read_text())["classes"]
    assert classes == [*clip.classes, "unknown"]
    new = called = 0
    for frame in range(1, 8):
        labels = np.array(Image.open(tmp_path / "out/labels" / f"{frame:06d}.png"))
        assert (labels != 255).all()
        entered = ~np.isin(clip.labels(frame), first)
        new, called = new + entered.sum(), called + (labels[entered] == len(clip.classes)).sum()
    assert new > 100
    assert called > 0.8 * new
    first[0, 0] = 255
    Image.fromarray(first).save(frame_map)
    assert main([*base, str(tmp_path / "again")]) == 2
    assert "label all of their pixels" in capsys.readouterr().err


def test_a_label_map_is_propagated_from_the_command_line(tiny_clip, run, frame_map, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["annotate", str(run), "--labels", str(frame_map), "--frame", "6", "--out", str(out), "--review"]) == 0
    assert " 0 proposals" in capsys.readouterr().out  # all frames of this clip have labels
    shutil.rmtree(out)
    assert main(["annotate", str(run), "--frame", "6", "--labels", str(frame_map), "--out", str(out), "--review", "--replace"]) == 0
    told = capsys.readouterr().out
    assert "from 1 labelled frames, mean confidence" in told
    assert "9 proposals" in told
    clip = open_clip(tiny_clip)
    confidence = json.loads((out / "confidence.json").read_text())
    for frame in range(10):
        labels = np.array(Image.open(out / "labels" / f"{frame:06d}.png"))
        assert (labels == clip.labels(frame)).mean() > (0.8 if frame != 6 else 0.999)
        assert (f"{frame:06d}" == "000006") != (f"{frame:06d}" in confidence)
    kept = json.loads((run / NAME / INDEX).read_text())
    assert sum(entry["carried"] is not None for entry in kept["frames"].values()) == 9
    assert main(["export", str(run), "--format", "cvat", "--out", str(tmp_path / "a.xml")]) == 0  # of what was annotated
    assert "10 label maps of 8 classes" in capsys.readouterr().out
    assert main(["export", str(run), "--format", "cvat", "--source", "masks", "--out", str(tmp_path / "b.xml")]) == 0
    assert main(["info", str(tiny_clip), "--labels", str(out)]) == 0
    assert "from " + str(out) in capsys.readouterr().out


def test_labels_of_other_tools_are_imported(tiny_clip, run, tmp_path, capsys):
    assert main(["export", str(run), "--format", "nifti", "--source", "masks", "--out", str(tmp_path / "a.nii.gz")]) == 0
    assert main(["import", str(run), str(tmp_path / "a.nii.gz"), "--format", "nifti"]) == 0
    assert "10 label maps of 8 classes" in capsys.readouterr().out
    assert main(["export", str(run), "--format", "yolo", "--source", "annotations", "--out", str(tmp_path / "yolo")]) == 0
    assert len(list((tmp_path / "yolo" / "labels").glob("*.txt"))) == 10


def test_labels_that_a_window_has_open_are_not_written(tiny_clip, run, frame_map, capsys):
    with held(run):
        assert main(["annotate", str(run), "--labels", str(frame_map), "--frame", "6", "--review"]) == 2
    assert "is open in a window" in capsys.readouterr().err
    assert not (run / NAME).exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["annotate", "{run}"], "--out PATH"),
        (["annotate", "{run}", "--labels", "{map}", "--out", "x"], "--frame with each"),
        (["annotate", "{run}", "--labels", "{map}", "--frame", "10", "--out", "x"], "no frame 10"),
        (["annotate", "{run}", "--labels", "{clip}/images/000000.png", "--frame", "1", "--out", "x"], "colour picture"),
        (["import", "{run}", "{map}", "--format", "nifti"], "NIfTI"),
        (["import", "{run}", "{map}", "--format", "tiff"], "no format"),
        (["export", "{run}", "--format", "coco", "--source", "annotations", "--out", "x.json"], "no annotations"),
    ],
)
def test_what_cannot_be_done_is_said(arguments, words, tiny_clip, run, frame_map, capsys):
    assert main([word.format(run=run, map=frame_map, clip=tiny_clip) for word in arguments]) == 2
    assert words in capsys.readouterr().err

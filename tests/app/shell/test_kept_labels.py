"""Propagating leaves labels alone that are there, and the timeline shows which frames are what."""

from __future__ import annotations

import shutil

import numpy as np
from PySide6.QtWidgets import QMessageBox

from degense.engine.annotation.annotations import Record
from degense.engine.annotation.edits import Proposal
from degense.widgets.theme import label_colour
from tests.app import installed as on
from tests.app.features.annotate.test_annotate import drag, press
from tests.app.shell.test_nothing_lost import click


def test_labels_that_are_there_are_kept_and_the_timeline_tells_them_apart(qtbot, window, tiny_clip, tmp_path, idle, screenshot):
    """A clip of which two frames came with labels; one is painted, all is propagated, accepted, and propagated again."""
    clip = shutil.copytree(tiny_clip, tmp_path / "clip")
    for path in sorted((clip / "labels").glob("*.png"))[2:]:
        path.unlink()
    on.documents(window).open_path(clip)
    idle()
    window.registry.run("annotate.mode")
    idle()
    state, track = on.annotations(window), on.time(window).timeline.track
    assert track._labelled == {"labels of the clip": {0, 1}}
    came = state.labels(1)
    window.session.go_to(4)
    idle()
    drag(qtbot, window, (20, 20), (50, 20))
    press(qtbot, window, "annotate.propagate")
    click(qtbot, window.findChild(QMessageBox, "labelled frames"), "Keep them")
    idle()
    assert state.work.waiting() == [2, 3, 5, 6, 7, 8, 9]
    sure = state.work.record(7).proposal
    for frame, confidence in ((2, 0.9), (3, 0.9), (5, 0.9), (6, 0.9), (7, 0.5), (8, 0.6), (9, 0.9)):
        state.work.records[frame] = Record(proposal=Proposal(sure.packed, sure.shape, confidence))
    for frame in (2, 3):
        window.session.go_to(frame)
        press(qtbot, window, "annotate.accept")
    marks = {"labels of the clip": {0, 1}, "painted": {4}, "accepted": {2, 3}, "proposed": {5, 6, 9}, "doubtful": {7, 8}}
    assert track._labelled == marks
    image = track.grab().toImage()
    for kind, frames in marks.items():
        for frame in frames:
            assert image.pixelColor(round(track._x(frame)), track.height() - 5) == label_colour(kind, track.palette()), (kind, frame)
    screenshot(window, "timeline-kinds")
    accepted = state.labels(2)
    window.session.go_to(4)
    press(qtbot, window, "annotate.propagate")
    click(qtbot, window.findChild(QMessageBox, "labelled frames"), "Keep them")
    idle()
    press(qtbot, window, "annotate.accept-all")
    assert np.array_equal(state.labels(1), came)
    assert np.array_equal(state.labels(2), accepted)

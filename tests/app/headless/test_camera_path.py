"""Paths through kept cameras: smooth, through every stop, and safe to read from files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from degense.app.features.cameras.state import CameraBook, CameraPath, Stop, load_path, save_path
from degense.app.session.cursor import Playback
from degense.app.session.undo import UndoStack
from degense.engine.camera import Camera
from degense.engine.errors import DegenseError, RunError
from degense.widgets.splats.camera_moves import dolly, orbit


@pytest.fixture
def stops() -> tuple[Stop, ...]:
    camera, pivot = Camera(96, 80, 90.0, 92.0, 47.0, 41.0), np.array([1.0, 2.0, 50.0])
    turned = orbit(camera, pivot, 0.6, -0.2)
    near = replace(dolly(turned, pivot, 0.5), fx=180.0, fy=184.0)
    return Stop("a", camera, 0.0, 2.0), Stop("b", turned, 9.0, 1.0), Stop("c", near, 4.0)


def test_a_path_runs_through_its_stops_and_stays_rigid(stops):
    path = CameraPath(stops)
    assert path.seconds == 3.0
    for seconds, stop in zip((0.0, 2.0, 3.0), stops, strict=True):
        camera, frame = path.at(seconds)
        np.testing.assert_allclose(camera.viewmat, stop.camera.viewmat, atol=1e-9)
        assert (camera.fx, camera.cx, frame) == pytest.approx((stop.camera.fx, stop.camera.cx, stop.frame))
    for seconds in np.linspace(-1, 4, 41):
        camera, frame = path.at(seconds)
        turn = camera.viewmat[:3, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        assert 0 <= frame <= 9
        assert 90 <= camera.fx <= 180 + 1e-9
    with pytest.raises(DegenseError, match="two cameras"):
        CameraPath(stops[:1])


def test_a_path_has_no_kinks(stops):
    """Speed of the eye and of the turn change little from one twentieth of a frame to the next, at the stops too."""
    path, step = CameraPath(stops), 0.002
    eyes, axes = [], []
    for seconds in np.arange(0, path.seconds, step):
        viewmat = path.at(seconds)[0].viewmat
        eyes.append(-viewmat[:3, :3].T @ viewmat[:3, 3])
        axes.append(viewmat[2, :3])
    for values in (np.array(eyes), np.array(axes)):
        speed = np.diff(values, axis=0) / step
        assert np.abs(np.diff(speed, axis=0)).max() < 0.05 * np.abs(speed).max()


def test_stops_are_edited_and_undone(stops):
    undo = UndoStack()
    book = CameraBook(undo)
    for stop in stops:
        book.add(stop.camera, stop.frame)
    assert [stop.name for stop in book.stops] == ["Camera 1", "Camera 2", "Camera 3"]
    assert book.move(0, 1) == 1
    book.change(1, name="start", seconds=5.0)
    book.remove(0)
    assert [stop.name for stop in book.stops] == ["start", "Camera 3"]
    assert book.add(stops[0].camera, 1.0, after=0) == 1
    assert [stop.name for stop in book.stops] == ["start", "Camera 1", "Camera 3"]
    for wrong in ({"name": " "}, {"seconds": 0.0}, {"seconds": float("nan")}):
        with pytest.raises(ValueError, match="duration"):
            book.change(0, **wrong)
    while undo.undo_name:
        undo.undo()
    assert book.stops == ()


def test_a_path_is_read_as_it_was_written(stops, tmp_path):
    file = tmp_path / "path.json"
    save_path(file, stops)
    again = load_path(file)
    assert [(stop.name, stop.frame, stop.seconds) for stop in again] == [(stop.name, stop.frame, stop.seconds) for stop in stops]
    for ours, theirs in zip(stops, again, strict=True):
        np.testing.assert_array_equal(ours.camera.viewmat, theirs.camera.viewmat)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda stop: stop["camera"].update(fx=-1.0),
        lambda stop: stop["camera"].update(fx=float("nan")),
        lambda stop: stop["camera"].update(width=10**9),
        lambda stop: stop["camera"].update(viewmat=[[0.0] * 4] * 4),
        lambda stop: stop["camera"].update(viewmat=[[1, 2], [3]]),
        lambda stop: stop.update(seconds=-1),
        lambda stop: stop.update(frame=float("inf")),
        lambda stop: stop.pop("camera"),
    ],
)
def test_what_is_no_path_is_refused(stops, tmp_path, spoil):
    file = tmp_path / "path.json"
    save_path(file, stops)
    data = json.loads(file.read_text())
    spoil(data["cameras"][1])
    file.write_text(json.dumps(data))
    with pytest.raises(DegenseError, match="does not hold a camera path"):
        load_path(file)
    with pytest.raises(RunError, match="here"):
        CameraBook(UndoStack()).from_json(data["cameras"], "here")


def test_the_played_part():
    playback = Playback()
    playback.start_at(4)
    playback.end_at(8)
    assert (playback.first, playback.last) == (4, 8)
    playback.start_at(9)
    assert (playback.first, playback.last) == (9, None)
    again = Playback()
    again.from_json(json.loads(json.dumps(playback.to_json())), "here")
    assert (again.first, again.last, again.mode) == (9, None, "loop")
    for wrong in ({}, None, {"first": 5, "last": 5, "mode": "loop"}, {"first": None, "last": None, "mode": "sideways"}):
        with pytest.raises(RunError, match="here"):
            again.from_json(wrong, "here")

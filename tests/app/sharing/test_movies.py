"""Movies: layers side by side, their size and rate, time along a path; from the command line and from the window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from PySide6.QtCore import Qt

from degense.app.cli.main import main
from degense.app.features.cameras.state import Stop, save_path
from degense.app.features.movies.dialog import FLIGHT_WHOLE, MovieDialog
from degense.app.features.movies.movie import MovieOptions, make_movie
from degense.app.features.viewer.layer_images import with_colour_bar
from degense.app.session.sample import demo_run
from degense.app.session.view_state import ViewState
from degense.engine.layers import LAYERS, LayerRequest, layer_range
from degense.engine.layers.layer import colourise
from degense.engine.progress import finish
from degense.engine.scene import Scene
from degense.widgets import forms
from degense.widgets.splats.camera_moves import orbit
from tests.app import installed as on

PLAIN = ViewState()


@pytest.fixture(scope="module")
def sample() -> Scene:
    return Scene.open(demo_run(), device="cpu")


def pictures(path: Path) -> tuple[list[np.ndarray], float]:
    """The frames of a movie, uint8 RGB, and its rate."""
    movie, frames = cv2.VideoCapture(str(path)), []
    while (read := movie.read())[0]:
        frames.append(read[1][..., ::-1])
    rate = movie.get(cv2.CAP_PROP_FPS)
    movie.release()
    return frames, rate


def near(picture: np.ndarray, wanted: np.ndarray) -> bool:
    """Whether a picture is one that the codec made of another."""
    return bool(10 * np.log10(255**2 / np.square(picture.astype(float) - wanted).mean()) > 27)


def test_the_colour_bar_says_where_values_lie_beyond_it(sample, tmp_path):
    """Most of the demo's displacement fits the bar, which leaves out a few: the frames that have these say so."""
    out = tmp_path / "a.mp4"
    assert main(["movie", str(demo_run()), "--out", str(out), "--layers", "displacement,rgb", "--titled"]) == 0
    frames, _ = pictures(out)
    layer, said = LAYERS["displacement"], []
    span = layer_range(sample, layer, LayerRequest(0), "sequence")
    for number in (0, sample.frames - 1):
        image = layer.image(sample, LayerRequest(number))
        picture = colourise(image, *span, layer.cmap)
        bars = [
            with_colour_bar(picture, layer.title, image.unit, *span, layer.cmap, hatched=True, outside=(False, above))
            for above in (False, True)
        ]
        shown = frames[number][:, : bars[0].shape[1]]
        apart = [np.abs(bar.astype(float) - shown)[:, picture.shape[1] :].mean() for bar in bars]
        said.append(bool(apart[1] < apart[0]))
        assert said[-1] == bool(np.nanmax(image.values) > span[1])
    assert said == [False, True]


def test_recording_and_layers_side_by_side_at_a_size_and_rate(sample, tmp_path):
    out = tmp_path / "a.mp4"
    chosen = ["--layers", "recording,rgb,displacement", "--size", "216x168", "--fps", "12"]
    assert main(["movie", str(demo_run()), "--out", str(out), *chosen]) == 0
    frames, rate = pictures(out)
    assert (len(frames), rate, frames[0].shape) == (12, 12, (168, 3 * 216, 3))  # 24 frames at 25 a second
    frame = round(6 * 25 / 12)
    observed = cv2.resize(sample.observed(frame), (216, 168), interpolation=cv2.INTER_AREA)
    assert near(frames[6][:, :216], observed)
    small = sample.camera(frame).letterboxed(216, 168)
    assert near(frames[6][:, 216:432], sample.render_rgb(6 * 25 / 12, small))
    yellow = (frames[-1][..., 0] > 180) & (frames[-1][..., 1] > 180) & (frames[-1][..., 2] < 110)
    assert yellow[:, 432:].any()  # the grasper has pulled


def test_time_runs_along_the_flight(sample, tmp_path):
    camera = sample.camera(0)
    pivot = np.median(sample.splats(0).means.numpy(), 0)
    stops = (Stop("a", camera, 5.0, 0.2), Stop("b", orbit(camera, pivot, 0.2, 0.0), 5.0))
    save_path(tmp_path / "path.json", stops)
    shown = {}
    for time in ("kept", "whole"):
        out = tmp_path / f"{time}.mp4"
        assert main(["movie", str(demo_run()), "--out", str(out), "--cameras", str(tmp_path / "path.json"), "--time", time]) == 0
        frames, rate = pictures(out)
        assert (len(frames), rate) == (6, 25)
        shown[time] = frames
    assert near(shown["kept"][0], sample.render_rgb(5, camera))
    assert near(shown["kept"][-1], sample.render_rgb(5, stops[1].camera))
    assert near(shown["whole"][0], sample.render_rgb(0, camera))
    assert near(shown["whole"][-1], sample.render_rgb(23, stops[1].camera))
    assert not near(shown["whole"][-1], shown["kept"][-1])


def test_names_and_colour_bars_make_room(sample, tmp_path):
    options = MovieOptions(PLAIN, ("rgb", "displacement"), frames=(0, 2))
    finish(make_movie(sample, tmp_path / "a.mp4", options))
    finish(make_movie(sample, tmp_path / "b.mp4", replace(options, titled=True)))
    (plain, _), (titled, _) = pictures(tmp_path / "a.mp4"), pictures(tmp_path / "b.mp4")
    assert len(plain) == len(titled) == 3
    assert titled[0].shape[1] > plain[0].shape[1] == 576


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--layers", "rgb,colour"], "There is no layer 'colour'"),
        (["--layers", "rgb,rgb,rgb,rgb,rgb"], "1 to 4 layers"),
        (["--size", "9000x10"], "16 to 4096 pixels"),
        (["--fps", "0"], "up to 240 frames a second"),
        (["--layers", "recording", "--cameras", "{path}"], "cannot be seen from another camera"),
        (["--time", "never"], "kept or whole"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(sample, tmp_path, capsys, arguments, sentence):
    save_path(tmp_path / "path.json", (Stop("a", sample.camera(0), 0.0), Stop("b", sample.camera(0), 1.0)))
    arguments = [word.format(path=tmp_path / "path.json") for word in arguments]
    assert main(["movie", str(demo_run()), "--out", str(tmp_path / "a.mp4"), *arguments]) == 2
    assert sentence in capsys.readouterr().err
    assert not (tmp_path / "a.mp4").exists()


def test_the_dialog_writes_what_it_says(qtbot, opened, idle, tmp_path, monkeypatch, screenshot):
    session, out = opened.session, tmp_path / "a.mp4"
    for frame in (0, 4):
        session.go_to(frame)
        opened.registry.run("cameras.add")
    on.cameras(opened).book.change(0, seconds=0.2)
    monkeypatch.setattr(opened, "ask_save", lambda *words: out)
    dialog = on.movies(opened).ask()
    dialog.layers["recording"].setChecked(True)
    forms.enter(dialog.camera, FLIGHT_WHOLE)
    assert "another camera" in dialog.complaint.text()
    assert not dialog.start.isEnabled()
    dialog.layers["recording"].setChecked(False)
    dialog.layers["depth"].setChecked(True)
    dialog.picture_width.setValue(64)
    dialog.picture_height.setValue(48)
    assert dialog.sentence.text() == "0.24 seconds, 6 frames, 2 pictures side by side."
    screenshot(dialog, "movie")
    qtbot.mouseClick(dialog.start, Qt.MouseButton.LeftButton)
    idle()
    frames, _ = pictures(out)
    assert len(frames) == 6
    assert frames[0].shape[0] == 48
    assert opened.statusBar().currentMessage().startswith(str(out))


def test_layers_over_each_other(sample, tmp_path, capsys):
    """The one beside the other, and both in one picture, of which the upper takes half."""
    out = tmp_path / "a.mp4"
    assert main(["movie", str(demo_run()), "--out", str(out), "--layers", "rgb,displacement,rgb+displacement:0.5"]) == 0
    frames, _ = pictures(out)
    below, above, both = np.split(frames[20], 3, axis=1)
    assert near(both, (below.astype(float) + above) / 2)
    assert not near(both, below)
    finish(make_movie(sample, tmp_path / "titled.mp4", MovieOptions(PLAIN, ("rgb+displacement:0.5",), frames=(19, 20), titled=True)))
    titled = pictures(tmp_path / "titled.mp4")[0][1]
    assert titled.shape[1] > both.shape[1]  # by the colour bar of the displacement
    for layers, sentence in (
        ("rgb+rgb", "names rgb twice"),
        ("rgb:0.5+depth", "leave out its opacity"),
        ("rgb+depth:2", "'2' is no opacity"),
        ("rgb+recording", "recording"),
        ("rgb+similarity", "Similarity cannot be shown"),
    ):
        assert main(["movie", str(demo_run()), "--out", str(tmp_path / "b.mp4"), "--layers", layers]) == 2
        assert sentence in capsys.readouterr().err
    assert not (tmp_path / "b.mp4").exists()


def test_the_dialog_takes_what_the_view_blends(qtbot, opened, idle, tmp_path, monkeypatch, screenshot):
    session, out, said = opened.session, tmp_path / "a.mp4", []
    session.view.set_layer_visible("displacement", True)
    session.view.set_layer_opacity("displacement", 0.5)
    idle()
    monkeypatch.setattr(opened, "ask_save", lambda *words: said.append(words) or out)
    qtbot.keyClick(opened, Qt.Key.Key_M, Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier)
    dialog = opened.findChild(MovieDialog)
    dialog.titled.setChecked(False)
    [shown] = [box for box in dialog.layers.values() if box.isChecked()]
    assert shown.text() == "As shown: Colour + Displacement"
    screenshot(dialog, "movie-as-shown")
    qtbot.mouseClick(dialog.start, Qt.MouseButton.LeftButton)
    idle()
    assert said[0][1] == "copy-rgb+displacement.mp4"
    frames, _ = pictures(out)
    last = len(frames) - 1
    session.go_to(last)
    idle()
    assert near(frames[last], on.viewer(opened).view.rgb)
    assert not near(frames[last], opened.session.scene.render_rgb(last))

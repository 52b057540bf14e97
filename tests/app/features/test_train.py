"""Task: start a training from the window, watch it, cancel it; let one finish and look at it."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import fields, replace

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog, QMessageBox, QTabWidget

from degense.app.application import FEATURES
from degense.app.features.train import controller
from degense.app.features.train.job import TrainingJob
from degense.app.shell.settings import SettingsFile
from degense.app.shell.shell import Shell
from degense.engine.events import Event, TrainingProgress, read_progress
from degense.engine.training import TrainConfig
from tests.app import installed as on


@pytest.fixture(autouse=True)
def one_at_a_time(monkeypatch):
    """As on a machine with few cores, however many this one has."""
    monkeypatch.setattr(controller, "fitting", lambda: 1)


@pytest.fixture
def with_clip(window, tiny_clip, idle):
    on.documents(window).open_path(tiny_clip)
    idle()
    return window


def ask(window) -> QDialog:
    window.registry.run("train.start")
    return next(dialog for dialog in window.findChildren(QDialog, "train") if dialog.isVisible())


def waiting(monitor) -> list[str]:
    """The names in the queue."""
    return [monitor.queue.list.item(row).text() for row in range(monitor.queue.list.count())]


def test_the_dialog_knows_what_it_costs_and_what_cannot_be(with_clip, tiny_clip, trained, screenshot):
    dialog = ask(with_clip)
    assert dialog.teacher.currentData() == "labels"
    balanced = dialog.cost.text()
    assert "min" in balanced
    dialog.preset.setCurrentIndex(2)
    assert dialog.cost.text() != balanced
    screenshot(with_clip, "train-dialog")
    dialog.out.setText(str(trained))
    assert not dialog.start.isEnabled()
    assert "not empty" in dialog.complaint.text()
    dialog.out.setText(str(tiny_clip.parent / "fresh"))
    assert dialog.start.isEnabled()
    job = dialog.job()
    assert (job.preset, job.clip, job.out, job.iterations) == ("best", tiny_clip, tiny_clip.parent / "fresh", None)
    dialog.reject()


def test_a_teacher_that_the_clip_has_nothing_for_says_what_it_needs(qtbot, with_clip, screenshot):
    dialog = ask(with_clip)
    assert not dialog.folder.isEnabled()
    dialog.teacher.setCurrentIndex(dialog.teacher.findData("strokes"))
    assert not dialog.start.isEnabled()
    assert "No strokes: draw some" in dialog.complaint.text()
    dialog.teacher.setCurrentIndex(dialog.teacher.findData("vlm"))
    assert "A model must be named" in dialog.complaint.text()
    screenshot(with_clip, "train-dialog-teacher")
    qtbot.keyClicks(dialog.folder.line, "models/clip")
    assert dialog.start.isEnabled()
    assert dialog.job().teacher == "vlm:models/clip"
    dialog.fill({"teacher": "precomputed:features?level=1"})
    assert dialog.job().teacher == "precomputed:features?level=1"
    dialog.fill({"teacher": "strokes"})  # which this clip lacks
    assert dialog.job().teacher == "labels"
    dialog.reject()


def test_every_setting_is_explained_and_can_be_changed(qtbot, with_clip, tmp_path, monkeypatch, screenshot):
    dialog = ask(with_clip)
    table = dialog.table.table
    rows = {table.item(row, 0).text(): row for row in range(table.rowCount())}
    assert set(rows) == {item.name for item in fields(TrainConfig)} - {"preset", "given"}
    assert all(len(table.item(row, 2).text()) > 15 for row in rows.values())
    assert not table.item(rows["iterations"], 1).flags() & Qt.ItemFlag.ItemIsEditable  # on the first page
    dialog.findChild(QTabWidget).setCurrentIndex(1)
    qtbot.keyClicks(dialog.table.search, "and the optical flow, in")
    assert [name for name, row in rows.items() if not table.isRowHidden(row)] == ["flow"]
    dialog.table.search.clear()
    table.item(rows["flow"], 1).setText("many")
    assert not dialog.start.isEnabled()
    assert "flow cannot be 'many'" in dialog.complaint.text()
    table.item(rows["flow"], 1).setText("7.5")
    assert dialog.start.isEnabled()
    assert table.item(rows["flow"], 0).font().bold()
    screenshot(with_clip, "train-settings")
    dialog.poses.setCurrentIndex(dialog.poses.findData("still"))
    dialog.seed.setValue(7)
    dialog.out.setText(str(tmp_path / "run"))
    jobs: list[TrainingJob] = []
    monkeypatch.setattr(on.training(with_clip), "start", jobs.append)
    dialog.accept()
    assert (jobs[0].poses, jobs[0].seed, jobs[0].settings) == ("still", 7, (("flow", "7.5"),))
    assert jobs[0].config().flow == 7.5
    again = ask(with_clip)  # the answers are reused, those about the clip are not
    assert (again.seed.value(), again.table.typed, again.poses.currentData()) == (7, {"flow": "7.5"}, "auto")
    qtbot.mouseClick(again.reset, Qt.MouseButton.LeftButton)
    assert (again.seed.value(), again.table.typed) == (0, {})
    again.reject()


def test_pause_go_on_queue_and_cancel(qtbot, with_clip, tmp_path, screenshot, monkeypatch):
    dialog = ask(with_clip)
    dialog.preset.setCurrentIndex(0)
    dialog.iterations.setValue(100_000)
    dialog.out.setText(str(tmp_path / "run"))
    dialog.accept()
    training, monitor = on.training(with_clip), on.training(with_clip).monitor
    assert monitor.state == "running"
    second = ask(with_clip)
    assert second.start.text() == "Add to queue"
    second.out.setText(str(tmp_path / "second"))
    second.accept()
    assert [job.out.name for job in training.queue.waiting] == ["second"]
    assert waiting(monitor) == ["second (quick)"]
    training.start(second.job())
    box = with_clip.findChild(QMessageBox, "error")
    assert "in the queue already" in box.text()
    box.close()
    qtbot.waitUntil(lambda: monitor._preview._frame is not None and monitor._preview.comparison.observed is not None)
    assert len(monitor._plot.series) == len(monitor._scores.series) == 1
    with_clip.session.go_to(5)  # the window goes on working
    screenshot(with_clip, "train")
    with_clip.menus.actions["train.pause"].trigger()
    qtbot.waitUntil(lambda: training.queue.paused is not None)
    assert with_clip.menus.actions["train.resume-paused"].isEnabled()
    earlier = monitor._plot.points("loss")
    seconds = max(report.seconds for report in read_progress(tmp_path / "run" / "metrics.jsonl"))
    assert (monitor.state, training.running) == ("paused", False)
    assert [job.out.name for job in training.queue.waiting] == ["second"]  # nobody takes the machine meanwhile
    stopped_at = json.loads((tmp_path / "run" / "run.json").read_text())["iteration"]
    qtbot.mouseClick(monitor._pause, Qt.MouseButton.LeftButton)
    assert training.process.job.resume
    seen: list[int] = []
    training.process.told.connect(lambda event: seen.append(event.iteration) if isinstance(event, TrainingProgress) else None)
    qtbot.waitUntil(lambda: bool(seen))
    assert seen[0] > stopped_at
    for before, now in zip(earlier, monitor._plot.points("loss"), strict=True):  # the curve goes on, and so does the clock
        np.testing.assert_array_equal(now[: len(before)], before)
        assert len(now) > len(before)
    assert read_progress(tmp_path / "run" / "metrics.jsonl")[-1].seconds > seconds
    screenshot(with_clip, "train-resumed")
    with_clip.registry.run("train.cancel")
    qtbot.waitUntil(lambda: bool(training.queue.running) and training.queue.running[0].out.name == "second")
    with_clip.registry.run("train.cancel")
    qtbot.waitUntil(lambda: not training.running)
    assert monitor.state == "cancelled"
    assert json.loads((tmp_path / "run" / "run.json").read_text())["state"] == "stopped"
    jobs: list[TrainingJob] = []
    monkeypatch.setattr(training, "start", jobs.append)
    training.resume(tmp_path / "run")
    assert (jobs[0].resume, jobs[0].clip, jobs[0].out) == (True, with_clip.session.clip.path, tmp_path / "run")


def test_a_killed_training_is_said_and_goes_on(qtbot, with_clip, tmp_path):
    """kill -9 of the training process: the window lives, and the run goes on from its checkpoint."""
    settings = (("checkpoint_seconds", "0.2"),)
    job = TrainingJob(with_clip.session.clip.path, tmp_path / "run", "quick", iterations=100_000, device="cpu", settings=settings)
    training = on.training(with_clip)
    training.start(job)
    qtbot.waitUntil(lambda: (tmp_path / "run" / "checkpoints" / "last.json").is_file())
    os.kill(training.process._process.processId(), signal.SIGKILL)
    qtbot.waitUntil(lambda: on.training(with_clip).monitor.state == "failed")
    box = with_clip.findChild(QMessageBox, "error")
    assert "ended by the system" in box.text()
    box.close()
    training.resume(tmp_path / "run")
    seen: list[Event] = []
    training.process.told.connect(seen.append)
    qtbot.waitUntil(lambda: any(isinstance(event, TrainingProgress) for event in seen))
    training.cancel()
    qtbot.waitUntil(lambda: not training.running)
    assert next(event.iteration for event in seen if isinstance(event, TrainingProgress)) > 25  # not from the start


def test_a_finished_training_is_opened(qtbot, with_clip, tmp_path, idle):
    dialog = ask(with_clip)
    job = replace(dialog.job(), preset="quick", iterations=5, max_gaussians=300, device="cpu", out=tmp_path / "run")
    dialog.reject()
    on.training(with_clip).start(job)
    qtbot.waitUntil(lambda: with_clip.session.scene is not None)
    idle()
    assert with_clip.session.scene.run.path == tmp_path / "run"
    assert on.training(with_clip).monitor.state == "finished"


def test_a_failure_is_one_sentence(qtbot, with_clip, tmp_path, idle):
    dialog = ask(with_clip)
    job = replace(dialog.job(), teacher="precomputed", out=tmp_path / "run")
    dialog.reject()
    on.training(with_clip).start(job)
    qtbot.waitUntil(lambda: not on.training(with_clip).running)
    assert on.training(with_clip).monitor.state == "failed"
    box = with_clip.findChild(QMessageBox, "error")
    assert box.text()
    assert "Traceback" not in box.text()
    box.close()


def test_closing_while_training_asks_and_saves(qtbot, with_clip, tmp_path):
    dialog = ask(with_clip)
    job = replace(dialog.job(), preset="quick", iterations=100_000, out=tmp_path / "run")
    dialog.reject()
    training = on.training(with_clip)
    training.start(job)
    qtbot.waitUntil(lambda: (tmp_path / "run" / "metrics.jsonl").is_file())
    with_clip.close()
    assert with_clip.isVisible()
    box = with_clip.findChild(QMessageBox, "training runs")
    next(button for button in box.buttons() if "Keep" in button.text()).click()
    assert training.running
    with_clip.close()
    box = next(box for box in with_clip.findChildren(QMessageBox, "training runs") if box.isVisible())
    next(button for button in box.buttons() if "Stop" in button.text()).click()
    qtbot.waitUntil(lambda: not with_clip.isVisible())
    assert json.loads((tmp_path / "run" / "run.json").read_text())["state"] == "stopped"


def test_the_queue_outlives_the_program(qtbot, with_clip, tmp_path, screenshot):
    """What ran and what waited is there at the next start, paused; it goes on from its checkpoint when it is told to."""
    training, clip = on.training(with_clip), with_clip.session.clip.path
    for name in ("first", "second"):
        training.start(TrainingJob(clip, tmp_path / name, "quick", iterations=100_000, device="cpu"))
    qtbot.waitUntil(lambda: (tmp_path / "first" / "metrics.jsonl").is_file())
    kept = json.loads((tmp_path / "settings.json").read_text())["trainings"]  # what a kill leaves
    assert [entry["out"] for entry in kept] == [str(tmp_path / name) for name in ("first", "second")]
    with_clip.close()
    box = with_clip.findChild(QMessageBox, "training runs")
    assert "the queue of 1" in box.text()
    next(button for button in box.buttons() if "Stop" in button.text()).click()
    qtbot.waitUntil(lambda: not with_clip.isVisible())
    stopped_at = json.loads((tmp_path / "first" / "run.json").read_text())["iteration"]

    again = Shell(SettingsFile(tmp_path / "settings.json"), FEATURES)
    qtbot.addWidget(again)
    with qtbot.waitSignal(on.viewer(again).splats_added):
        again.show()
    monitor = on.training(again).monitor
    assert monitor.isVisible()
    assert (monitor.state, waiting(monitor), on.training(again).running) == ("paused", ["second (quick)"], False)
    assert monitor._plot.points("loss")[0][-1] <= stopped_at  # what was trained before is shown
    screenshot(again, "train-kept")
    qtbot.mouseClick(monitor._pause, Qt.MouseButton.LeftButton)
    seen: list[int] = []
    on.training(again).process.told.connect(lambda event: seen.append(event.iteration) if isinstance(event, TrainingProgress) else None)
    qtbot.waitUntil(lambda: bool(seen))
    assert seen[0] > stopped_at
    again.registry.run("train.pause")
    qtbot.waitUntil(lambda: monitor.state == "paused")
    for name in ("second", None):
        qtbot.mouseClick(monitor._cancel, Qt.MouseButton.LeftButton)
        paused = on.training(again).queue.paused
        assert (paused and paused.out.name) == name
        assert not on.training(again).running
    assert SettingsFile(tmp_path / "settings.json").value.trainings == ()
    again.close()


def test_two_trainings_beside_each_other(qtbot, with_clip, tmp_path):
    """The settings say two: both run, either can be watched, and they are paused together and kept."""
    on.preferences(with_clip).change("Trainings at once", trainings_at_once=2.0)
    training, monitor, clip = on.training(with_clip), on.training(with_clip).monitor, with_clip.session.clip.path
    for name in ("first", "second", "third"):
        training.start(TrainingJob(clip, tmp_path / name, "quick", iterations=100_000, device="cpu"))
    assert [job.out.name for job in training.queue.running] == ["first", "second"]
    assert waiting(monitor) == ["third (quick)"]
    assert [monitor.running.itemText(row) for row in range(monitor.running.count())] == ["first", "second"]
    assert monitor.running.currentText() == "second"
    qtbot.waitUntil(lambda: all((tmp_path / name / "metrics.jsonl").is_file() for name in ("first", "second")))
    monitor.running.setCurrentIndex(0)
    monitor.running.activated.emit(0)
    assert training.process.job.out.name == "first"
    assert monitor._heading.text() == "clip → first"
    qtbot.waitUntil(lambda: monitor._facts["Loss"].text() != "–")
    with_clip.registry.run("train.pause")
    qtbot.waitUntil(lambda: not training.running)
    assert monitor.state == "paused"
    assert sorted(job.out.name for job in training.queue.jobs) == ["first", "second", "third"]
    with_clip.close()
    qtbot.waitUntil(lambda: not with_clip.isVisible())
    assert len(json.loads((tmp_path / "settings.json").read_text())["trainings"]) == 3

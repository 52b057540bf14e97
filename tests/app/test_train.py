"""Task: start a training from the window, watch it, cancel it; let one finish and look at it."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from PySide6.QtWidgets import QDialog, QMessageBox

from app.training_process import TrainingJob


@pytest.fixture
def with_clip(window, tiny_clip, idle):
    window.opening.open_path(tiny_clip)
    idle()
    return window


def ask(window) -> QDialog:
    window.registry.run("train.start")
    return window.findChild(QDialog, "train")


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


def test_train_and_cancel(qtbot, with_clip, tmp_path, screenshot, monkeypatch):
    dialog = ask(with_clip)
    dialog.preset.setCurrentIndex(0)
    dialog.iterations.setValue(100_000)
    dialog.out.setText(str(tmp_path / "run"))
    dialog.accept()
    training, monitor = with_clip.training, with_clip.parts.monitor
    progress: list[dict] = []
    training.process.told.connect(lambda event: progress.append(event) if event["event"] in ("progress", "preview") else None)
    assert monitor.state() == "running"
    assert not with_clip.menus.actions["train.start"].isEnabled()
    qtbot.waitUntil(lambda: sum(event["event"] == "progress" for event in progress) >= 2, timeout=90_000)
    with_clip.session.go_to(5)  # the window goes on working
    screenshot(with_clip, "train")
    with_clip.registry.run("train.cancel")
    qtbot.waitUntil(lambda: not training.running, timeout=20_000)
    assert monitor.state() == "cancelled"
    assert json.loads((tmp_path / "run" / "run.json").read_text())["state"] == "stopped"
    assert with_clip.menus.actions["train.start"].isEnabled()
    jobs: list[TrainingJob] = []
    monkeypatch.setattr(training, "start", jobs.append)
    training.resume(tmp_path / "run")
    assert (jobs[0].resume, jobs[0].clip, jobs[0].out) == (True, with_clip.session.clip.path, tmp_path / "run")


def test_a_finished_training_is_opened(qtbot, with_clip, tmp_path, idle):
    dialog = ask(with_clip)
    job = replace(dialog.job(), preset="quick", iterations=5, max_gaussians=300, device="cpu", out=tmp_path / "run")
    dialog.reject()
    with_clip.training.start(job)
    qtbot.waitUntil(lambda: with_clip.session.scene is not None, timeout=90_000)
    idle()
    assert with_clip.session.scene.run.path == tmp_path / "run"
    assert with_clip.parts.monitor.state() == "finished"


def test_a_failure_is_one_sentence(qtbot, with_clip, tmp_path, idle):
    dialog = ask(with_clip)
    job = replace(dialog.job(), teacher="precomputed", out=tmp_path / "run")
    dialog.reject()
    with qtbot.waitSignal(with_clip.training.changed):
        with_clip.training.start(job)
    qtbot.waitUntil(lambda: not with_clip.training.running, timeout=60_000)
    assert with_clip.parts.monitor.state() == "failed"
    box = with_clip.findChild(QMessageBox, "error")
    assert box.text()
    assert "Traceback" not in box.text()
    box.close()


def test_closing_while_training_asks_and_saves(qtbot, with_clip, tmp_path):
    dialog = ask(with_clip)
    job = replace(dialog.job(), preset="quick", iterations=100_000, out=tmp_path / "run")
    dialog.reject()
    training = with_clip.training
    training.start(job)
    qtbot.waitUntil(lambda: (tmp_path / "run" / "metrics.jsonl").is_file(), timeout=90_000)
    with_clip.close()
    assert with_clip.isVisible()
    box = with_clip.findChild(QMessageBox, "training runs")
    next(button for button in box.buttons() if "Keep" in button.text()).click()
    assert training.running
    with_clip.close()
    box = next(box for box in with_clip.findChildren(QMessageBox, "training runs") if box.isVisible())
    next(button for button in box.buttons() if "Stop" in button.text()).click()
    qtbot.waitUntil(lambda: not with_clip.isVisible(), timeout=20_000)
    assert json.loads((tmp_path / "run" / "run.json").read_text())["state"] == "stopped"

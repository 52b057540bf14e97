"""The states of training and what each shows."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QComboBox, QLabel, QProgressBar

from degense.app.features.train.monitor import TrainingMonitor, duration
from degense.engine.events import TrainingProgress
from degense.engine.training import TrainConfig, train
from degense.widgets.curve_plot import CurvePlot
from tests.fakes import MemoryClip


@pytest.fixture
def monitor(show):
    return show(TrainingMonitor(), 560, 420)


def fact(monitor, name):
    return next(label.text() for label in monitor.findChildren(QLabel) if label.accessibleName() == name)


def cancel(monitor):
    return monitor._cancel


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (61, "1 min 01 s"), (3599, "59 min 59 s"), (7260, "2 h 01 min"), (-3, "0 s")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_a_run_from_start_to_end(monitor):
    assert monitor.state == "idle"
    assert not cancel(monitor).isEnabled()
    monitor.start("Training pulling")
    bar = monitor.findChild(QProgressBar)
    assert (monitor.state, bar.minimum(), bar.maximum()) == ("running", 0, 0)  # busy: nobody knows yet how long
    monitor.set_stage("Coarse")
    assert fact(monitor, "State") == "Coarse"
    monitor.set_progress(TrainingProgress(500, 2000, 0.125, 31.456, 30123, 65, 195, {"l1": 0.1, "ssim": 0.025}))
    facts = [fact(monitor, name) for name in ("Iteration", "Loss", "PSNR", "Gaussians", "Elapsed", "Time left")]
    assert facts == ["500 / 2,000", "0.125", "31.46 dB", "30,123", "1 min 05 s", "3 min 15 s"]
    assert bar.value() / bar.maximum() == pytest.approx(0.25)
    monitor.set_progress(TrainingProgress(510, 2000))
    assert fact(monitor, "Loss") == "0.125"
    assert sorted(next(iter(plot.series)) for plot in monitor.findChildren(CurvePlot)) == ["PSNR", "loss"]
    monitor.note("Rolled back")
    monitor.set_preview(np.zeros((8, 8, 3), np.uint8))
    monitor.finish("Done in 4 minutes: 34.2 dB")
    assert monitor.state == "finished"
    assert fact(monitor, "State") == "Done in 4 minutes: 34.2 dB"
    assert bar.value() == bar.maximum()
    monitor.start()
    assert fact(monitor, "Loss") == "–"
    assert list(monitor.findChild(CurvePlot).series) == []


def test_steps_made_again_replace_the_earlier_ones(monitor):
    """A resumed training goes on from its checkpoint, one that was rolled back too."""
    monitor.start()
    past = [TrainingProgress(step, 100, 1 / step, 20 + step / 10, seconds=step) for step in (25, 50, 75)]
    monitor.set_progress(*past)
    assert fact(monitor, "Elapsed") == "1 min 15 s"
    monitor.set_progress(TrainingProgress(60, 100, 0.5, 30.0, seconds=80))
    plots = {plot.accessibleName(): plot for plot in monitor.findChildren(CurvePlot)}
    assert [list(numbers) for numbers in plots["Loss"].points("loss")] == [[25, 50, 60], [1 / 25, 1 / 50, 0.5]]
    assert list(plots["PSNR"].points("PSNR")[1]) == [22.5, 25.0, 30.0]


def test_any_term_of_the_loss_can_be_plotted(monitor):
    monitor.start()
    menu = next(box for box in monitor.findChildren(QComboBox) if "loss" in box.accessibleName())
    plot = next(plot for plot in monitor.findChildren(CurvePlot) if plot.accessibleName() == "Loss")
    assert [menu.itemText(i) for i in range(menu.count())] == ["loss"]
    monitor.set_progress(TrainingProgress(25, 100, 0.5, 20.0))  # of a version without terms
    monitor.set_progress(TrainingProgress(50, 100, 0.25, 21.0, losses={"l1": 0.2, "ssim": 0.05}))
    monitor.set_progress(TrainingProgress(75, 100, 0.125, 22.0, losses={"l1": 0.1, "ssim": 0.02, "flow": 0.005}))
    assert [menu.itemText(i) for i in range(menu.count())] == ["loss", "l1", "ssim", "flow"]
    assert (list(plot.series), list(plot.points("loss")[1])) == (["loss"], [0.5, 0.25, 0.125])
    menu.setCurrentText("ssim")
    assert [list(numbers) for numbers in plot.points("ssim")] == [[50, 75], [0.05, 0.02]]
    monitor.set_progress(TrainingProgress(100, 100, 0.1, losses={"ssim": 0.01}))
    assert list(plot.points("ssim")[1]) == [0.05, 0.02, 0.01]
    menu.setCurrentText("loss")
    assert list(plot.points("loss")[1]) == [0.5, 0.25, 0.125, 0.1]


def test_the_terms_of_a_semantic_distillation_can_be_plotted(monitor, tmp_path):
    config = TrainConfig.preset_of("quick", iterations=30, max_gaussians=400, resolution=8, channels=8, device="cpu")
    told = []
    train(MemoryClip(), tmp_path / "run", config, events=told.append, stop=lambda: False)
    monitor.start()
    for event in told:
        if isinstance(event, TrainingProgress):
            monitor.set_progress(event)
    menu = next(box for box in monitor.findChildren(QComboBox) if "loss" in box.accessibleName())
    plot = next(plot for plot in monitor.findChildren(CurvePlot) if plot.accessibleName() == "Loss")
    for term in ("align", "region", "delta_semantics"):
        menu.setCurrentText(term)
        assert list(plot.series) == [term]
        assert min(plot.points(term)[0]) > 30  # after the steps of the trainer
    assert fact(monitor, "PSNR").endswith("dB")


def test_cancel_asks_nothing_and_says_that_it_stops(monitor):
    heard: list = []
    monitor.cancel_requested.connect(lambda: heard.append(1))
    monitor.start()
    QTest.mouseClick(cancel(monitor), Qt.MouseButton.LeftButton)
    QTest.mouseClick(cancel(monitor), Qt.MouseButton.LeftButton)
    assert heard == [1]
    assert cancel(monitor).text() == "Stopping…"
    assert monitor.state == "running"
    monitor.cancelled()
    assert monitor.state == "cancelled"
    assert cancel(monitor).text() == "Cancel"
    monitor.start()
    assert cancel(monitor).isEnabled()


def test_failure_is_said_in_words(monitor):
    monitor.start()
    monitor.fail("The disk is full.")
    assert monitor.state == "failed"
    assert "The disk is full." in fact(monitor, "State")
    assert not cancel(monitor).isEnabled()
    assert monitor.findChild(QProgressBar).maximum() > 0
    monitor.reset()
    assert monitor.state == "idle"


def test_the_queue_asks_and_shows(qtbot, monitor):
    queue, asked = monitor.queue, []
    assert not queue.isVisibleTo(monitor)
    queue.set_runs(["one", "two"])
    queue.removed.connect(lambda row: asked.append(("remove", row)))
    queue.raised.connect(lambda row: asked.append(("raise", row)))
    assert not queue.earlier.isEnabled()
    queue.list.setCurrentRow(1)
    queue.earlier.click()
    queue.remove.click()
    assert asked == [("raise", 1), ("remove", 1)]

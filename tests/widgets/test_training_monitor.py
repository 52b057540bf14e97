"""The states of training and what each shows."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QLabel, QProgressBar, QPushButton

from degense.app.features.train.monitor import STATES, TrainingMonitor, duration
from degense.widgets.curve_plot import CurvePlot


@pytest.fixture
def monitor(show):
    return show(TrainingMonitor(), 560, 420)


def fact(monitor, name):
    return next(label.text() for label in monitor.findChildren(QLabel) if label.accessibleName() == name)


def cancel(monitor):
    return monitor.findChild(QPushButton)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (61, "1 min 01 s"), (3599, "59 min 59 s"), (7260, "2 h 01 min"), (-3, "0 s")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_a_run_from_start_to_end(monitor):
    assert monitor.state() == "idle"
    assert not cancel(monitor).isEnabled()
    monitor.start("Training pulling")
    bar = monitor.findChild(QProgressBar)
    assert (monitor.state(), bar.minimum(), bar.maximum()) == ("running", 0, 0)  # busy: nobody knows yet how long
    monitor.set_stage("Coarse")
    assert fact(monitor, "State") == "Coarse"
    monitor.set_progress(500, 2000, loss=0.125, psnr=31.456, gaussians=30123, seconds=65, eta=195)
    facts = [fact(monitor, name) for name in ("Iteration", "Loss", "PSNR", "Gaussians", "Elapsed", "Time left")]
    assert facts == ["500 / 2,000", "0.125", "31.46 dB", "30,123", "1 min 05 s", "3 min 15 s"]
    assert bar.value() / bar.maximum() == pytest.approx(0.25)
    monitor.set_progress(510, 2000)
    assert fact(monitor, "Loss") == "0.125"
    assert sorted(plot.series_names()[0] for plot in monitor.findChildren(CurvePlot)) == ["PSNR", "loss"]
    monitor.note("Rolled back")
    monitor.set_preview(np.zeros((8, 8, 3), np.uint8))
    monitor.finish("Done in 4 minutes: 34.2 dB")
    assert monitor.state() == "finished"
    assert fact(monitor, "State") == "Done in 4 minutes: 34.2 dB"
    assert bar.value() == bar.maximum()
    monitor.start()
    assert fact(monitor, "Loss") == "–"
    assert monitor.findChild(CurvePlot).series_names() == []


def test_cancel_asks_nothing_and_says_that_it_stops(monitor):
    heard: list = []
    monitor.cancel_requested.connect(lambda: heard.append(1))
    monitor.start()
    QTest.mouseClick(cancel(monitor), Qt.MouseButton.LeftButton)
    QTest.mouseClick(cancel(monitor), Qt.MouseButton.LeftButton)
    assert heard == [1]
    assert cancel(monitor).text() == "Stopping…"
    assert monitor.state() == "running"
    monitor.cancelled()
    assert monitor.state() == "cancelled"
    assert cancel(monitor).text() == "Cancel"
    monitor.start()
    assert cancel(monitor).isEnabled()


def test_failure_is_said_in_words(monitor):
    monitor.start()
    monitor.fail("The disk is full.")
    assert monitor.state() == "failed"
    assert "The disk is full." in fact(monitor, "State")
    assert not cancel(monitor).isEnabled()
    assert monitor.findChild(QProgressBar).maximum() > 0
    monitor.reset()
    assert monitor.state() == "idle"
    assert {"idle", "running", "paused", "finished", "failed", "cancelled"} == set(STATES)


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

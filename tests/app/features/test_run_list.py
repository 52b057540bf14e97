"""Task: compare the runs of a clip, score one, and train again like it."""

from __future__ import annotations

import json
import shutil

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QDialog

from degense.app.features.runs.runs_dialog import COLUMNS, RunsDialog
from tests.app import installed as on


def column(dialog: RunsDialog, title: str) -> dict[str, str]:
    """What a column says, by run."""
    index = [about.title for about in COLUMNS].index(title)
    return {dialog.table.item(row, 0).text(): dialog.table.item(row, index).text() for row in range(dialog.table.rowCount())}


def choose(dialog: RunsDialog, name: str) -> None:
    dialog.table.selectRow(list(column(dialog, "Run")).index(name))


def test_runs_are_compared_scored_and_reused(qtbot, opened, run, trained, idle, screenshot):
    damaged, stopped = run.with_name("damaged"), run.with_name("stopped")
    damaged.mkdir()
    (damaged / "run.json").write_text("{half")
    shutil.copytree(run, stopped)
    info = json.loads((stopped / "run.json").read_text())
    (stopped / "run.json").write_text(json.dumps(info | {"state": "stopped"}))
    try:
        opened.registry.run("train.runs")
        dialog = opened.findChild(RunsDialog)
        assert column(dialog, "State") == {"run": "finished", "copy": "finished", "damaged": "damaged", "stopped": "stopped"}
        assert column(dialog, "PSNR")["copy"] == "–"
        choose(dialog, "damaged")
        assert not any(
            button.isEnabled() for button in (dialog.open_button, dialog.score_button, dialog.resume_button, dialog.reuse_button)
        )
        choose(dialog, "stopped")
        assert (dialog.resume_button.isEnabled(), dialog.open_button.isEnabled()) == (True, False)
        choose(dialog, "copy")
        qtbot.mouseClick(dialog.score_button, Qt.MouseButton.LeftButton)
        assert not dialog.score_button.isEnabled()
        qtbot.waitUntil(lambda: not on.runs(opened).scoring)
        scores = json.loads((run / "scores.json").read_text())
        assert column(dialog, "PSNR")["copy"] == f"{scores['psnr_mask']:.2f} dB"
        assert column(dialog, "mIoU")["copy"] == f"{scores['miou']['rnse']:.1%}"
        screenshot(opened, "runs")
        qtbot.mouseClick(dialog.reuse_button, Qt.MouseButton.LeftButton)
        train = opened.findChild(QDialog, "train")
        assert (train.preset.currentData(), train.iterations.value(), train.max_gaussians.value()) == ("quick", 60, 1500)
        train.reject()
    finally:
        shutil.rmtree(damaged)
        shutil.rmtree(stopped)

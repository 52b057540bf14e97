"""Reports say what the scores say, and take no orders from the names in a clip."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.research.report import MethodScores, ReportPicture, write_report
from degense.engine.research.report.charts import Line, chart
from degense.engine.research.report.method_scores import Figure
from degense.engine.research.report.tables import tables_of
from degense.engine.semantics.prompts import DECODERS

HOSTILE = "<script>alert(1)</script>|"


def scores(miou: float, best: str = "rnse", name: str = "liver", seconds: float = 5.0) -> dict:
    """Two frames; the second lacks the second class, which a third of the picture is taken for."""
    false = {name: {"frames": 0, "absent": 0, "share": None}, "hook": {"frames": 1, "absent": 1, "share": 1 / 3}}
    masks = {
        d: {
            "miou": miou if d == best else miou - 0.1,
            "miou_pairs": miou,
            "miou_present": miou,
            "boundary_f": 0.5,
            "floor_answer": {"class": name, "miou": 0.35, "miou_pairs": 0.4},
            "iou": {name: miou, "hook": None},
            "iou_frames": {name: [miou, 0.25], "hook": [None, 0.0]},
            "floor": {name: 0.7, "hook": 0.1},
            "false_positives": false,
        }
        for d in DECODERS
    }
    calibration = {"default": 0.5, "best": 0.4, "miou_default": 0.6, "miou_best": 0.62, "error": 0.03, "curve": [[0.0, 0.1], [0.5, 0.6]]}
    calibration["reliability"] = [{"similarity": 0.1, "share": 0.0, "pairs": 10}]
    return {
        "miou": {d: m["miou"] for d, m in masks.items()},
        "masks": masks,
        "calibration": {"threshold": calibration, "rnse": calibration},
        "flicker": dict.fromkeys(DECODERS, 0.02),
        "mask_frames": [1, 9],
        "mask_frames_trained": [],
        "psnr_mask": 30.0,
        "train_seconds": seconds,
        "gaussians": 1000,
    }


@pytest.fixture
def entries():
    ours = MethodScores("ours", "Ours.", [scores(0.8), scores(0.9)])
    return [MethodScores("theirs", "Theirs.", [scores(0.6, "argmax"), scores(0.7, "argmax")]), ours]


def test_a_figure_over_seeds():
    assert Figure.of([0.8, 0.9]).text(1, 100) == "85.0 ± 63.5"  # 12.706 · 0.0707 / √2
    assert Figure.of([0.8, None]).text(1, 100) == "80.0"
    assert Figure.of([None]).text(1) == "–"


def test_tables_by_hand(entries):
    classes, overall, decoders, thresholds, false, *frames = tables_of(entries)
    rows = [[cell.text for cell in row] for row in classes.rows]
    assert classes.columns == ["method", "decoder", "liver", "hook", "mean"]
    assert rows[0] == ["theirs", "argmax", "65.0 ± 63.5", "–", "65.0 ± 63.5"]
    assert rows[1] == ["ours", "rnse", "85.0 ± 63.5", "–", "85.0 ± 63.5"]
    assert rows[2] == ["floor: all is liver", "", "70.0", "0", "35.0"]
    assert [[cell.best for cell in row] for row in classes.rows] == [[False] * 5, [False, False, True, False, True], [False] * 5]
    assert "motion: correlation" not in overall.columns, "a clip without truth has no such column"
    assert [cell.text for cell in overall.rows[0]][overall.columns.index("flicker, %")] == "2.00 ± 0.00"
    assert [[cell.best for cell in row[1:]] for row in decoders.rows] == [
        [d == "argmax" for d in DECODERS],
        [d == "rnse" for d in DECODERS],
    ]
    assert [cell.text for cell in thresholds.rows[0]] == ["theirs", "pixelwise", "0.50", "60.0", "0.40", "62.0", "0.030"]
    assert [cell.text for cell in false.rows[0]] == ["theirs", "never absent", "2 of 2 (33.33 %)"]
    assert [[cell.text for cell in row] for row in frames[1].rows] == [["1", "80", "–"], ["9", "25", "0"]]
    assert "**85.0 ± 63.5**" in classes.markdown()
    assert classes.words.startswith("Held-out frames")
    entries[0].runs[0]["mask_frames_trained"] = [9]
    assert "trained on" in tables_of(entries)[0].words


def test_names_from_a_clip_are_words_only(tmp_path):
    entry = MethodScores("run", HOSTILE, [scores(0.5, name=HOSTILE)])
    pictures = [ReportPicture(1, HOSTILE + '" onload="x', np.zeros((4, 6, 3), np.uint8))]
    _, markdown, page = write_report(tmp_path, HOSTILE, {HOSTILE: HOSTILE}, [entry], [HOSTILE, "hook"], pictures)
    text = page.read_text(encoding="utf-8")
    assert "<script" not in text
    assert '" onload="' not in text
    assert "<script" not in markdown.read_text(encoding="utf-8")
    table = [line for line in markdown.read_text(encoding="utf-8").splitlines() if line.startswith("| run | rnse")]
    assert len(table[0].replace("\\|", "").split("|")) == 2 + 5


def test_a_chart_puts_points_where_they_belong():
    svg = chart("a < b", "x", "y", [Line("one", [(0, 0), (1, 1), (2, -1)])])
    points = [tuple(map(float, p.split(","))) for p in svg.split('points="')[1].split('"')[0].split()]
    (x0, y0), (x1, y1), (x2, y2) = points
    assert x0 < x1 == x2, "what lies beyond the square is drawn on its edge"
    assert y0 == y2 > y1
    assert "a &lt; b" in svg


def test_methods_below_a_baseline_are_marked(entries):
    """Theirs reach 0.65 and lie below a vote of 0.7; ours 0.85. Both pictures beat the copied frame, and nothing is said of motion."""
    vote = scores(0.7)["masks"]["rnse"]
    baselines = {"majority vote": {"miou": {"labels": 0.7}, "boundary_f": 0.4, "masks": {"labels": vote}}, "copied": {"psnr_mask": 29.0}}
    classes, overall, against, *_ = tables_of(entries, baselines)
    assert [row[0].text for row in classes.rows] == ["theirs †", "ours", "floor: all is liver", "baseline: majority vote"]
    assert [cell.text for cell in classes.rows[3]] == ["baseline: majority vote", "labels", "70.0", "–", "70.0"]
    assert classes.words.endswith("† mean IoU below majority vote (theirs).")
    marked = {column for column, cell in zip(overall.columns, overall.rows[0], strict=True) if cell.text.endswith("†")}
    assert marked == {"mIoU, %"}
    assert not any("†" in cell.text for cell in overall.rows[1])
    assert [[cell.text for cell in row] for row in against.rows] == [
        ["majority vote", "70.0", "40.0", "–", "–", "–", "–"],
        ["copied", "–", "–", "29.00", "–", "–", "–"],
    ]
    assert "†" not in tables_of(entries)[0].markdown()

"""`degense compare` from end to end on a tiny phantom: trained, scored, stopped, taken up again, reported."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

import degense.engine.research.comparison
from degense.app.cli.main import main
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.store.files import read_json

SMALL = ["--preset", "quick", "--iterations", "15", "--max-gaussians", "300", "--device", "cpu"]


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare") / "clip"
    make_phantom(folder, PhantomOptions(frames=9, width=64, height=48, seed=4))
    return folder


@pytest.fixture(scope="module")
def compared(clip):
    out = clip.parent / "out"
    assert main(["compare", str(clip), "--out", str(out), "--methods", "surgtpgs,degense", "--seeds", "2", *SMALL]) == 0
    return out


def test_it_prints_the_papers_table(clip, compared, capsys):
    """Once more: nothing is trained, the same table is printed."""
    before = {path: path.stat().st_mtime_ns for path in (compared / "scores").iterdir()}
    assert main(["compare", str(clip), "--out", str(compared), "--methods", "surgtpgs,degense", "--seeds", "2", *SMALL]) == 0
    assert {path: path.stat().st_mtime_ns for path in (compared / "scores").iterdir()} == before
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in capsys.readouterr().out.splitlines() if "|" in line]
    classes = json.loads((clip / "classes.json").read_text())["classes"]
    assert head == ["method", "decoder", *[c for c in classes if c != "background"], "mean"]
    assert [row[0].removesuffix(" †") for row in rows][:2] == ["surgtpgs", "degense"]
    assert rows[2][0].startswith("floor: all is ")
    reached = {row[0]: float(row[-1]) for row in rows if row[0].startswith("baseline: ")}
    assert reached["baseline: teacher"] == pytest.approx(
        100 * read_json(compared / "baselines.json")["teacher"]["miou"]["labels"], abs=0.051
    )
    for row, method in zip(rows, ("surgtpgs", "degense"), strict=False):
        assert row[0].endswith("†") == (float(row[-1].strip("*").split(" ± ")[0]) < max(reached.values()))
        seeds = [read_json(compared / "scores" / f"{method}-{seed}.json")["miou"][row[1]] for seed in (0, 1)]
        mean, half = map(float, row[-1].strip("*").split(" ± "))
        assert mean == pytest.approx(100 * np.mean(seeds), abs=0.051)
        assert half == pytest.approx(100 * 12.706 * abs(seeds[0] - seeds[1]) / 2, abs=0.051)


def test_the_runs_are_what_they_are_called(compared):
    configs = {name: read_json(compared / "runs" / name / "run.json")["config"] for name in ("surgtpgs-1", "degense-1")}
    assert (configs["surgtpgs-1"]["routing"], configs["surgtpgs-1"]["flow"], configs["surgtpgs-1"]["angular"]) == ("coupled", 0, False)
    assert (configs["degense-1"]["routing"], configs["degense-1"]["seed"]) == ("isolated", 1)
    assert configs["surgtpgs-1"]["iterations"] == configs["degense-1"]["iterations"] == 15


class Page(HTMLParser):
    """What an HTML page holds: its tags, what they link to, and whether they are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag not in ("meta", "img", "br", "path", "text", "polyline"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in ("path", "text", "polyline"):
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.words += data


def test_the_page_stands_alone_and_shows_pictures(clip, compared):
    text = (compared / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert not [tag for tag, _ in page.found if tag in ("script", "link", "iframe")]
    links = [value for _, attrs in page.found for name, value in attrs.items() if name in ("src", "href")]
    assert links
    assert all(link.startswith("data:image/jpeg;base64,") for link in links)
    assert not re.search(r"https?://|url\(", text)
    captions = [attrs["alt"] for tag, attrs in page.found if tag == "img"]
    assert captions == [f"{who}, frame 1" for who in ("recorded", "truth", "surgtpgs", "degense")]
    shown = cv2.imdecode(np.frombuffer(base64.b64decode(links[0].partition(",")[2]), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    recorded = cv2.imread(str(clip / "images" / "000001.png"))[..., ::-1]
    assert np.abs(shown.astype(int) - recorded).mean() < 12
    report = read_json(compared / "report.json")
    assert set(report["methods"]) == {"surgtpgs", "degense"}
    assert len(report["methods"]["degense"]["runs"]) == 2
    markdown = (compared / "report.md").read_text(encoding="utf-8")
    for title in ("IoU of each class, %", "All scores", "Calibration of the threshold", "False positives on classes that a frame lacks"):
        assert title in page.words
        assert f"## {title}" in markdown


def test_a_stopped_comparison_goes_on_where_it_was(clip, tmp_path, monkeypatch, capsys):
    """Ctrl-C in the middle of the first training; the second start resumes it instead of beginning anew."""
    started, real = [], degense.engine.research.comparison.train

    def train(*args, resume, events, stop, **options):
        started.append(resume)
        stages = []

        def watch(event):
            stages.append(getattr(event, "stage", None))
            events(event)

        return real(*args, resume=resume, events=watch, stop=lambda: not resume and "semantics" in stages, **options)

    monkeypatch.setattr(degense.engine.research.comparison, "train", train)
    command = ["compare", str(clip), "--out", str(tmp_path / "out"), "--methods", "degense", *SMALL]
    assert main(command) == 130
    assert "goes on from there" in capsys.readouterr().err
    assert read_json(tmp_path / "out" / "runs" / "degense-0" / "run.json")["state"] == "stopped"
    assert not (tmp_path / "out" / "report.html").exists()
    assert main(command) == 0
    assert started == [False, True]
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{clip}", "--out", "{new}", "--methods", "degense,nerf"], "no system 'nerf'"),
        (["{clip}", "--out", "{new}", "--methods", ","], "--methods names none"),
        (["{clip}", "--out", "{clip}"], "holds no comparison"),
        (["{clip}", "--out", "{out}", *SMALL, "--iterations", "16"], "iterations 15 instead of 16"),
        (["{clip}", "--out", "{out}", *SMALL, "--teacher", "degraded"], "the teacher labels"),
        (["{clip}", "--out", "{new}", "--teacher", "none"], "need a teacher"),
    ],
)
def test_errors_are_one_sentence(arguments, words, clip, compared, tmp_path, capsys):
    filled = [text.format(clip=clip, out=compared, new=tmp_path / "new") for text in arguments]
    assert main(["compare", *filled]) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert words in line
    assert not (tmp_path / "new").exists()


def test_damaged_scores_are_named(clip, compared, capsys):
    path = compared / "scores" / "degense-0.json"
    kept = path.read_text()
    path.write_text('{"miou": 3}')
    assert main(["compare", str(clip), "--out", str(compared), "--methods", "degense", *SMALL]) == 2
    assert "degense-0.json does not hold scores; delete it" in capsys.readouterr().err
    path.write_text(kept)


def test_eval_reports_a_single_run(clip, compared, tmp_path, capsys):
    run = compared / "runs" / "degense-0"
    assert main(["eval", str(run), "--report", str(tmp_path / "report")]) == 0
    assert str(tmp_path / "report" / "report.html") in capsys.readouterr().out
    report, scores = (read_json(path) for path in (tmp_path / "report" / "report.json", compared / "scores" / "degense-0.json"))
    assert report["methods"]["degense-0"]["runs"][0]["miou"] == scores["miou"]
    Page((tmp_path / "report" / "report.html").read_text(encoding="utf-8"))

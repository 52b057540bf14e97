"""`degense bench`, from the command line to the page."""

from __future__ import annotations

import json

import pytest

from degense.app.cli.main import main
from degense.engine.research.bench.run import BENCHES


@pytest.fixture
def tiny(monkeypatch):
    monkeypatch.setitem(BENCHES, "tiny", ("tests.research.bench.tiny", "how little it takes"))


def test_without_a_name_it_lists_them(capsys):
    assert main(["bench"]) == 0
    said = capsys.readouterr().out
    assert all(name in said and text in said for name, (_, text) in BENCHES.items())
    assert "degense bench all" in said


def test_from_measuring_to_the_page(tiny, tmp_path, capsys):
    folder, page = tmp_path / "figures", tmp_path / "page.md"
    assert main(["bench", "tiny", "--device", "cpu", "--quick", "--repeats", "2", "--out", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "| slow | 10.00 (9.00–12.00) | 0.000 |" in said
    assert "2 repeats, 1 seeds." in said
    assert said.count("`degense bench tiny --device cpu --seeds 1 --repeats 2 --quick`; ") == 2
    names = ["tiny-first-by-name-cpu.json", "tiny-second-by-name-cpu.json", "tiny-second-by-name-cpu.png"]
    assert sorted(path.name for path in folder.iterdir()) == names
    kept = json.loads((folder / names[1]).read_text(encoding="utf-8"))
    assert kept["rows"][0]["time"] == [9.0, 10.0, 12.0]
    assert (kept["bench"], kept["device"], kept["number"]) == ("tiny", "cpu", 0)

    assert main(["bench", "report", str(folder), "--out", str(page)]) == 0
    assert "2 tables" in capsys.readouterr().out
    text = page.read_text(encoding="utf-8")
    assert text.index("Table 0") < text.index("Table 1")
    assert "](figures/tiny-second-by-name-cpu.png)" in text
    assert str(tmp_path) not in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["smell"], "no benchmark 'smell'"),
        (["raster", "smell"], "no benchmark 'smell'"),
        (["tiny", "--device", "abacus"], "abacus"),
        (["tiny", "--clip", "{out}/nowhere"], "nowhere"),
        (["tiny", "--out", "{file}"], "is a file"),
        (["report"], "report FOLDER --out FILE"),
        (["report", "{out}"], "report FOLDER --out FILE"),
        (["report", "{out}", "--out", "{out}/page.md"], "0 tables"),
    ],
)
def test_errors_are_one_line_and_status_2(arguments, words, tiny, tmp_path, capsys):
    folder, file = tmp_path / "out", tmp_path / "file"
    folder.mkdir()
    file.touch()
    assert main(["bench", *(text.format(out=folder, file=file) for text in arguments)]) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("degense: ")
    assert words in line
    assert not list(folder.iterdir())

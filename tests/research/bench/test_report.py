"""The page that is made of tables on disk."""

from __future__ import annotations

import json

import pytest

from degense.engine.errors import DegenseError
from degense.engine.research.bench.report import MOST_BYTES, read_table, save_table, write_report
from degense.engine.research.bench.table import Column, Table


def table(name: str, bench: str, device: str = "cpu", number: int = 0, **changes) -> Table:
    rows = [{"what": "a", "time": 1.0, "error": 2.0}, {"what": "b", "time": 2.0, "error": 1.0}]
    columns = [Column("what", "what"), Column("time", "ms"), Column("error", "error")]
    told = {"bench": bench, "device": device, "number": number, "command": f"degense bench {bench}", "hardware": "here", "date": "today"}
    return Table(**({"name": name, "title": f"Title of {name}", "protocol": "Once.", "columns": columns, "rows": rows} | told | changes))


def test_sections_in_order_with_everything_that_belongs_to_a_table(tmp_path):
    folder = tmp_path / "docs" / "figures"
    save_table(table("a-stress", "stress"), folder)
    save_table(table("z-raster", "raster", number=0, pareto=("time", "error"), notes="What it says."), folder)
    save_table(table("b-raster", "raster", number=1), folder)
    save_table(table("a-raster", "raster", device="cuda"), folder)
    save_table(table("own", "elsewhere"), folder)
    assert write_report(folder, tmp_path / "docs" / "page.md") == 5
    page = (tmp_path / "docs" / "page.md").read_text(encoding="utf-8")
    headings = [line for line in page.splitlines() if line.startswith("#")]
    assert headings == [
        "# Benchmarks",
        "## Raster",
        "### Raster on the CPU",
        "### Raster on the GPU",
        "## Stress",
        "### Stress on the CPU",
        "## Elsewhere",
        "### Elsewhere on the CPU",
    ]
    assert page.index("Title of z-raster") < page.index("Title of b-raster") < page.index("Title of a-raster")
    assert "![Title of z-raster: run time against error](figures/z-raster-cpu.png)" in page
    assert page.count("![") == 1
    assert (folder / "z-raster-cpu.png").is_file()
    assert "What it says." in page
    assert "`degense bench raster`; here; today" in page
    assert "| a | 1.00 | 2.00 |" in page


def test_words_from_a_file_stay_words(tmp_path):
    made = table("x", "raster", title="# Big <script> [here](http://x)", notes="one\n\n# two", command="rm `x`")
    save_table(made, tmp_path / "in")
    write_report(tmp_path / "in", tmp_path / "page.md")
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "<script" not in page
    assert "](http" not in page
    assert [line for line in page.splitlines() if line.startswith("# ")] == ["# Benchmarks"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"{", "it is not JSON"),
        (b"\xff\xfe\x00", "it is not JSON"),
        (b"[" * 100_000, "cannot be read as"),
        (b'{"a": NaN}', "NaN is not a number"),
        (b"{}", "does not hold a benchmark's table"),
        (b" " * (MOST_BYTES + 1), "more than a benchmark writes"),
    ],
)
def test_files_that_are_no_tables_are_named_in_a_sentence(content, words, tmp_path):
    path = tmp_path / "strange.json"
    path.write_bytes(content)
    with pytest.raises(DegenseError, match=r"strange\.json") as caught:
        write_report(tmp_path, tmp_path / "page.md")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "page.md").exists()


def test_nothing_to_report(tmp_path):
    with pytest.raises(DegenseError, match="0 tables"):
        write_report(tmp_path, tmp_path / "page.md")
    with pytest.raises(DegenseError, match="not a folder"):
        write_report(tmp_path / "nowhere", tmp_path / "page.md")


def test_a_saved_table_is_read_back(tmp_path):
    made = table("x", "raster", rows=[{"what": "a", "time": float("inf"), "error": [1.0, 2.0]}])
    [path] = save_table(made, tmp_path)
    assert json.loads(path.read_text(encoding="utf-8"))["rows"][0]["time"] == "inf"
    assert read_table(path).rows == [{"what": "a", "time": "inf", "error": [1.0, 2.0]}]

"""What every file of unknown origin goes through: regular files of bounded size, JSON of finite numbers and bounded depth."""

from __future__ import annotations

import os
import resource

import pytest

from degense.engine import untrusted
from degense.engine.data.files.numbered import read_json, regular_file
from degense.engine.errors import LONGEST, ClipError, DegenseError
from degense.engine.untrusted import DEEPEST, check_regular, check_yaml, parse_json, read_bytes


@pytest.mark.parametrize(
    "text",
    [
        "NaN",
        "[-Infinity]",
        '{"a": 1e999}',
        str(2**63 + 1),
        "-" + "9" * 5000,
        "[" * (DEEPEST + 2) + "]" * (DEEPEST + 2),
        '{"a":' * 900 + "1" + "}" * 900,
        "[" * 200_000,
        b"\xff",
        "",
    ],
)
def test_json_that_no_program_of_ours_writes_is_refused(text):
    with pytest.raises(ValueError, match=r"."):
        parse_json(text)


def test_json_of_ours_is_read():
    assert parse_json('{"a": [1e308, -9223372036854775808, [true, null, "é"]]}') == {"a": [1e308, -(2**63), [True, None, "é"]]}
    assert parse_json("[" * DEEPEST + "]" * DEEPEST)
    assert parse_json(str(2**127), 1 << 128) == 2**127


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero", tmp_path):
        with pytest.raises(ValueError, match="not a regular file"):
            check_regular(tmp_path / path, 100)
    with pytest.raises(ClipError, match="not a regular file"):
        read_json(tmp_path / "pipe")


def test_no_more_memory_is_taken_than_the_file_has(tmp_path):
    """A bound far above the memory that there is."""
    (tmp_path / "a").write_bytes(b"[1]")
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (1 << 40, before[1]))
    try:
        assert read_bytes(tmp_path / "a", 1 << 42) == b"[1]"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)
    with pytest.raises(ValueError, match="larger than 2 bytes"):
        untrusted.read_json(tmp_path / "a", 2)


@pytest.mark.parametrize("name", ["a\0b.png", "a" * 300 + ".png"])
def test_impossible_names_are_refused_in_a_sentence(tmp_path, name):
    with pytest.raises(ClipError, match="no name of a file"):
        regular_file(tmp_path / name, tmp_path)


def test_errors_are_one_line_of_bounded_length():
    text = str(DegenseError("a\nb\r\n\x1b[31m\ud800 " + "x" * 10**6))
    assert len(text) == LONGEST
    assert text.isprintable()
    text.encode()
    assert str(DegenseError("A plain sentence, 5 × 3; é.")) == "A plain sentence, 5 × 3; é."
    said = str(DegenseError(f"{'9' * 1000} is no name of a file; the file that names it is damaged."))
    assert len(said) == LONGEST
    assert said.startswith("999")
    assert said.endswith(" is no name of a file; the file that names it is damaged."), "what to do stands at the end"


@pytest.mark.parametrize("text", ["[" * 50_000, '{"a":' * 50_000, "- " * 50_000, "a: [" * 100], ids=["lists", "maps", "dashes", "both"])
def test_yaml_is_refused_whose_nesting_would_end_the_program(text):
    """libyaml's loader ends the process on such a text; only its events are read."""
    with pytest.raises(ValueError, match=r"nested|no valid"):
        check_yaml(text)


def test_plain_yaml_passes():
    check_yaml("names:\n  0: fat\n  1: [a, {b: c}]\n")

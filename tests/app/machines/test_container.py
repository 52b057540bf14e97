"""The file for containers fits the project: what it copies, installs and starts is there. No engine builds it here."""

from __future__ import annotations

import re
import subprocess

import pytest

from tests.house.source import ROOT

KNOWN = {"ARG", "FROM", "COPY", "RUN", "ENV", "USER", "VOLUME", "WORKDIR", "ENTRYPOINT", "CMD"}


@pytest.fixture(scope="module")
def instructions() -> list[tuple[str, str]]:
    """Each instruction with what follows it, its lines joined."""
    lines = (ROOT / "Containerfile").read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.startswith("#")).replace("\\\n", " ")
    return [(line.split(maxsplit=1)[0], line.split(maxsplit=1)[1]) for line in text.splitlines() if line.strip()]


def of(instructions: list[tuple[str, str]], name: str) -> list[str]:
    return [said for found, said in instructions if found == name]


def test_every_instruction_is_one_and_stands_where_it_may(instructions):
    names = [name for name, _ in instructions]
    assert {*names} <= KNOWN
    assert next(name for name in names if name != "ARG") == "FROM"
    assert names.index("USER") > max(index for index, name in enumerate(names) if name == "RUN")  # no root when it works
    assert of(instructions, "USER") == ["worker"]


def test_what_it_copies_and_installs_is_there(instructions):
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    assert {".git", ".venv"} <= {*ignored}
    for source in (said.split()[0] for said in of(instructions, "COPY")):
        assert (ROOT / source).exists()
        assert source.split("/")[0] not in ignored
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    runs = " ".join(of(instructions, "RUN"))
    [extras] = re.findall(r'"/opt/degense\[([\w,]+)\]"', runs)
    assert all(re.search(rf"^{extra} = \[", project, re.MULTILINE) for extra in extras.split(","))
    assert "constraints.txt" in runs
    assert (ROOT / "constraints.txt").is_file()
    assert "system-packages headless" in runs
    assert "chown worker /var/cache/degense" in runs
    assert re.findall(r"chmod (\w+) /var/cache/degense", runs) == ["700"]  # kernels are code: nobody else may put some there
    assert of(instructions, "ENTRYPOINT") == ['["degense"]']
    assert re.search(r"^degense = ", project, re.MULTILINE)


def test_its_commands_are_commands_of_a_shell(instructions):
    for said in of(instructions, "RUN"):
        assert subprocess.run(["sh", "-n", "-c", said], capture_output=True).returncode == 0, said
    index = "${TORCH_INDEX:+--extra-index-url $TORCH_INDEX}"
    for given, expected in (("", ""), ("https://a/b", "--extra-index-url https://a/b\n")):
        told = subprocess.run(["sh", "-c", f"[ -z '{given}' ] || echo {index}"], env={"TORCH_INDEX": given}, capture_output=True, text=True)
        assert told.stdout == expected


def test_the_documents_say_how_and_what_of_it_was_not_tried():
    text = (ROOT / "docs" / "batch.md").read_text(encoding="utf-8")
    assert "Containerfile" in text
    assert "Not tried: the base that the file names" in text

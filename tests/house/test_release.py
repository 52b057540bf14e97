"""What goes with a release: how to cite it, what changed, and the version that all name."""

from __future__ import annotations

import hashlib
import re
import subprocess
import sys
from pathlib import PurePosixPath

import yaml

from degense.engine.store.run import FORMAT
from tests.house.source import ROOT

#: Of the Citation File Format 1.2.0: what must be there, and what may be beside it.
REQUIRED = {"cff-version", "message", "title", "authors"}
ALLOWED = REQUIRED | {"abstract", "commit", "contact", "date-released", "doi", "identifiers", "keywords", "license", "license-url"}
ALLOWED |= {"preferred-citation", "references", "repository", "repository-artifact", "repository-code", "type", "url", "version"}
PERSON = {"family-names", "given-names", "name-particle", "name-suffix", "affiliation", "email", "orcid", "alias", "website"}
ENTITY = {"name", "email", "orcid", "alias", "website", "address", "city", "country"}


def version() -> str:
    [found] = re.findall(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    return found


def test_the_citation_is_valid():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert REQUIRED <= {*cited} <= ALLOWED
    assert cited["cff-version"] == "1.2.0"
    assert cited["type"] in ("software", "dataset")
    assert cited["license"] == "Apache-2.0"
    assert cited["version"] == version()
    for authors in (cited["authors"], *(reference["authors"] for reference in cited["references"])):
        assert authors
        assert all({*author} <= PERSON or ("name" in author and {*author} <= ENTITY) for author in authors)
    assert all({"type", "title", "authors"} <= {*reference} for reference in cited["references"])
    assert all(isinstance(word, str) for word in cited["keywords"])


def test_the_changelog_names_the_version_and_the_format_of_runs():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    [first, *_] = re.findall(r"^## (.+)$", text, re.MULTILINE)
    assert version() in first
    assert f"Format of runs: {FORMAT}." in text
    assert {"Added", "Changed", "Fixed"} <= {*re.findall(r"^### (\w+)$", text, re.MULTILINE)}


def test_the_page_on_machines_was_made_for_the_pins_of_today():
    """`scripts/resolve-platforms` ends with what its tables were made for: run it again, and take over all that it prints."""
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    needed = project[project.index("\nrequires-python") + 1 : project.index("[project.scripts]")]
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    state = hashlib.sha256((pins + needed).encode()).hexdigest()[:16]
    assert f"State of the pins: {state}." in (ROOT / "docs" / "machines.md").read_text(encoding="utf-8")


def test_known_faults_are_asked_for_strictly():
    """Without `--strict` pip-audit succeeds where it could not ask about any version."""
    lines = (ROOT / "Makefile").read_text(encoding="utf-8")
    [command] = re.findall(r"^audit:.*\n(?:\t.*\n)*?\t.*pip-audit (-.*)$", lines, re.MULTILINE)
    assert {"--strict", "constraints.txt"} <= {*command.split()}


def listed(entries: list | dict | str) -> list[str]:
    """The pages of a navigation, in order."""
    if isinstance(entries, str):
        return [entries]
    return [page for entry in (entries.values() if isinstance(entries, dict) else entries) for page in listed(entry)]


def test_one_command_makes_a_site_of_every_page():
    lines = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(r"^docs:.*\n(\t.*\n)*\t.*mkdocs build --strict$", lines, re.MULTILINE)
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    assert config["docs_dir"] == "docs"
    pages = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    apart = {page for page in pages if PurePosixPath(page).match(config["not_in_nav"])}
    assert {*listed(config["nav"])} == pages - apart
    assert apart == {page for page in pages if page.startswith("decisions/0")}  # which their index lists: test_docs.py


def test_the_site_is_made_without_a_warning(tmp_path):
    told = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr
    for page in ("index", "guide/index", "batch", "benchmarks/reliability", "decisions/0001-make-targets-over-a-pip-environment"):
        assert "DeGense" in (tmp_path / f"{page}.html").read_text(encoding="utf-8"), page
    assert (tmp_path / "guide" / "images").is_dir()

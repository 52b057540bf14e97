"""What goes with a release: how to cite it, what changed, and the version that all name."""

from __future__ import annotations

import re
import subprocess
import sys

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


def test_one_command_makes_the_pages_of_the_guide():
    lines = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert re.search(r"^docs:.*\n(\t.*\n)*\t.*mkdocs build --strict$", lines, re.MULTILINE)
    config = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = {page for entry in config["nav"] for page in entry.values()}
    assert pages == {path.name for path in (ROOT / config["docs_dir"]).glob("*.md")}


def test_the_pages_of_the_guide_are_made_without_a_warning(tmp_path):
    told = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr
    assert "DeGense" in (tmp_path / "index.html").read_text(encoding="utf-8")
    assert (tmp_path / "images").is_dir()

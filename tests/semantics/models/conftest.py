"""A tiny CLIP as open_clip publishes it, and a copy that may be spoilt."""

import shutil
from pathlib import Path

import pytest

from tests.semantics.models.open_clip_models import write_open_clip


@pytest.fixture(scope="module")
def published(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("models") / "open"
    write_open_clip(folder)
    return folder


@pytest.fixture
def folder(published, tmp_path) -> Path:
    """A copy that may be spoilt."""
    return Path(shutil.copytree(published, tmp_path / "spoilt"))

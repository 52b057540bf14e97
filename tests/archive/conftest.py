"""A tiny real run, alone in an archive."""

import shutil

import pytest

from degense.engine.archive.index_file import INDEX
from degense.engine.archive.indexing import update_index
from degense.engine.progress import finish
from tests.layers.conftest import clip, scene, speechless  # noqa: F401


@pytest.fixture(scope="session")
def indexed_scene(scene, tmp_path_factory):  # noqa: F811
    """The index of an archive with one run, `one`."""
    folder = tmp_path_factory.mktemp("archive")
    shutil.copytree(scene.run.path, folder / "one")
    finish(update_index(folder))
    return folder / INDEX

"""Small clips of two layouts."""

import numpy as np
import pytest

from tests.data.readers.makers import write_endonerf, write_frames


@pytest.fixture
def endonerf(tmp_path):
    write_endonerf(tmp_path, np.random.default_rng(1))
    return tmp_path


@pytest.fixture
def frames(tmp_path):
    write_frames(tmp_path / "images", np.random.default_rng(2), 4)
    return tmp_path

"""Files of points: three formats, and what is damaged or hostile."""

import json
import pickle

import numpy as np
import pytest

from degense.engine.data.files.point_files import MOST_PLACES, read_points
from degense.engine.errors import ClipError

SIZE = 64, 48


def test_the_same_points_in_three_formats(tmp_path):
    pixels, hidden = np.full((2, 5, 2), np.nan), np.zeros((2, 5), bool)
    pixels[0, 0], pixels[0, 3], pixels[1, 3] = (16.0, 12.0), (20.0, 12.0), (32.0, 24.0)
    hidden[1, 0] = True
    (tmp_path / "a.json").write_text(json.dumps({"0": [[16.0, 12.0], None], "3": [[20.0, 12.0], [32.0, 24.0]]}))
    (tmp_path / "a.csv").write_text("frame,x,y,point\n0,16,12,7\n3,32,24,9\n3,20,12,7\n0,nan,nan,9\n")
    np.savez(tmp_path / "a.npz", points=np.nan_to_num(pixels) / SIZE, occluded=np.isnan(pixels).any(-1))
    for name in ("a.json", "a.csv"):
        found = read_points(tmp_path / name, 5, SIZE)
        np.testing.assert_array_equal(found.pixels, pixels)
        np.testing.assert_array_equal(found.hidden, hidden)
        np.testing.assert_array_equal(found.queries, [[0, 16, 12], [3, 32, 24]])
    found = read_points(tmp_path / "a.npz", 5, SIZE)
    np.testing.assert_allclose(found.pixels, pixels)
    np.testing.assert_array_equal(found.hidden, np.isnan(pixels).any(-1))


def test_lines_without_a_point_are_points_of_their_own(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,frame\n1,2,0\n3,4,0\n")
    assert read_points(tmp_path / "a.csv", 5, SIZE).queries.tolist() == [[0, 1, 2], [0, 3, 4]]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.json", b"[1, 2"),
        ("a.json", b"[1, 2]"),
        ("a.json", b'{"0": [[1, 2]], "99": [[1, 2]]}'),
        ("a.json", b'{"-1": [[1, 2]]}'),
        ("a.json", b'{"0": [[1]]}'),
        ("a.json", b'{"0": [null]}'),
        ("a.json", b"[" * 100_000),
        ("a.csv", b"x,y\n1,2\n"),
        ("a.csv", b"frame,x,y,point\n0,1,2,1e18\n"),
        ("a.csv", b"frame,x,y\n0.5,1,2\n"),
        ("a.csv", b""),
        ("a.npz", b"PK not"),
        ("a.npz", pickle.dumps({"points": 1})),
        ("a.pkl", pickle.dumps({"points": 1})),
    ],
    ids=range(14),
)
def test_what_is_no_such_file_is_refused_in_a_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ClipError) as refused:
        read_points(tmp_path / name, 5, SIZE)
    assert str(refused.value).endswith(".")
    assert "\n" not in str(refused.value)


def test_tracks_of_another_clip_and_no_file_are_refused(tmp_path):
    np.savez(tmp_path / "short.npz", points=np.zeros((2, 4, 2)), occluded=np.zeros((2, 4), bool))
    with pytest.raises(ClipError, match="5 frames of the clip"):
        read_points(tmp_path / "short.npz", 5, SIZE)
    with pytest.raises(ClipError, match="no file of points"):
        read_points(tmp_path / "absent.json", 5, SIZE)


def test_more_places_than_memory_holds_are_refused_before_they_are_made(tmp_path):
    """A few kilobytes of text that name points of an endless clip."""
    frames = MOST_PLACES // 100
    (tmp_path / "a.json").write_text(json.dumps({"0": [[1, 2]] * 101}))
    (tmp_path / "a.csv").write_text("frame,x,y\n" + "0,1,2\n" * 101)
    np.savez_compressed(tmp_path / "a.npz", points=np.zeros((101, frames, 2), np.float16), occluded=np.zeros((101, frames), bool))
    for name in ("a.json", "a.csv", "a.npz"):
        with pytest.raises(ClipError):
            read_points(tmp_path / name, frames, SIZE)
    (tmp_path / "a.json").write_text('{"0": [[1e999, NaN]]}')
    with pytest.raises(ClipError, match="damaged"):
        read_points(tmp_path / "a.json", 5, SIZE)

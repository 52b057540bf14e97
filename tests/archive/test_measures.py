"""Confidences, percentiles of the displacement, and pictures of an index, against the run itself by other code."""

from __future__ import annotations

import json
from pathlib import PurePosixPath

import cv2
import numpy as np
import pytest
from scipy import ndimage

from degense.app.cli.main import main
from degense.engine.archive.frame_facts import PERCENTILES
from degense.engine.archive.index_file import open_index
from degense.engine.archive.listing import list_moments
from degense.engine.archive.search import search
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.archive import made


def straight(x: float, points, values) -> float:
    """On the line between the points beside x; before the first and after the last, their values."""
    if x <= points[0] or x >= points[-1]:
        return values[0] if x <= points[0] else values[-1]
    after = next(i for i, point in enumerate(points) if point >= x)
    share = (x - points[after - 1]) / (points[after] - points[after - 1])
    return values[after - 1] + share * (values[after] - values[after - 1])


def expected_confidence(scene, frame: int, mask: np.ndarray, members: tuple[str, ...]) -> float:
    """By the definition: chances of margins over the best other class, averaged by object, less what small objects lose."""
    query = scene.query(frame)
    maps = {name: query.refined(scene.vectors((name,))).astype(float) for name in scene.classes}
    own = np.max([maps[name] for name in members], 0)
    rivals = np.max([maps[name] for name in maps if name not in members] + [np.zeros(mask.shape)], 0)
    known = np.ones(mask.shape) if query.known is None else query.known.cpu().numpy()
    margins = np.minimum(np.maximum(own - rivals, 0), 1)
    objects, count = ndimage.label(mask, np.ones((3, 3)))
    total = 0.0
    for number in range(1, count + 1):
        pixels = objects == number
        chances = [straight(m, query.curve.margins, query.curve.chances) * k for m, k in zip(margins[pixels], known[pixels], strict=True)]
        total += sum(chances) * straight(np.log2(pixels.sum() / mask.size), query.curve.sizes, query.curve.discounts)
    return total / mask.sum()


def expected_percentile(values: list[float], percent: float) -> float:
    """Between the two of the sorted values that it falls between."""
    place = percent / 100 * (len(values) - 1)
    low = int(place)
    return values[low] + (place - low) * (values[min(low + 1, len(values) - 1)] - values[low])


@pytest.fixture(scope="module")
def opened(indexed_scene):
    with open_index(indexed_scene) as index:
        yield index


def test_confidences_and_percentiles_are_those_of_the_masks(opened, scene):
    [run] = opened.runs()
    members = {name: (name,) for name in run.things.classes} | dict(run.things.kinds)
    assert len(members) > len(run.things.classes)
    seen = 0
    for name in members:
        kinds = ("confidence", "displacement")
        confidence, displacement = (opened.columns(run.things, (kind, name), {run.id: run.frames}).get(run.id) for kind in kinds)
        for frame in range(0, run.frames, 4):
            [mask] = decode_frame(scene, PromptSet((name,)), frame).masks
            if not mask.any():
                assert confidence is None or confidence[frame] == 0
                continue
            seen += 1
            assert confidence[frame] == pytest.approx(expected_confidence(scene, frame, mask, members[name]), abs=2e-3)
            moved = scene.render(frame, what=("displacement",))["displacement"]
            values = sorted(value for value in moved[mask].tolist() if np.isfinite(value))
            expected = [expected_percentile(values, percent) for percent in PERCENTILES]
            assert displacement[frame].tolist() == pytest.approx(expected, rel=1e-5, abs=1e-9)
    assert seen > len(members)


def test_a_list_says_what_is_known_of_the_largest_frame_of_each_moment(opened):
    [run] = opened.runs()
    for text, name in (("liver near fat", "liver"), ("largest fat", "fat")):
        lines = list_moments(opened, search(opened, text), text, 3, pictures=False)
        assert lines
        for line in lines:
            kinds = ("confidence", "displacement")
            confidence, displacement = (opened.columns(run.things, (kind, name), {run.id: run.frames})[run.id] for kind in kinds)
            assert line.known.confidence == float(confidence[line.moment.peak]) > 0
            assert list(line.known.displacement) == displacement[line.moment.peak].tolist()
            assert line.picture is None


def test_thumbnails_are_small_pictures_of_their_moments(indexed_scene, scene, tmp_path):
    questions = ("liver at its largest", "tool at its smallest", "fat at its largest")
    out = ["--thumbnails", str(tmp_path / "pictures"), "--json", str(tmp_path / "said.json")]
    assert main(["search", str(indexed_scene.parent), *questions, *out]) == 0
    said = json.loads((tmp_path / "said.json").read_text(encoding="utf-8"))["questions"]
    rendered = np.stack([scene.render_rgb(frame) for frame in range(scene.frames)]).astype(float)
    peaks = []
    for folder, answer in zip(sorted((tmp_path / "pictures").iterdir()), said, strict=True):
        [moment] = answer["moments"]
        [path] = folder.iterdir()
        assert path.name == "0001.jpg"
        picture = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
        assert picture.shape == rendered.shape[1:]  # the clip is smaller than a thumbnail may be
        errors = np.abs(rendered - picture).mean((1, 2, 3))
        assert errors.argmin() == moment["peak"]
        assert errors.min() < 6 < 255
        peaks.append(moment["peak"])
    assert len({*peaks}) > 1


def test_pictures_are_no_larger_than_a_list_needs_and_the_nearest_is_taken(tmp_path):
    run = made.observed(made.film(1))
    run.pictures = {0: b"first", 5: b"middle", 11: b"last"}
    path = made.archive(tmp_path, a=made.observed(made.film(2)), b=run)
    with open_index(path) as index:
        number = next(known.id for known in index.runs() if known.path == PurePosixPath("b"))
        assert [index.picture(number, frame)[0] for frame in (0, 2, 3, 7, 8, 9, 11)] == [0, 0, 5, 5, 5, 11, 11]
        assert index.picture(number, 9) == (11, b"last")
        assert index.picture(99, 0) is None

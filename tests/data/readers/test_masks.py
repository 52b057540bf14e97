"""Mask polarity and the field of view are decided by evidence, and the decision is said."""

import cv2
import numpy as np
import pytest

from degense.engine.data.files.masks import field_of_view
from degense.engine.data.readers import ClipOptions, open_clip
from tests.data.readers.makers import HEIGHT, WIDTH, disc, save, tissue, tool, write_frames


def write(path, masks, frames):
    for i, (mask, frame) in enumerate(zip(masks, frames, strict=True)):
        save(path / f"images/{i:03d}.png", frame)
        save(path / f"masks/{i:03d}.png", mask.astype(np.uint8))
    return path


def operated(rng, count=5):
    frames = [tissue(rng) for _ in range(count)]
    for i, frame in enumerate(frames):
        frame[tool(i)] = 130
    return frames


@pytest.mark.parametrize("value", [1, 255])
@pytest.mark.parametrize("means", ["tool", "keep"])
def test_both_polarities_of_tool_masks(tmp_path, value, means):
    rng = np.random.default_rng(value)
    high = [tool(i) if means == "tool" else ~tool(i) for i in range(5)]
    clip = open_clip(write(tmp_path, [m * value for m in high], operated(rng)))
    assert f"{value} = {means} (" in clip.provenance["masks"]
    assert "assumed" not in clip.provenance["masks"]
    for i in range(5):
        np.testing.assert_array_equal(clip.valid(i), ~tool(i))


@pytest.mark.parametrize("value", [1, 255])
def test_field_of_view_masks_keep(tmp_path, value):
    rng = np.random.default_rng(3)
    frames = [np.where(disc()[..., None], tissue(rng), 2).astype(np.uint8) for _ in range(4)]
    clip = open_clip(write(tmp_path, [disc() * value] * 4, frames))
    assert f"{value} = keep" in clip.provenance["masks"]
    assert "outside the field of view" in clip.provenance["masks"]
    assert "stands still" in clip.provenance["masks"]
    np.testing.assert_array_equal(clip.valid(0), disc())
    assert "visible disc" in clip.provenance["focal"]


def test_a_small_field_of_view_is_kept_although_it_is_the_smaller_part(tmp_path):
    rng = np.random.default_rng(4)
    small = np.zeros((HEIGHT, WIDTH), bool)
    small[20:40, 30:60] = True
    frames = [np.where(small[..., None], tissue(rng), 2).astype(np.uint8) for _ in range(3)]
    clip = open_clip(write(tmp_path, [small * 255] * 3, frames))
    np.testing.assert_array_equal(clip.valid(1), small)


def test_the_user_has_the_last_word(tmp_path):
    write(tmp_path, [tool(i) * 255 for i in range(4)], operated(np.random.default_rng(5), 4))
    clip = open_clip(tmp_path, ClipOptions(mask_means="keep"))
    np.testing.assert_array_equal(clip.valid(2), tool(2))
    assert "255 = keep (as set" in clip.provenance["masks"]


def test_an_empty_mask_leaves_nothing_out_whatever_the_polarity(tmp_path):
    rng = np.random.default_rng(12)
    masks = [~tool(i) for i in range(4)]
    masks[2] = np.zeros((HEIGHT, WIDTH), bool)
    clip = open_clip(write(tmp_path, [m * 255 for m in masks], operated(rng, 4)), ClipOptions(mask_means="keep"))
    assert clip.valid(2).all()
    np.testing.assert_array_equal(clip.valid(1), ~tool(1))


def test_ambiguous_masks_are_called_an_assumption(tmp_path):
    rng = np.random.default_rng(6)
    half = np.zeros((HEIGHT, WIDTH), bool)
    half[:, : WIDTH // 2] = True
    clip = open_clip(write(tmp_path, [half * 255] * 3, [tissue(rng) for _ in range(3)]))
    assert "assumed 255 = tool" in clip.provenance["masks"]
    assert "set mask_means to change" in clip.provenance["masks"]


def test_empty_and_full_masks_leave_nothing_out(tmp_path):
    rng = np.random.default_rng(7)
    for name, value in (("empty", 0), ("full", 1), ("white", 255)):
        clip = open_clip(write(tmp_path / name, [np.full((HEIGHT, WIDTH), value)] * 3, [tissue(rng) for _ in range(3)]))
        assert clip.valid(1).all()
        assert "nothing is left out" in clip.provenance["masks"]


def test_a_tool_in_one_frame_of_many_is_found(tmp_path):
    masks = [np.zeros((HEIGHT, WIDTH), bool)] * 40
    masks[19] = tool(2)  # not among the frames that are sampled by position
    clip = open_clip(write(tmp_path, [m * 255 for m in masks], operated(np.random.default_rng(8), 40)))
    assert "255 = tool" in clip.provenance["masks"]
    np.testing.assert_array_equal(clip.valid(19), ~tool(2))
    assert clip.valid(0).all()


def test_soft_edges_count_from_the_middle(tmp_path):
    rng = np.random.default_rng(9)
    soft = [cv2.GaussianBlur((tool(i) * 255).astype(np.uint8), (0, 0), 1.5) for i in range(3)]
    clip = open_clip(write(tmp_path, soft, operated(rng, 3)))
    np.testing.assert_array_equal(clip.valid(1), soft[1] < 128)


def test_field_of_view_of_a_disc_with_dark_tissue_and_text():
    bright = np.where(disc(320, 256), 150, 4).astype(np.uint8)
    bright[100:140, 40:80] = 5  # dark tissue inside, at the rim
    cv2.putText(bright, "REC 12", (2, 14), 0, 0.4, 255, 1)
    found = field_of_view(bright)
    assert not found[~disc(320, 256)].any()
    assert found[disc(320, 256)].mean() > 0.92
    assert found[110:130, 45:75].all()


@pytest.mark.parametrize("kind", ["full", "black", "one dark corner", "dim"])
def test_no_border_no_field_of_view(kind):
    bright = np.full((128, 160), {"black": 3, "dim": 40}.get(kind, 150), np.uint8)
    if kind == "one dark corner":
        cv2.fillPoly(bright, [np.array([[159, 127], [159, 60], [90, 127]])], 4)
    assert field_of_view(bright) is None


def test_letterbox_bars_are_outside():
    bright = np.full((120, 160), 120, np.uint8)
    bright[:15] = bright[-15:] = 0
    found = field_of_view(bright)
    assert not found[:15].any()
    assert found[20:100, 5:155].all()


def test_frames_with_a_border_and_no_masks(tmp_path):
    rng = np.random.default_rng(10)
    for i in range(4):
        save(tmp_path / f"{i}.png", np.where(disc()[..., None], tissue(rng), 2).astype(np.uint8))
    clip = open_clip(tmp_path)
    assert not clip.valid(0)[~disc()].any()
    assert "dark border" in clip.provenance["masks"]
    assert clip.cameras[0].fx == pytest.approx(0.88 * WIDTH / 2 / np.tan(np.radians(35)), rel=0.1)


def test_no_masks_no_border(tmp_path):
    write_frames(tmp_path, np.random.default_rng(11), 3)
    assert open_clip(tmp_path).provenance["masks"] == "none: nothing is left out"

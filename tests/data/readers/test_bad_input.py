"""Whatever is wrong with a clip, the user gets one sentence that names the file and the reason."""

import os
import struct
import tracemalloc
import zlib
from contextlib import suppress

import numpy as np
import pytest

from degense.engine.data.files.images import read_rgb
from degense.engine.data.readers import ClipOptions, detect, open_clip
from degense.engine.errors import ClipError
from tests.data.readers.makers import HEIGHT, WIDTH, fails, save, tissue, write_frames


def test_missing_and_empty(tmp_path):
    fails(tmp_path / "nowhere", "nowhere does not exist")
    fails(tmp_path, "holds no frames")
    (tmp_path / "images").mkdir()
    fails(tmp_path, "images holds no pictures")
    (tmp_path / "notes.txt").write_text("hello")
    fails(tmp_path / "notes.txt", "notes.txt is no clip")
    fails(tmp_path / "bad\0name", "bad?name does not exist")
    fails(tmp_path / ("long" * 100), "cannot be read")


def test_a_folder_around_clips_or_a_video(tmp_path):
    write_frames(tmp_path / "a/images", np.random.default_rng(3), 1)
    fails(tmp_path, "holds 1: a;")
    (tmp_path / "b").mkdir()
    (tmp_path / "b/op.mp4").write_bytes(b"x")
    fails(tmp_path / "b", "holds the video op.mp4")


def test_truncated_png_is_found_on_opening(tmp_path):
    write_frames(tmp_path, np.random.default_rng(12), 40)
    file = tmp_path / "000019.png"  # not one of the frames that opening looks at
    file.write_bytes(file.read_bytes()[:-400])
    fails(tmp_path, "000019.png", "cut short or damaged")


def test_truncated_jpeg_is_found_on_opening(tmp_path):
    for i in range(3):
        save(tmp_path / f"{i}.jpg", tissue(np.random.default_rng(i)))
    file = tmp_path / "1.jpg"
    file.write_bytes(file.read_bytes()[:-150])
    fails(tmp_path, "1.jpg", "cut short or damaged")


@pytest.mark.parametrize("content", [b"", b"text", b"\x89PNG\r\n\x1a\n", b"GIF89a\x01\x00\x01\x00", np.random.default_rng(0).bytes(500)])
def test_no_picture(endonerf, content):
    (endonerf / "images/000002.png").write_bytes(content)
    fails(endonerf, "000002.png is not a picture")


def test_a_chunk_that_announces_gigabytes_takes_no_memory(tmp_path):
    data = bytearray(save(tmp_path / "0.png", tissue(np.random.default_rng(4))).read_bytes())
    at = data.index(b"IDAT")
    data[at - 4 : at] = b"\x7f\xff\xff\xff"
    (tmp_path / "0.png").write_bytes(data)
    tracemalloc.start()
    try:
        with suppress(ClipError):
            read_rgb(tmp_path / "0.png")
        assert tracemalloc.get_traced_memory()[1] < 1 << 26
    finally:
        tracemalloc.stop()


def test_random_damage_never_gives_anything_but_a_clip_error(tmp_path):
    rng = np.random.default_rng(4)
    good = save(tmp_path / "0.png", tissue(rng)).read_bytes()
    refused = 0
    for _ in range(150):
        data = bytearray(good)
        for place in rng.integers(0, len(data), rng.integers(1, 6)):
            data[place] = rng.integers(0, 256)
        (tmp_path / "0.png").write_bytes(data[: rng.integers(20, len(data)) if rng.random() < 0.3 else len(data)])
        try:
            open_clip(tmp_path).frame(0)
        except ClipError:
            refused += 1
    assert refused > 20


def png_header(width, height):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0" * 1000)) + chunk(b"IEND", b"")


@pytest.mark.parametrize("size", [(9000, 9000), (12000, 12000), (60000, 60000)])
def test_huge_pictures_are_refused_by_their_header(endonerf, size):
    (endonerf / "images/000001.png").write_bytes(png_header(*size))
    fails(endonerf, "000001.png", "64 megapixels")


def test_mixed_sizes(endonerf):
    save(endonerf / "images/000004.png", tissue(np.random.default_rng(5), WIDTH, HEIGHT - 2))
    fails(endonerf, "000004.png is 96 × 62", "000000.png is 96 × 64")
    save(endonerf / "images/000004.png", tissue(np.random.default_rng(5)))
    save(endonerf / "masks/000002.png", np.zeros((HEIGHT, WIDTH - 1), np.uint8))
    fails(endonerf, "masks", "000002.png is 95 × 64", "the frames are 96 × 64")


def test_counts_that_differ(endonerf):
    (endonerf / "masks/000004.png").unlink()
    fails(endonerf, "masks holds 4 masks, but there are 5 frames")
    save(endonerf / "masks/000007.png", np.zeros((HEIGHT, WIDTH), np.uint8))
    fails(endonerf, "000007.png does not belong to 000004.png")


def test_numbers_with_a_constant_offset_pair(endonerf):
    for i in reversed(range(5)):
        (endonerf / f"masks/{i:06d}.png").rename(endonerf / f"masks/{i + 1:06d}.png")
    assert len(open_clip(endonerf)) == 5


def test_two_files_for_one_frame(frames):
    save(frames / "images/000001.jpg", tissue(np.random.default_rng(6)))
    fails(frames, "would be the same frame")


def test_masks_in_colour(endonerf):
    save(endonerf / "masks/000000.png", tissue(np.random.default_rng(7)))
    fails(endonerf, "masks", "000000.png is a colour picture")


def test_links_out_of_the_clip_pipes_and_odd_names(tmp_path):
    clip, outside = tmp_path / "clip", tmp_path / "outside"
    write_frames(clip / "images", np.random.default_rng(9), 3)
    secret = save(outside / "secret.png", tissue(np.random.default_rng(10)))
    link = clip / "images/000003.png"
    link.symlink_to(secret)
    fails(clip, "000003.png is a link that leads out of the clip")
    link.unlink()
    link.symlink_to("000001.png")
    assert len(open_clip(clip)) == 4
    link.unlink()
    os.mkfifo(link)
    fails(clip, "000003.png is not a regular file")
    link.unlink()
    (clip / "masks").symlink_to(outside)
    fails(clip, "masks is a link that leads out of the clip")
    (clip / "masks").unlink()
    (clip / "images/evil\n\x1b[31mname.png").write_bytes(b"x")
    fails(clip, "evil??[31mname.png")


def test_a_clip_folder_that_is_a_link_itself_is_fine(frames, tmp_path_factory):
    link = tmp_path_factory.mktemp("links") / "clip"
    link.symlink_to(frames)
    assert len(open_clip(link)) == 4


def test_hidden_files_are_no_frames(frames):
    (frames / "images/._000001.png").write_bytes(b"resource fork")
    (frames / "images/Thumbs.db").write_bytes(b"x")
    assert len(open_clip(frames)) == 4


def test_a_frame_replaced_after_opening_is_an_error(frames):
    clip = open_clip(frames)
    clip.cache.limit = 0
    save(frames / "images/000002.png", tissue(np.random.default_rng(11), 40, 30))
    with pytest.raises(ClipError, match=r"000002\.png was changed since the clip was opened"):
        clip.frame(2)


def test_options_are_checked(frames):
    for wrong in (
        {"layout": "movie"},
        {"mask_means": "both"},
        {"focal": 0},
        {"focal": float("nan")},
        {"stride": 0},
        {"pose_axes": "colmap"},
    ):
        with pytest.raises(ClipError):
            ClipOptions(**wrong)
    fails(frames, "it cannot have the layout video", options=ClipOptions(layout="video"))
    assert detect(frames) == "frames"
    assert len(open_clip(frames, ClipOptions(layout="endonerf"))) == 4


def test_unreadable_files(frames, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: not str(path).endswith("000001.png"))  # the superuser may read everything
    fails(frames, "000001.png may not be read", "permissions")

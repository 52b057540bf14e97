"""A chunk of a PNG that is damaged, though its check sum is right, is refused, whatever Pillow raises for it."""

from __future__ import annotations

import io
import zlib

import numpy as np
import pytest
from PIL import Image

from degense.engine.data.files.images import read_raw
from degense.engine.errors import ClipError

#: Colour profiles whose name has no end, that end with their name, and of an unknown kind.
PROFILES = (b"profile", b"profile\0", b"profile\0\7abc")
HEADER, END = 33, 12  # bytes


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("behind", [True, False], ids=["behind the pixels", "before them"])
def test_a_damaged_profile_is_refused(profile, behind, tmp_path):
    out = io.BytesIO()
    Image.fromarray(np.zeros((4, 5), np.uint8)).save(out, "PNG")
    data = out.getvalue()
    at = len(data) - END if behind else HEADER
    chunk = b"iCCP" + profile
    (tmp_path / "a.png").write_bytes(data[:at] + len(profile).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big") + data[at:])
    with pytest.raises(ClipError, match=r"a\.png is (not a picture that can be read|cut short or damaged)"):
        read_raw(tmp_path / "a.png")

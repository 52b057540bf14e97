"""What the user may say of a camera's motion, and what becomes of it."""

import numpy as np
import pytest

from degense.app.cli.main import main
from degense.engine.data.readers import ClipOptions, open_clip
from degense.engine.errors import ClipError


def test_the_users_word_goes_before_the_clips(moving):
    brought, still, estimate = (open_clip(moving, ClipOptions(poses=poses)) for poses in ("auto", "still", "estimate"))
    assert [clip.poses for clip in (brought, still, estimate)] == ["given", "given", "estimate"]
    assert not np.allclose(brought.cameras[5].viewmat, np.eye(4))
    for clip in (still, estimate):
        assert all((camera.viewmat == np.eye(4)).all() for camera in clip.cameras)
        assert clip.cameras[0].fx == brought.cameras[0].fx
        assert clip.cameras[3] is clip.cameras[0]
    assert still.provenance["poses"] == "the camera stands still, as set"
    assert still.options == {"poses": "still"}


def test_intrinsics_alone_say_nothing_of_the_poses(moving, without_poses):
    clip = open_clip(without_poses(moving))
    assert clip.poses == "auto"
    assert "training looks whether it moves" in clip.provenance["poses"]
    assert clip.unit == "mm"
    assert open_clip(clip.path, ClipOptions(poses="still")).poses == "given"


def test_an_unknown_word_is_refused():
    with pytest.raises(ClipError, match="poses is 'maybe'"):
        ClipOptions(poses="maybe")


def test_info_estimates_on_request(moving, without_poses, capsys):
    folder = str(without_poses(moving))
    assert main(["info", folder]) == 0
    assert "training looks whether it moves" in capsys.readouterr().out
    assert main(["info", folder, "--poses", "estimate"]) == 0
    assert "estimated: the camera moves up to" in capsys.readouterr().out

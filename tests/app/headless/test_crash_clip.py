"""Nothing is lost of what is done to a clip that has no run: its session is kept beside it as a run's is in its folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from degense.app.session import session_file
from degense.app.session.session_file import DamagedSession
from degense.app.session.state_folder import JOURNAL, folder_of, left_behind
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError
from tests.app.painting import FakeClip, annotating, opened_clip, paint_and_kill


@pytest.mark.parametrize(("dabs", "seconds", "lost"), [(0, 2.7, 2.0), (8, 0.7, 0.4)])
def test_kill_while_labelling_a_clip_loses_two_seconds_of_a_stroke_at_most(tmp_path, dabs, seconds, lost):
    """A clip that has no run: in one stroke that does not end, and in strokes of eight dabs, of which only the last may be lost."""
    last = paint_and_kill(tmp_path, "clip", dabs, seconds)
    assert last * 0.02 > 0.4 * seconds
    assert left_behind() == [tmp_path]
    session, annotations = opened_clip(tmp_path)
    assert annotations.work.records == {}  # until the user has decided
    session.recover()
    painted = np.flatnonzero((annotations.labels(0) == 0).all(0))
    assert len(painted) >= last - lost / 0.02
    assert list(painted) == list(range(len(painted)))
    assert session.dirty
    session.save()
    assert left_behind() == []
    session.close()
    _, annotations = opened_clip(tmp_path)
    assert np.array_equal(np.flatnonzero((annotations.labels(0) == 0).all(0)), painted)


def columns(count: int) -> PixelRegion:
    return PixelRegion(0, 0, np.ones((40, count), bool))


def test_the_journal_of_a_clip_is_good_up_to_its_tear_and_never_applied_twice(tmp_path):
    session, annotations = opened_clip(tmp_path)
    session.save()
    assert not (tmp_path / "annotations").exists()  # nothing was done yet
    annotations.paint("Fill", columns(9))
    left = folder_of(tmp_path / "annotations") / JOURNAL
    written = left.read_bytes()
    session.save()
    annotations.paint("Fill", columns(9), 255)
    session.save()
    session.close()
    left.write_bytes(written)  # as if the program had ended before it was removed
    session, annotations = opened_clip(tmp_path)
    assert (session.store.unsaved, session.dirty) == ([], False)
    assert (annotations.labels(0) == 255).all()
    annotations.paint("Fill", columns(5))
    session.close()
    with open(left, "ab") as file:
        file.write(b'{"part":"annotations","record":{"pieces":[{}]}}\n')
    session, annotations = opened_clip(tmp_path)
    with pytest.raises(DegenseError, match="does not hold strokes"):
        session.recover()
    assert (annotations.labels(0)[:, :5] == 0).all()
    assert session.dirty
    assert not left.exists()
    assert left.with_name(f"{JOURNAL}.bad-2").exists()  # the first is that of an older session file


def test_a_journal_that_earlier_versions_kept_beside_the_labels_is_recovered(tmp_path):
    session, annotations = opened_clip(tmp_path)
    annotations.paint("Fill", columns(9))
    session.close()
    now = folder_of(tmp_path / "annotations") / JOURNAL
    old = now.replace(tmp_path / "annotations" / JOURNAL)
    _, *rest = old.read_text().splitlines(keepends=True)
    old.write_text("".join(['{"journal":1,"after":""}\n', *rest]))
    session, annotations = opened_clip(tmp_path)
    session.recover()
    assert (annotations.labels(0)[:, :9] == 0).all()
    assert now.exists()
    assert not old.exists()


def test_two_windows_on_a_clip_do_not_write_over_each_other(tmp_path):
    first, labels = opened_clip(tmp_path)
    second, others = opened_clip(tmp_path)
    assert "open in another window" in second.store.problem
    labels.paint("Fill", columns(9))
    for change in (lambda: others.paint("Fill", columns(3)), lambda: others.add_class("fat"), lambda: others.begin("Paint")):
        with pytest.raises(DegenseError, match="open in another window"):
            change()
    assert others.work.records == {}  # nothing is painted that would be lost
    third, _ = opened_clip(tmp_path)
    assert (second.store.elsewhere, third.store.elsewhere, third.store.unsaved) == (True, True, [])
    with pytest.raises(DegenseError, match="open in another window"):
        second.save()
    first.save()
    first.close()
    third.close()
    _, again = opened_clip(tmp_path)
    assert (again.labels(0)[:, :9] == 0).all()


def test_work_on_a_clip_that_cannot_be_written_is_in_the_journal_and_can_be_saved_elsewhere(tmp_path):
    """The clip lies where nothing can be made, not even by the superuser."""
    session, annotations = annotating()
    clip = FakeClip(Path("/sys/kernel"))
    session.open_clip(clip)
    assert session.store.problem == ""  # nothing was done yet
    annotations.paint("Fill", columns(9))
    assert "/sys/kernel/annotations cannot be written" in session.store.problem
    assert (session.dirty, session.store.journaled) == (True, True)
    with pytest.raises(DegenseError, match="cannot be written"):
        session.save()
    session.close()
    assert left_behind() == [clip.path]
    session, annotations = annotating()
    session.open_clip(clip)
    session.recover()
    assert (annotations.labels(0)[:, :9] == 0).all()
    session.store.save_elsewhere(tmp_path / "mine")
    assert (session.dirty, session.store.problem, left_behind()) == (False, "", [])
    annotations.paint("Fill", columns(12))
    session.save()
    session.close()
    session, annotations = annotating()
    session.open_clip(clip)  # finds it there again
    assert session.store.unsaved == []
    assert (annotations.labels(0)[:, :12] == 0).all()


def test_a_drive_that_vanishes_takes_nothing_along_that_was_painted_since_it_was_opened(tmp_path):
    drive = tmp_path / "drive" / "clip"
    drive.mkdir(parents=True)
    session, annotations = opened_clip(drive)
    annotations.paint("Fill", columns(9))
    session.save()
    session.go_to(1)
    annotations.paint("Fill", columns(5))
    drive.parent.rename(tmp_path / "unplugged")
    annotations.paint("Fill", columns(7))
    assert "gone or read-only" in session.store.problem
    with pytest.raises(DegenseError):
        session.save()
    assert not drive.parent.exists()  # nothing is made where it was
    session.store.save_elsewhere(tmp_path / "mine")
    session.close()
    (tmp_path / "unplugged").rename(drive.parent)
    session, annotations = opened_clip(drive)
    assert (annotations.labels(0)[:, :9] == 0).all()
    assert (annotations.labels(1)[:, :7] == 0).all()


def test_a_damaged_session_of_a_clip_offers_its_backup(tmp_path):
    session, annotations = opened_clip(tmp_path)
    annotations.paint("Fill", columns(9))
    session.save()
    session.view.set_threshold(0.25)
    session.save()
    session.close()
    file = tmp_path / "annotations" / session_file.NAME
    file.write_text("{]")
    with pytest.raises(DamagedSession, match="open its backup") as caught:
        session.open_clip(FakeClip(tmp_path))
    assert session.clip is None
    session_file.restore(caught.value.backups[0], file)
    session.open_clip(FakeClip(tmp_path))
    assert (annotations.labels(0)[:, :9] == 0).all()
    assert session.view_state.threshold == 0.5

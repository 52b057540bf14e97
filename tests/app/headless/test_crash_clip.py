"""Nothing is lost of what is done to a clip that has no run: its session is kept beside it as a run's is in its folder."""

from __future__ import annotations

import zlib

import numpy as np
import pytest

from degense.app.session import session_file
from degense.app.session.journal import Journal
from degense.app.session.session_file import DamagedSession
from degense.app.session.store import JOURNAL, waiting
from degense.engine.annotation.folder import INDEX
from degense.engine.annotation.folder import save as save_annotations
from degense.engine.annotation.painting import PixelRegion
from degense.engine.errors import DegenseError
from tests.app.painting import FakeClip, annotating, opened_clip, paint_and_kill
from tests.fakes import MemoryClip


@pytest.mark.parametrize(("dabs", "seconds", "lost"), [(0, 2.7, 2.0), (8, 0.7, 0.4)])
def test_kill_while_labelling_a_clip_loses_two_seconds_of_a_stroke_at_most(tmp_path, dabs, seconds, lost):
    """A clip that has no run: in one stroke that does not end, and in strokes of eight dabs, of which only the last may be lost."""
    last = paint_and_kill(tmp_path, "clip", dabs, seconds)
    assert last * 0.02 > 0.4 * seconds
    assert waiting(tmp_path / "annotations")
    session, annotations = opened_clip(tmp_path)
    assert annotations.work.records == {}  # until the user has decided
    session.recover()
    painted = np.flatnonzero((annotations.labels(0) == 0).all(0))
    assert len(painted) >= last - lost / 0.02
    assert list(painted) == list(range(len(painted)))
    assert session.dirty
    session.save()
    assert not waiting(tmp_path / "annotations")
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
    left = tmp_path / "annotations" / JOURNAL
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
    assert (tmp_path / "annotations" / f"{JOURNAL}.bad-2").exists()  # the first is that of an older session file


@pytest.mark.parametrize("fits", [True, False])
def test_the_journal_that_earlier_versions_wrote_beside_a_clip_is_recovered_or_set_aside(tmp_path, fits):
    session, annotations = opened_clip(tmp_path)
    annotations.paint("Fill", columns(9))
    save_annotations(annotations.work, folder := tmp_path / "annotations")
    piece = annotations.work.piece(0, columns(9)).to_json()
    session.close()
    (folder / JOURNAL).unlink()
    old = Journal(folder / "annotations.journal", f"{zlib.crc32((folder / INDEX).read_bytes()):08x}" if fits else "")
    old.append("annotations", {"pieces": [{**piece, "status": "done"}]})
    old.close()
    session, annotations = annotating()
    troubles: list[str] = []
    session.store.trouble.connect(troubles.append)
    session.open_clip(FakeClip(tmp_path))
    assert not (folder / "annotations.journal").exists()
    assert (folder / "annotations.journal.bad").exists() is not fits
    assert [("set aside" in trouble) for trouble in troubles] == ([] if fits else [True])
    assert len(session.store.unsaved) == fits
    if fits:
        session.recover()
    assert (annotations.work.record(0).status == "done") is fits


def test_two_windows_on_a_clip_do_not_write_over_each_other(tmp_path):
    first, labels = opened_clip(tmp_path)
    second, others = opened_clip(tmp_path)
    troubles: list[str] = []
    second.store.trouble.connect(troubles.append)
    labels.paint("Fill", columns(9))
    for count in (3, 4):
        others.paint("Fill", columns(count))
    assert len(troubles) == 1  # said once
    assert "open in another window" in troubles[0]
    third, _ = opened_clip(tmp_path)
    assert (second.store.elsewhere, third.store.elsewhere, third.store.unsaved) == (True, True, [])
    with pytest.raises(DegenseError, match="open in another window"):
        second.save()
    first.save()
    first.close()
    third.close()
    _, again = opened_clip(tmp_path)
    assert (again.labels(0)[:, :9] == 0).all()


def test_a_clip_that_cannot_be_written_to_says_so_and_stays_open():
    session, annotations = annotating()
    troubles: list[str] = []
    session.store.trouble.connect(troubles.append)
    session.open_clip(MemoryClip())
    annotations.paint("Fill", columns(9))
    assert "cannot be written" in troubles[0]
    assert session.dirty
    with pytest.raises(DegenseError, match="nothing was saved"):
        session.save()


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

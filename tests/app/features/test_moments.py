"""Task: ask when something happens, and go there."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt

from degense.app.features.prompts.moments import HINT
from degense.engine.scene.clip_query import decode_frame
from degense.engine.semantics.prompts import PromptSet
from tests.app import installed as on
from tests.app.features.test_prompt import type_prompt

QUESTION = "gallbladder not touching grasper"


def asked(qtbot, window, idle, text: str) -> None:
    on.viewer(window).panel.setFocus()
    type_prompt(qtbot, window, text)
    qtbot.waitUntil(lambda: bool(on.moments(window).answers))
    idle()


def test_a_question_is_typed_its_moments_are_listed_and_gone_to(qtbot, opened, idle, screenshot):
    asked(qtbot, opened, idle, "grasper at its largest")
    scene, moments = opened.session.scene, on.moments(opened)
    areas = [decode_frame(scene, PromptSet(("grasper",)), frame).masks[0].mean() for frame in range(scene.frames)]
    [(_, moment)] = moments.moments()
    assert (moment.first, moment.last) == (np.argmax(areas), np.argmax(areas))
    opened.session.go_to(0 if moment.first else 1)
    moments.table.setCurrentCell(0, 0)
    assert opened.session.frame == moment.first
    opened.session.go_to(0 if moment.first else 1)
    qtbot.keyClick(on.viewer(opened).panel, Qt.Key.Key_J)
    assert opened.session.frame == moment.first
    for step in ("query.next", "query.previous"):
        opened.session.go_to(0 if moment.first else 1)
        opened.registry.run(step)
        assert opened.session.frame == moment.first
    screenshot(opened, "moments")


def test_the_mask_of_a_question_is_shown_and_measured(qtbot, opened, idle):
    asked(qtbot, opened, idle, QUESTION)
    scene, frame = opened.session.scene, opened.session.frame
    mask = decode_frame(scene, PromptSet((QUESTION,)), frame).masks[0]
    np.testing.assert_array_equal(on.viewer(opened).view.masks[..., 3] > 0, mask)
    [row] = on.prompts(opened).bar.prompts()
    assert row.answer.text().startswith(f"{mask.mean():.1%}")


def test_plain_prompts_are_no_questions_and_hidden_ones_are_not_asked(qtbot, opened, idle):
    moments = on.moments(opened)
    opened.session.view.add_prompt("liver")
    idle()
    assert not moments.answers
    asked(qtbot, opened, idle, QUESTION)
    opened.session.view.set_visible(QUESTION, False)
    assert not moments.answers
    assert not moments.listed()
    assert moments.table.rowCount() == 0
    assert HINT in moments._note.text()


def test_what_cannot_be_read_is_said_in_its_row(qtbot, opened, idle):
    on.viewer(opened).panel.setFocus()
    type_prompt(qtbot, opened, "grasper touching")
    [row] = on.prompts(opened).bar.prompts()
    assert "A name is missing" in row.error

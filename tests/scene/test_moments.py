"""Questions on a scene: the same masks for a frame, a clip, Gaussians and the command line, by hand from the masks of their nouns."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from degense.app.cli.main import main
from degense.app.cli.terminal import Bar, run_steps
from degense.engine.clip import UNLABELLED
from degense.engine.errors import DegenseError, PromptError
from degense.engine.scene.clip_query import decode_frame, decode_splats, query_clip
from degense.engine.scene.moments import ask_clip
from degense.engine.semantics.prompts import PromptSet
from degense.engine.semantics.relations import extreme, related

FRAME = 4


def alone(scene, text, frame=FRAME, **settings):
    return decode_frame(scene, PromptSet((text,), **settings), frame).masks[0]


def test_a_question_is_made_of_the_masks_of_its_nouns(scene):
    liver, tool, fat = (alone(scene, text) for text in ("liver", "tool", "fat"))
    expected = {
        "liver or fat": liver | fat,
        "liver but not (tool or fat)": liver & ~tool & ~fat,
        "tool near liver": related(tool, "near", liver),
        "fat not left of the liver": related(fat, "left of", liver, negated=True),
        "largest fat": extreme(fat, True),
        "liver when fat before tool": liver,
    }
    assert liver.any()
    assert tool.any()
    assert fat.any()
    assert expected["tool near liver"].any()
    found = decode_frame(scene, PromptSet(("liver", *expected)), FRAME)
    np.testing.assert_array_equal(found.masks[0], liver)
    for mask, (text, wanted) in zip(found.masks[1:], expected.items(), strict=True):
        np.testing.assert_array_equal(mask, wanted, err_msg=text)
        np.testing.assert_array_equal(alone(scene, text), wanted, err_msg=text)
    assert ((found.labels == UNLABELLED) == ~found.masks.any(0)).all()
    np.testing.assert_array_equal(next(query_clip(scene, PromptSet(("liver", *expected)), [FRAME]))[1].masks, found.masks)


def test_negatives_take_from_all_and_a_question_may_be_one(scene):
    plain = decode_frame(scene, PromptSet(("liver", "fat"), ("tool near liver",)), FRAME)
    near = alone(scene, "tool near liver")
    for mask, text in zip(plain.masks, ("liver", "fat"), strict=True):
        np.testing.assert_array_equal(mask, alone(scene, text) & ~near)
    mixed = decode_frame(scene, PromptSet(("liver or fat",), ("tissue",)), FRAME)
    np.testing.assert_array_equal(mixed.masks[0], alone(scene, "liver", negatives=("tissue",)) | alone(scene, "fat", negatives=("tissue",)))


def test_gaussians_of_a_question_lie_in_its_mask(scene):
    asked = PromptSet(("tissue not near tool", "tool"))
    found, plain = decode_splats(scene, asked, FRAME), decode_splats(scene, PromptSet(("tissue", "tool")), FRAME)
    np.testing.assert_array_equal(found.masks[1], plain.masks[1])
    assert not (found.masks[0] & ~plain.masks[0]).any()
    mask = decode_frame(scene, asked, FRAME).masks[0]
    x, y = np.floor(scene.camera(FRAME).project(scene.splats(FRAME).means.cpu().numpy())[0]).astype(int).T
    for gaussian in np.flatnonzero(plain.masks[0]):
        inside = 0 <= x[gaussian] < mask.shape[1] and 0 <= y[gaussian] < mask.shape[0] and mask[y[gaussian], x[gaussian]]
        assert found.masks[0][gaussian] == inside
    held = found.labels != UNLABELLED
    assert (found.masks[found.labels[held], held.nonzero()[0]]).all()
    assert (held == found.masks.any(0)).all()


def test_a_clip_is_answered_frame_by_frame(scene):
    texts = ("tool near liver", "tool", "when is no tool", "tool at its largest", "liver before tool near liver")
    answers = run_steps(ask_clip(scene, PromptSet(texts)), Bar())
    tools = np.array([alone(scene, "tool", frame).mean() for frame in range(scene.frames)])
    near = np.array([alone(scene, "tool near liver", frame).mean() for frame in range(scene.frames)])
    np.testing.assert_allclose(answers[0].areas, near)
    np.testing.assert_array_equal(answers[0].kept, near > 0)
    np.testing.assert_array_equal(answers[2].kept, tools == 0)
    assert [(m.first, m.last, m.area) for m in answers[3].moments] == [(tools.argmax(), tools.argmax(), tools.max())]
    np.testing.assert_array_equal(answers[4].kept, np.arange(scene.frames) < np.flatnonzero(near)[0])


def test_what_cannot_be_answered_is_said_before_anything_is_drawn(scene, speechless):
    for text, sentence in (("tool near banana", "'banana'"), ("liver before banana", "'banana'"), ("tool near", "A name is missing")):
        with pytest.raises(PromptError, match=sentence):
            next(ask_clip(scene, PromptSet((text,))))
        with pytest.raises(PromptError, match=sentence):
            decode_frame(scene, PromptSet((text,)), FRAME)
    with pytest.raises(DegenseError, match="without semantics"):
        next(ask_clip(speechless, PromptSet(("liver near fat",))))


def test_the_command_says_and_writes_it(scene, tmp_path, capsys):
    questions = ["tool near liver", "liver when no liver"]
    out = ["--json", str(tmp_path / "said.json"), "--out", str(tmp_path / "masks")]
    assert main(["query", str(scene.run.path), *questions, *out]) == 0
    said = capsys.readouterr().out
    [answer, nothing] = run_steps(ask_clip(scene, PromptSet(tuple(questions))), Bar())
    assert f"{len(answer.moments)} moment" in said
    assert "liver when no liver: in none of 9 frames" in said
    data = json.loads((tmp_path / "said.json").read_text(encoding="utf-8"))["questions"]
    assert data[0]["moments"] == [vars(moment) for moment in answer.moments]
    np.testing.assert_allclose(data[0]["areas"], answer.areas, atol=1e-6)
    assert data[1]["moments"] == []
    assert data[1]["kept"] == nothing.kept.tolist()
    written = sorted((tmp_path / "masks/01-tool-near-liver/masks/01-tool-near-liver").iterdir())
    assert [int(path.stem) for path in written] == np.flatnonzero(answer.kept).tolist()
    np.testing.assert_array_equal(np.array(Image.open(written[0])) > 0, alone(scene, questions[0], int(written[0].stem)))
    assert main(["query", str(scene.run.path), "tool near banana"]) == 2

"""An index answers with the very frames and areas that the masks themselves give, or says that it cannot."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.archive.index_file import open_index
from degense.engine.archive.search import search
from degense.engine.errors import PromptError
from degense.engine.progress import finish
from degense.engine.scene.moments import ask_clip
from degense.engine.semantics.moments import expressions, frames_of, mask_of, moments
from degense.engine.semantics.prompts import PromptSet
from degense.engine.vocabulary.questions import nouns_of, read_question
from tests.archive import made

#: Of the grammar everything; each is answered from the index alone.
QUESTIONS = (
    *("grasper", "tool", "liver or gallbladder", "grasper and liver", "liver but not fat", "hook near liver but not near fat"),
    *(f"grasper {relation} liver" for relation in ("left of", "right of", "above", "below", "touching", "near", "inside", "between")),
    *("grasper not touching liver", "hook between liver and gallbladder", "tool between liver and fat", "grasper touching liver or fat"),
    *("grasper touching liver and fat", "hook left of liver or near fat", "hook left of the gallbladder and near the liver"),
    *(
        "largest liver",
        "smallest liver not near the hook",
        "largest grasper touching liver",
        "(hook near fat or near liver) touching grasper",
    ),
    *("grasper left of liver or fat", "grasper touching tool", "liver near liver", "fat left of (largest liver)"),
    *("liver while no grasper", "when is no hook", "liver before hook touching liver", "liver after grasper", "first grasper near fat"),
    *("last tool touching liver", "liver at its largest", "hook at its smallest", "when does the grasper first touch the liver"),
    *("scissors", "liver touching scissors", "liver not touching scissors", "liver but not scissors", "Greifer berührt Leber"),
)


def by_hand(text: str, frames: list[dict[str, np.ndarray]]):
    """The moments that masks give; a name that no class has has an empty one."""
    question = read_question(text, made.CLASSES)
    named = {"tool": "instrument", "Greifer": "grasper", "Leber": "liver"}
    empty = np.zeros((made.HEIGHT, made.WIDTH), bool)

    def of_noun(masks: dict[str, np.ndarray], noun: str) -> np.ndarray:
        meant = next((masks[name] for name in masks if name in noun.lower().split()), None)
        return masks.get(named.get(noun, noun), empty) if meant is None else meant

    areas = {
        part: np.array([mask_of(part, {noun: of_noun(masks, noun) for noun in nouns_of(question)}).mean() for masks in frames])
        for part in expressions(question)
    }
    kept = frames_of(question, areas)
    return kept, moments(kept, areas[question.what])


@pytest.fixture(scope="module")
def films():
    """One in which masks share no pixel, as those of a decoder hardly do, and two in which they do."""
    apart = made.film(0)
    for masks in apart:
        taken = np.zeros((made.HEIGHT, made.WIDTH), bool)
        for name in made.CLASSES:
            masks[name] = masks[name] & ~taken
            taken |= masks[name]
        masks["instrument"] = masks["grasper"] | masks["hook"]
        masks["tissue"] = masks["liver"] | masks["gallbladder"] | masks["fat"]
    return {"apart": apart, "b": made.film(1), "c": made.film(2)}


@pytest.fixture(scope="module")
def index(films, tmp_path_factory):
    return made.archive(tmp_path_factory.mktemp("archive"), **{name: made.observed(frames) for name, frames in films.items()})


@pytest.mark.parametrize("text", QUESTIONS)
def test_the_frames_and_areas_of_the_masks_themselves(text, films, index):
    with open_index(index) as opened:
        found = search(opened, text)
    hits = {str(hit.run.path): hit for hit in found.hits}
    left = {str(run.path) for run, _ in found.unanswered}
    assert "apart" not in left, found.unanswered
    for name in {*films} - left:
        kept, wanted = by_hand(text, films[name])
        assert (name in hits) == kept.any()
        if kept.any():
            assert hits[name].answering == kept.sum()
            assert [(m.first, m.last, m.peak) for m in hits[name].moments] == [(m.first, m.last, m.peak) for m in wanted]
            np.testing.assert_allclose([m.area for m in hits[name].moments], [m.area for m in wanted], atol=1e-12)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("(liver or fat) touching hook", "several names in parentheses"),
        ("largest (liver or fat)", "several names in parentheses"),
        ("hook touching (largest liver)", "chosen by a relation"),
        ("hook inside liver or fat", "known only to the run"),
        ("hook between liver and fat and gallbladder", "known only to the run"),
        ("liver @3:10,10", "like a place in a picture"),
        ("tissue, not fat", "no name in common"),
    ],
)
def test_what_only_the_run_knows_is_said(text, why, index):
    with open_index(index) as opened:
        found = search(opened, text)
    assert not found.hits
    assert len(found.unanswered) == 3
    assert all(why in sentence for _, sentence in found.unanswered)


def test_names_are_those_of_each_run(tmp_path):
    other = ("Knochen", "grasper")
    path = made.archive(
        tmp_path, a=made.observed(made.film(1)), b=made.observed(made.film(2, other), other), c=made.observed(made.film(3), closed=False)
    )
    with open_index(path) as opened:
        found = search(opened, "Knochen")
        assert [str(hit.run.path) for hit in found.hits] == ["b"]
        assert {str(run.path) for run, _ in found.unanswered} == {"a", "c"}  # there nobody understands it
        assert [str(run.path) for run, _ in search(opened, "scissors").unanswered] == ["c"]  # its encoder knows more than its classes
        with pytest.raises(PromptError, match="vocabulary"):
            search(opened, "xylophone")
        with pytest.raises(PromptError, match="A name is missing"):
            search(opened, "liver near")


def test_an_index_says_what_an_opened_run_says(indexed_scene, scene):
    questions = (
        "tool near liver",
        "liver",
        "fat not left of the liver",
        "tool or liver",
        "largest fat",
        "liver but not tool",
        "first tool",
    )
    answers = finish(ask_clip(scene, PromptSet(questions)))
    with open_index(indexed_scene) as opened:
        for text, answer in zip(questions, answers, strict=True):
            found = search(opened, text)
            assert not found.unanswered
            [hit] = found.hits
            assert [(m.first, m.last, m.peak) for m in hit.moments] == [(m.first, m.last, m.peak) for m in answer.moments]
            np.testing.assert_allclose([m.area for m in hit.moments], [m.area for m in answer.moments], atol=1e-12)

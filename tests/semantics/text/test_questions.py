"""Questions are read as the grammar says, and what is no question stays the prompt that it was."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from degense.engine.errors import PromptError
from degense.engine.vocabulary import surgical_vocabulary
from degense.engine.vocabulary.questions import (
    AllOf,
    AnyOf,
    ButNot,
    Extreme,
    Moments,
    Noun,
    Question,
    Related,
    heads,
    nouns_of,
    read_question,
)
from tests.house.source import ROOT
from tests.semantics.text.wordings import FOREIGN, HELD_OUT

LIVER, HOOK, TOOL, GALL, FAT = map(Noun, ("liver", "hook", "grasper", "gallbladder", "fat"))
READ = {
    "the vessel left of the gallbladder": Related(Noun("the vessel"), "left of", Noun("the gallbladder")),
    "grasper touching liver": Related(TOOL, "touching", LIVER),
    "is the grasper in contact with the liver?": Related(Noun("is the grasper"), "touching", Noun("the liver")),
    "grasper not touching liver": Related(TOOL, "touching", LIVER, True),
    "grasper that does not touch liver": Related(Noun("grasper that does"), "touching", LIVER, True),
    "liver or gallbladder": AnyOf((LIVER, GALL)),
    "liver and gallbladder or fat": AnyOf((AllOf((LIVER, GALL)), FAT)),
    "liver and (gallbladder or fat)": AllOf((LIVER, AnyOf((GALL, FAT)))),
    "liver or gallbladder but not fat": ButNot(AnyOf((LIVER, GALL)), FAT),
    "grasper but not grasper touching liver": ButNot(TOOL, Related(TOOL, "touching", LIVER)),
    "grasper touching liver or gallbladder": Related(TOOL, "touching", AnyOf((LIVER, GALL))),
    "grasper touching liver and gallbladder": Related(Related(TOOL, "touching", LIVER), "touching", GALL),
    "grasper touching liver and near fat": Related(Related(TOOL, "touching", LIVER), "near", FAT),
    "grasper touching liver or near fat": AnyOf((Related(TOOL, "touching", LIVER), Related(TOOL, "near", FAT))),
    "grasper touching liver and not near fat": Related(Related(TOOL, "touching", LIVER), "near", FAT, True),
    "grasper touching liver and hook touching fat": AllOf((Related(TOOL, "touching", LIVER), Related(HOOK, "touching", FAT))),
    "fat between liver and gallbladder": Related(FAT, "between", AnyOf((LIVER, GALL))),
    "largest fat left of liver": Extreme(Related(FAT, "left of", LIVER), True),
    "liver left of smallest fat": None,
    "liver left of (smallest fat)": Related(LIVER, "left of", Extreme(FAT, False)),
    "Leber links von der Gallenblase": Related(Noun("Leber"), "left of", Noun("der Gallenblase")),
    "foie a gauche de la vésicule": Related(Noun("foie"), "left of", Noun("la vésicule")),
    "hígado cerca de la vesícula biliar": Related(Noun("hígado"), "near", Noun("la vesícula biliar")),
    "肝脏和胆囊": AllOf((Noun("肝脏"), Noun("胆囊"))),
}
TIMED = {
    "first hook": Question(HOOK, (Moments("first"),)),
    "when does grasper first touch liver": Question(Related(Noun("does grasper"), "touching", LIVER), (Moments("first"),)),
    "hook for the last time": Question(HOOK, (Moments("last"),)),
    "where is the hook at its largest": Question(Noun("where is the hook"), (Moments("largest"),)),
    "hook when smallest": Question(HOOK, (Moments("smallest"),)),
    "liver when hook": Question(LIVER, (Moments("when", Question(HOOK)),)),
    "liver while no hook": Question(LIVER, (Moments("when not", Question(HOOK)),)),
    "liver before first hook": Question(LIVER, (Moments("before", Question(HOOK, (Moments("first"),))),)),
    "liver after hook near fat": Question(LIVER, (Moments("after", Question(Related(HOOK, "near", FAT))),)),
    "last liver after hook and before fat": Question(
        LIVER, (Moments("after", Question(HOOK)), Moments("before", Question(FAT)), Moments("last"))
    ),
    "when is no hook": Question(HOOK, absent=True),
    "when is liver": Question(Noun("is liver")),
}
WRONG = {
    "liver near": "A name is missing in 'liver near' after 'liver near'.",
    "left of liver": "A name is missing in 'left of liver' at its beginning.",
    "(liver or fat": "opens a parenthesis that is not closed again.",
    "liver) or fat": "cannot be read from '\\) or fat' on",
    "liver left of smallest fat": "A name is missing",
    "liver when": "A name is missing",
}


@pytest.mark.parametrize("text", [text for text, read in READ.items() if read is not None])
def test_relations(text):
    assert read_question(text) == Question(READ[text])


@pytest.mark.parametrize("text", TIMED)
def test_times(text):
    assert read_question(text) == TIMED[text]


@pytest.mark.parametrize("text", WRONG)
def test_what_cannot_be_read_is_said(text):
    with pytest.raises(PromptError, match=WRONG[text]):
        read_question(text)


def test_what_is_no_question_stays_as_it_was():
    """Every wording of the vocabulary, and what people typed before there were questions; but for one, which asks what lies between."""
    wordings = [wording for concept in surgical_vocabulary().concepts for wording in concept.wordings]
    typed = [text for texts in HELD_OUT.values() for text in texts if text != "connective tissues between liver and gallbladder"]
    for text in (
        *wordings,
        *typed,
        *FOREIGN[:-2],
        "not",
        "not liver",
        "tool, not grasper, scissors or hook",
        "show and mark the liver",
        "",
    ):
        assert read_question(text) == Question(Noun(text))
        assert read_question(text).plain


def test_names_of_classes_and_quotes_are_never_taken_apart():
    assert read_question("Before_and after", ("before and after",)).plain
    read = read_question('"left of nothing" near hook and eye', ("hook and eye",))
    assert read.what == Related(Noun('"left of nothing"'), "near", Noun("hook and eye"))


ALONE = ("first", "last", "largest", "smallest")


def test_every_wording_of_a_joining_word_joins():
    data = json.loads((ROOT / "engine/vocabulary/joining.json").read_text(encoding="utf-8"))
    del data["about"]
    for kind, languages in data.items():
        for wording in [wording for wordings in languages.values() for wording in wordings]:
            assert not read_question(f"liver {wording}" if kind in ALONE else f"liver {wording} fat").plain, (kind, wording)


def test_the_nouns_of_a_question():
    question = read_question("grasper touching liver or hook before fat when gallbladder near hook")
    assert nouns_of(question) == ("grasper", "liver", "hook", "fat", "gallbladder")
    assert heads(question.what) == ("grasper",)
    assert heads(read_question("grasper near liver or hook near fat").what) == ("grasper", "hook")


PIECES = st.sampled_from(
    ["liver", "hook", "left of", "near", "and", "or", "not", "(", ")", "first", "largest", "when", "before", "between", "is", ",", '"', "x"]
)


@given(st.lists(PIECES, max_size=14))
def test_any_words_are_read_or_refused(pieces):
    with contextlib.suppress(PromptError):
        nouns_of(read_question(" ".join(pieces)))

"""Free text reaches the right concept, and foreign words reach none."""

import itertools

import pytest

from degense.engine.errors import PromptError
from degense.engine.vocabulary.concepts import Concept, Vocabulary, surgical_vocabulary
from degense.engine.vocabulary.spelling import edit_distance

WORDINGS = {
    "liver": [
        "liver", "the liver", "Livers", "hepatic tissue", "liver parenchyma",
        "LIVER!", "livre", "lver", "left lobe of the liver", "surface of the liver",
    ],
    "gallbladder": [
        "gall bladder", "gall-bladder", "galbladder", "gallblader",
        "show me the gallbladder", "where is the gallbladder?", "GB", "gallblatter",
    ],
    "fat": ["fat", "fatty tissue", "adipose tissue", "the omentum", "mesentery", "fat around the gallbladder"],
    "abdominal wall": ["abdominal wall", "abdominal_wall", "abdomnal wall", "wall of the abdomen", "abdominal-wall"],
    "gastrointestinal tract": ["gi_tract", "GI tract", "gastrointestinal tract", "bowel", "the gut", "gastrointestnal tract"],
    "connective tissue": ["connective tissue", "conective tisue", "fascia"],
    "blood": ["blood", "bleeding", "haemorrhage", "hemorrhage", "a blood clot", "bleeding on the liver"],
    "cystic duct": ["cystic duct", "the cystic dct", "cystic ducts"],
    "cystic artery": ["cystic artery", "cystic arteries"],
    "hepatic vein": ["hepatic vein", "hepatic vien"],
    "liver ligament": ["ligament", "falciform ligament", "liver ligament"],
    "kidney parenchyma": ["kidney-parenchyma", "renal parenchyma"],
    "covered kidney": ["covered-kidney"],
    "small intestine": ["small-intestine", "small bowel"],
    "charred tissue": [
        "charred tissue", "burnt tissue", "burned area of the tissue",
        "charring", "cauterised tissue", "cauterized tissue",
    ],
    "background": ["black background", "background"],
    "smoke": ["smoke", "the smoke please"],
    "specular highlight": ["specular", "glare", "specular reflections"],
    "instrument": ["tool", "tools", "all instruments", "surgical instruments", "instrumnt", "any tool"],
    "grasper": [
        "grasper", "graspers", "graspr",
        "the tip of the grasper", "forceps", "grasping forceps", "the grasper holding the gallbladder",
    ],
    "L-hook electrocautery": [
        "hook", "the hook", "L-hook", "l hook", "Lhook",
        "L-hook Electrocautery", "cautery", "electrocautry", "diathermy", "highlight the hook",
    ],
    "clipper": ["clipper", "clip applier"],
    "scissors": ["scissors", "scissor", "sissors", "shears"],
    "bipolar": ["bipolar", "bipolar forceps"],
    "irrigator": ["irrigator", "irigator"],
    "suction instrument": ["suction", "suction-instrument", "sucker"],
    "instrument shaft": ["instrument-shaft", "shaft of the tool", "shaft"],
    "instrument wrist": ["instrument-wrist", "wrist"],
    "instrument clasper": ["instrument-clasper", "jaws", "jaws of the instrument"],
    "needle": ["needle", "suturing-needle", "needel"],
    "thread": ["thread", "sutures"],
    "clamp": ["clamps", "bulldog clamp"],
    "ultrasound probe": ["ultrasound-probe", "ultrasound prob", "US probe"],
    "specimen bag": ["SpecimenBag", "specimen bag"],
    "organ": ["organ", "organs"],
    "vessel": ["blood vessels", "vessel"],
    "kidney": ["kidney", "kidnees", "kidny"],
}  # fmt: skip

FOREIGN = [
    "banana", "airplane", "car", "dog", "table", "unicorn", "quantum", "spaceship", "guitar", "river", "heart", "lever", "brain",
    "elephant", "window", "keyboard", "pizza", "mountain", "umbrella", "bicycle", "football",
]  # fmt: skip

DATASETS = {
    "CholecSeg8k": [
        "Black Background", "Abdominal Wall", "Liver", "Gastrointestinal Tract",
        "Fat", "Grasper", "Connective Tissue", "Blood", "Cystic Duct",
        "L-hook Electrocautery", "Gallbladder", "Hepatic Vein", "Liver Ligament",
    ],
    "EndoVis18": [
        "background-tissue", "instrument-shaft", "instrument-clasper",
        "instrument-wrist", "kidney-parenchyma", "covered-kidney", "thread",
        "clamps", "suturing-needle", "suction-instrument", "small-intestine", "ultrasound-probe",
    ],
    "phantom": [
        "liver", "gallbladder", "fat", "abdominal wall",
        "connective tissue", "grasper", "L-hook electrocautery", "charred tissue", "background",
    ],
}  # fmt: skip


def resolved(text):
    try:
        return surgical_vocabulary().resolve(text)
    except PromptError:
        return None


def test_wordings_reach_their_concept():
    pairs = [(wording, concept) for concept, wordings in WORDINGS.items() for wording in wordings]
    wrong = [(wording, concept, resolved(wording)) for wording, concept in pairs if resolved(wording) != concept]
    assert len(pairs) >= 60
    assert len(wrong) <= 0.05 * len(pairs), wrong


@pytest.mark.parametrize("word", FOREIGN)
def test_foreign_words_are_errors_that_name_the_word(word):
    with pytest.raises(PromptError, match=f"'{word}' is not in the vocabulary; nearest are "):
        surgical_vocabulary().resolve(f"the {word}")


def test_a_foreign_word_beside_a_known_one_is_not_ignored():
    with pytest.raises(PromptError, match="'purple'"):
        surgical_vocabulary().resolve("purple liver")


def test_two_things_in_one_prompt_are_named():
    with pytest.raises(PromptError, match="liver and gallbladder; prompt them one at a time"):
        surgical_vocabulary().resolve("liver and gallbladder")


@pytest.mark.parametrize("text", ["", "   ", "!?", "肝臓", "the", "show me"])
def test_prompts_that_say_nothing_are_errors(text):
    with pytest.raises(PromptError):
        surgical_vocabulary().resolve(text)


def test_long_prompts_are_answered_quickly_and_shortly():
    with pytest.raises(PromptError) as caught:
        surgical_vocabulary().resolve("x" * 100_000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("dataset", DATASETS)
def test_class_names_of_datasets_are_exact(dataset):
    concepts = [surgical_vocabulary().exact(name) for name in DATASETS[dataset]]
    assert None not in concepts
    assert len(set(concepts)) == len(concepts)


def test_every_wording_finds_its_own_concept():
    vocabulary = surgical_vocabulary()
    for concept in vocabulary.concepts:
        for wording in concept.wordings:
            assert vocabulary.known(wording) == concept.name
            assert vocabulary.resolve(wording) == concept.name
        for wording in () if concept.later else (concept.name, *concept.also):
            assert vocabulary.exact(wording) == concept.name


def test_wholes_come_before_their_parts_and_names_are_unique():
    seen = set()
    for concept in surgical_vocabulary().concepts:
        assert concept.of is None or concept.of in seen
        assert concept.name not in seen
        seen.add(concept.name)


def test_ancestors_climb_to_the_root():
    assert surgical_vocabulary().ancestors("hepatic vein") == ["vein", "vessel", "tissue"]


def test_completion_offers_the_session_first():
    vocabulary = surgical_vocabulary()
    assert vocabulary.complete("g", ["grasper", "foo"])[0] == "grasper"
    assert "gallbladder" in vocabulary.complete("GALL")
    assert "cystic duct" in vocabulary.complete("duc")
    assert vocabulary.complete("", ["foo"])[:2] == ["foo", "background"]
    assert vocabulary.complete("fo", ["foo"])[0] == "foo"
    assert vocabulary.complete("zzz") == []


def test_a_misspelling_between_two_concepts_is_no_match():
    vocabulary = Vocabulary([Concept("planet"), Concept("plaget")])
    assert vocabulary.resolve("planett") == "planet"
    with pytest.raises(PromptError):
        vocabulary.resolve("plaxet")


def slow_distance(a: str, b: str) -> int:
    """The textbook recursion."""
    if not a or not b:
        return len(a) + len(b)
    best = min(slow_distance(a[1:], b) + 1, slow_distance(a, b[1:]) + 1, slow_distance(a[1:], b[1:]) + (a[0] != b[0]))
    if len(a) > 1 and len(b) > 1 and a[0] == b[1] and a[1] == b[0]:
        best = min(best, slow_distance(a[2:], b[2:]) + 1)
    return best


def test_edit_distance_matches_the_recursion():
    texts = ["".join(letters) for size in range(4) for letters in itertools.product("ab", repeat=size)] + ["acbd", "abcd"]
    for a, b in itertools.product(texts, texts):
        assert edit_distance(a, b) == slow_distance(a, b)


@pytest.mark.parametrize(
    ("text", "pairs"),
    [
        ("graspr", [("graspr", "grasper")]),
        ("galbladder and livr", [("galbladder", "gallbladder"), ("livr", "liver")]),
        ("tool, not graspr", [("graspr", "grasper")]),
        ("the Livers", []),
        ("haemorrhage", []),
        ("unicorn", []),
    ],
)
def test_corrected_misspellings_are_told(text, pairs):
    assert surgical_vocabulary().corrections(text) == pairs

"""The geometry of the embedded text space."""

import subprocess
import sys

import numpy as np
import pytest

from degense.engine.errors import PromptError
from degense.engine.semantics.text.encoder import EmbeddedEncoder
from degense.engine.vocabulary.concepts import surgical_vocabulary

PHANTOM = [
    "liver",
    "gallbladder",
    "fat",
    "abdominal wall",
    "connective tissue",
    "grasper",
    "L-hook electrocautery",
    "charred tissue",
    "background",
]


def cosines(encoder, text, classes):
    return encoder.encode(classes) @ encoder.encode([text])[0]


def test_rows_are_unit_float32():
    encoder = EmbeddedEncoder(["foo"])
    rows = encoder.encode([*PHANTOM, "tool", "organ", "foo"])
    assert rows.shape == (12, encoder.dimension)
    assert rows.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-6)
    assert encoder.encode([]).shape == (0, encoder.dimension)


def test_cosines_follow_the_tree():
    vocabulary = surgical_vocabulary()
    names = [concept.name for concept in vocabulary.concepts]
    gram = EmbeddedEncoder().encode(names).astype(float)
    gram = gram @ gram.T
    for i, a in enumerate(names):
        for j, b in enumerate(names):
            # oracle: climb from both to the nearest common ancestor; each step multiplies by √share of the ancestor reached
            line_a, line_b = [a, *vocabulary.ancestors(a)], [b, *vocabulary.ancestors(b)]
            common = next((x for x in line_a if x in line_b), None)
            expected = 0.0
            if common is not None:
                steps = line_a[1 : line_a.index(common) + 1] + line_b[1 : line_b.index(common) + 1]
                expected = np.prod([np.sqrt(vocabulary.by_name[x].share) for x in steps])
            assert gram[i, j] == pytest.approx(expected, abs=1e-6)


def test_strangers_are_far_and_kin_is_near():
    encoder = EmbeddedEncoder()
    matrix = encoder.encode(PHANTOM)
    gram = matrix @ matrix.T
    off = gram - np.diag(np.diag(gram))
    assert off.max() < 0.36
    assert gram[0, 7] < 0.03  # liver and charred tissue
    assert gram[5, 6] == pytest.approx(0.35, abs=1e-5)  # two instruments


def test_a_kind_means_the_sessions_members_alike():
    encoder = EmbeddedEncoder(PHANTOM)
    scores = cosines(encoder, "all tools", PHANTOM)
    assert scores[5] == pytest.approx(scores[6], abs=1e-5)
    assert scores[5] > 0.8
    assert np.abs(np.delete(scores, [5, 6])).max() < 0.05
    assert cosines(encoder, "organ", PHANTOM)[:2].min() > 0.7
    np.testing.assert_array_equal(encoder.expand("tool"), encoder.encode(["grasper", "L-hook electrocautery"]))
    assert encoder.expand("tissue").shape[0] == 6
    assert encoder.exclude("tool").shape == (0, 128)
    np.testing.assert_array_equal(encoder.expand("the hook"), encoder.encode(["hook"]))


def test_without_a_session_a_kind_is_its_own_vector():
    assert cosines(EmbeddedEncoder(), "instrument", ["grasper", "liver"]) == pytest.approx([np.sqrt(0.35), 0.0], abs=1e-6)


def test_literal_classes_are_promptable_by_name_only():
    classes = ["liver", "foo", "Widget_7", "肝"]
    encoder = EmbeddedEncoder().with_classes(classes)
    assert encoder.literal == ("foo", "Widget_7", "肝")
    gram = encoder.encode(classes) @ encoder.encode(classes).T
    np.testing.assert_allclose(gram, np.eye(4), atol=1e-6)
    np.testing.assert_array_equal(encoder.encode(["the Foo", "widget 7"]), encoder.encode(["foo", "Widget_7"]))
    with pytest.raises(PromptError, match="nearest are foo"):
        encoder.encode(["fooo"])
    with pytest.raises(PromptError):
        EmbeddedEncoder().encode(["foo"])
    with pytest.raises(PromptError) as caught:
        encoder.encode(["x" * 100_000])
    assert len(str(caught.value)) < 200


def test_many_literal_classes_stay_apart():
    names = [f"class number {i} of many" for i in range(200)]
    gram = EmbeddedEncoder(names).encode(names).astype(float)
    gram = gram @ gram.T - np.eye(200)
    np.testing.assert_allclose(gram[:32, :32], 0.0, atol=1e-5)
    assert np.abs(gram).max() < 0.95


def test_classes_that_mean_the_same_stay_apart():
    encoder = EmbeddedEncoder(["omentum", "Fat"])
    a, b = encoder.encode(["omentum", "Fat"])
    assert abs(a @ b) < 1e-6
    assert encoder.literal == ("omentum",)
    np.testing.assert_array_equal(encoder.encode(["adipose tissue"])[0], b)


def test_a_misspelt_class_name_is_literal_but_a_prompt_may_be_misspelt():
    encoder = EmbeddedEncoder(["livre", "gallbladder"])
    assert encoder.literal == ("livre",)
    np.testing.assert_array_equal(encoder.encode(["galbladder"]), encoder.encode(["gallbladder"]))


def test_vectors_do_not_depend_on_the_process():
    code = "from degense.engine.semantics.text.encoder import EmbeddedEncoder as E; import hashlib; "
    code += "print(hashlib.sha256(E(['foo','liver']).encode(['foo','liver','tool']).tobytes()).hexdigest())"
    digests = {
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env={"PYTHONHASHSEED": s}).stdout
        for s in "12"
    }
    assert len(digests) == 1


def test_completion_knows_the_classes():
    assert EmbeddedEncoder(["foo", "liver"]).complete("")[:2] == ["foo", "liver"]


def test_what_is_excluded_is_no_longer_meant():
    encoder = EmbeddedEncoder([*PHANTOM, "foo"])
    for text in ("tool, not grasper", "instrument ohne Fasszange", "器械，不是抓钳"):
        np.testing.assert_array_equal(encoder.expand(text), encoder.encode(["hook"]))
        np.testing.assert_array_equal(encoder.exclude(text), encoder.encode(["grasper"]))
    assert encoder.expand("tissue, except liver, fat or the gallbladder").shape[0] == 3
    np.testing.assert_array_equal(encoder.exclude("liver but not foo"), encoder.encode(["foo"]))
    with pytest.raises(PromptError, match="says only what it does not mean"):
        encoder.expand("not liver")
    with pytest.raises(PromptError, match="leaves nothing"):
        encoder.expand("grasper, not tool")
    with pytest.raises(PromptError, match="'banana' is not in the vocabulary"):
        encoder.expand("liver, not banana")


def test_names_of_other_languages_find_classes_and_change_no_vector():
    encoder = EmbeddedEncoder(["Leber", "gallbladder", "oedema"])
    assert encoder.literal == ("Leber", "oedema")
    np.testing.assert_array_equal(encoder.encode(["liver", "foie", "肝脏"]), encoder.encode(["Leber"] * 3))
    np.testing.assert_array_equal(encoder.encode(["swelling"]), encoder.encode(["oedema"]))
    assert abs(EmbeddedEncoder().encode(["liver"])[0] @ encoder.encode(["Leber"])[0]) < 1e-6

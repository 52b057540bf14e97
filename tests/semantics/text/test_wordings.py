"""Free text reaches the class that is meant, in words that no table was tuned on; words that name nothing reach none."""

from __future__ import annotations

import numpy as np
import pytest

from degense.engine.errors import PromptError
from degense.engine.semantics import EmbeddedEncoder, fit_basis
from degense.engine.semantics.masks import FrameSemantics
from degense.engine.vocabulary.concepts import surgical_vocabulary
from tests.semantics.masks.scenes import mask_of
from tests.semantics.text.wordings import FOREIGN, HELD_OUT

CLASSES = tuple(HELD_OUT)
SIDE = 24  # pixels of a class's square

#: The classes of the two data sets in German, French, Spanish and Chinese, as their papers' authors would say.
ABROAD = {
    "background": "Hintergrund, arrière-plan, fondo, 背景",
    "abdominal wall": "Bauchwand, paroi abdominale, pared abdominal, 腹壁",
    "liver": "Leber, foie, hígado, 肝脏",
    "gastrointestinal tract": "Gastrointestinaltrakt, tractus gastro-intestinal, tracto gastrointestinal, 胃肠道",
    "fat": "Fett, graisse, grasa, 脂肪",
    "grasper": "Fasszange, pince à préhension, pinza de agarre, 抓钳",
    "connective tissue": "Bindegewebe, tissu conjonctif, tejido conectivo, 结缔组织",
    "blood": "Blut, sang, sangre, 血液",
    "cystic duct": "Ductus cysticus, canal cystique, conducto cístico, 胆囊管",
    "L-hook electrocautery": "L-Haken, crochet en L, gancho en L, L型电凝钩",
    "gallbladder": "Gallenblase, vésicule biliaire, vesícula biliar, 胆囊",
    "hepatic vein": "Lebervene, veine hépatique, vena hepática, 肝静脉",
    "liver ligament": "Leberband, ligament du foie, ligamento hepático, 肝韧带",
    "background tissue": "Hintergrundgewebe, tissu d'arrière-plan, tejido de fondo, 背景组织",
    "instrument shaft": "Instrumentenschaft, tige de l'instrument, vástago del instrumento, 器械杆",
    "instrument clasper": "Instrumentengreifer, mors de l'instrument, mordaza del instrumento, 器械钳口",
    "instrument wrist": "Instrumentengelenk, poignet de l'instrument, muñeca del instrumento, 器械腕部",
    "kidney parenchyma": "Nierenparenchym, parenchyme rénal, parénquima renal, 肾实质",
    "covered kidney": "bedeckte Niere, rein couvert, riñón cubierto, 被覆盖的肾脏",
    "thread": "Faden, fil, hilo, 缝线",
    "clamp": "Klemme, clamp, clamp, 夹子",
    "needle": "Nadel, aiguille, aguja, 缝合针",
    "suction instrument": "Sauger, aspirateur, aspirador, 吸引器",
    "small intestine": "Dünndarm, intestin grêle, intestino delgado, 小肠",
    "ultrasound probe": "Ultraschallsonde, sonde échographique, sonda de ultrasonido, 超声探头",
}


@pytest.fixture(scope="module")
def asked() -> tuple[FrameSemantics, EmbeddedEncoder, np.ndarray]:
    """A picture with one square of each class, its encoder, and the true labels."""
    encoder = EmbeddedEncoder(CLASSES)
    labels = np.repeat(np.repeat(np.arange(9).reshape(3, 3), SIDE, 0), SIDE, 1)
    vectors = encoder.encode(CLASSES)
    basis = fit_basis(vectors, np.ones(len(vectors)))
    rgb = np.stack([20 * labels + 40, 200 - 15 * labels, 90 + 0 * labels], -1).astype(np.uint8)
    return FrameSemantics(rgb, basis.project(vectors)[labels], basis), encoder, labels


def answer(asked: tuple[FrameSemantics, EmbeddedEncoder, np.ndarray], text: str) -> np.ndarray | None:
    query, encoder, _ = asked
    try:
        meant, excluded = encoder.expand(text), encoder.exclude(text)
    except PromptError:
        return None
    return mask_of(query, meant, classes=encoder.encode(encoder.classes), excluded=excluded)


def test_free_text_reaches_the_right_mask(asked):
    pairs = [(text, label) for label, name in enumerate(CLASSES) for text in HELD_OUT[name]]
    wrong = [
        text
        for text, label in pairs
        if (mask := answer(asked, text)) is None or (mask & (asked[2] == label)).sum() < 0.95 * (mask | (asked[2] == label)).sum()
    ]
    assert len(pairs) >= 60
    assert len(wrong) <= 0.05 * len(pairs), wrong


def test_foreign_words_give_no_mask(asked):
    assert len(FOREIGN) >= 20
    assert not [text for text in FOREIGN if answer(asked, text) is not None]


@pytest.mark.parametrize("concept", ABROAD)
def test_classes_of_the_data_sets_are_known_abroad(concept):
    assert [surgical_vocabulary().resolve(text) for text in ABROAD[concept].split(", ")] == [concept] * 4


@pytest.mark.parametrize(
    ("british", "american"),
    [("haemorrhage", "hemorrhage"), ("oesophagus", "esophagus"), ("cauterised tissue", "cauterized tissue"), ("tumours", "tumors"),
     ("ischaemic tissue", "ischemic tissue"), ("caecum", "cecum")],
)  # fmt: skip
def test_both_sides_of_the_atlantic(british, american):
    vocabulary = surgical_vocabulary()
    assert vocabulary.resolve(british) == vocabulary.resolve(american)


def test_a_name_belongs_to_one_concept_in_all_languages():
    from degense.engine.vocabulary.spelling import key

    owners: dict[str, set[str]] = {}
    for concept in surgical_vocabulary().concepts:
        for wording in concept.wordings:
            owners.setdefault(key(wording), set()).add(concept.name)
    assert not {wording: names for wording, names in owners.items() if len(names) > 1}

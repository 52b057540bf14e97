"""From words to vectors, from label maps to training targets, and from long vectors to short ones."""

from engine.language.basis import Basis, fit_basis
from engine.language.encoder import EmbeddedEncoder, TextEncoder, encoder_by_name
from engine.language.teachers import LabelTeacher, Targets, Teacher
from engine.language.vocabulary import Vocabulary, surgical_vocabulary

__all__ = [
    "Basis",
    "EmbeddedEncoder",
    "LabelTeacher",
    "Targets",
    "Teacher",
    "TextEncoder",
    "Vocabulary",
    "encoder_by_name",
    "fit_basis",
    "surgical_vocabulary",
]

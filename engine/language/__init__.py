"""From words to vectors, from label maps to training targets, and from long vectors to short ones."""

from engine.language.basis import Basis, fit_basis
from engine.language.embedded import EmbeddedEncoder
from engine.language.encoder import TextEncoder
from engine.language.kept import keep_encoder, open_encoder
from engine.language.teachers import LabelTeacher, Targets, Teacher
from engine.language.text_vectors import TextVectors
from engine.language.vocabulary import Vocabulary, surgical_vocabulary

__all__ = [
    "Basis",
    "EmbeddedEncoder",
    "LabelTeacher",
    "Targets",
    "Teacher",
    "TextEncoder",
    "TextVectors",
    "Vocabulary",
    "fit_basis",
    "keep_encoder",
    "open_encoder",
    "surgical_vocabulary",
]

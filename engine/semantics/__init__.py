"""From words to vectors, from label maps to training targets, and from long vectors to short ones."""

from degense.engine.semantics.teachers import LabelTeacher, Targets, Teacher
from degense.engine.semantics.basis import Basis, fit_basis
from degense.engine.semantics.text.embedded import EmbeddedEncoder
from degense.engine.semantics.text.encoder import TextEncoder
from degense.engine.semantics.text.run_encoder import keep_encoder, open_encoder
from degense.engine.semantics.text.text_vectors import TextVectors
from degense.engine.semantics.text.vocabulary import Vocabulary, surgical_vocabulary

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

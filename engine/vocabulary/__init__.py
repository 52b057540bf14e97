"""What words name: the surgical vocabulary, without vectors."""

from degense.engine.vocabulary.concepts import Concept, Vocabulary, instruments, surgical_vocabulary

__all__ = ["Concept", "Vocabulary", "instruments", "surgical_vocabulary"]

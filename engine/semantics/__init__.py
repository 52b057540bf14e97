"""From words to vectors, from label maps to training targets, and from similarities to masks."""

from degense.engine.semantics.basis import Basis, fit_basis
from degense.engine.semantics.text.encoder import EmbeddedEncoder, TextEncoder
from degense.engine.semantics.text.text_vectors import TextVectors, open_encoder, save_encoder

__all__ = ["Basis", "EmbeddedEncoder", "TextEncoder", "TextVectors", "fit_basis", "open_encoder", "save_encoder"]

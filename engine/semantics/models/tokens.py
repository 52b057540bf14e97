"""What a tokenizer makes of texts, checked against the model that is beside it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torch import Tensor

from degense.engine.errors import DegenseError

NOT_ITS_OWN = "The tokenizer is damaged, or not the one of the model that lies beside it; download the model anew."


def tokenized(tokenizer: Any, texts: Sequence[str], config: Any, names: Sequence[str], **options: Any) -> dict[str, Tensor]:
    """What is called `names`, "input_ids" among them, int [n, T], for a model of transformers of that `config`.

    DegenseError when the tokenizer gives none, or tokens or places that the model does not have.
    """
    try:
        made = tokenizer(list(texts), truncation=True, return_tensors="pt", **options)
        found = {name: made[name] for name in names}
    except Exception as error:  # of the package tokenizers, which has no class of its own for them
        raise DegenseError(NOT_ITS_OWN) from error
    sizes, ids = config.get_text_config(), found["input_ids"]
    if ids.numel() == 0 or int(ids.max()) >= sizes.vocab_size or ids.shape[1] > getattr(sizes, "max_position_embeddings", ids.shape[1]):
        raise DegenseError(NOT_ITS_OWN)
    return found

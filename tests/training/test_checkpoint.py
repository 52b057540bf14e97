"""A checkpoint that is damaged is refused in a sentence, whatever its values are."""

from __future__ import annotations

import pytest
import torch

from degense.engine.errors import RunError
from degense.engine.store.files import read_json, write_json
from degense.engine.training.checkpoint import PARTS, load_checkpoint, save_checkpoint


@pytest.mark.parametrize("change", [{"iteration": "7"}, {"early": 3}, {"early": {"skipped": "x"}}, {"early": {}}])
def test_values_that_no_trainer_left(tmp_path, change):
    parts = {part: {"a": torch.ones(2), "disagreement": torch.zeros(())} for part in PARTS}
    save_checkpoint(tmp_path, parts | {"generator": torch.zeros(4, dtype=torch.uint8), "plain": {"iteration": 7}})
    assert load_checkpoint(tmp_path)["plain"]["iteration"] == 7
    write_json(tmp_path / "last.json", read_json(tmp_path / "last.json") | change)
    with pytest.raises(RunError, match=r"last\.json"):
        load_checkpoint(tmp_path)


def test_a_consensus_that_lacks_what_it_is_made_of(tmp_path):
    parts = {part: {"a": torch.ones(2)} for part in PARTS}
    save_checkpoint(tmp_path, parts | {"generator": torch.zeros(4, dtype=torch.uint8), "plain": {"iteration": 7}})
    with pytest.raises(RunError, match="damaged"):
        load_checkpoint(tmp_path)

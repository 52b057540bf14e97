"""The script that turns checkpoints into safetensors: tiny random ones in the forms of SurgVLP's and CAT-Seg's, and hostile ones."""

import os
import runpy
import sys
from collections import OrderedDict

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file

from tests.house.source import ROOT

SCRIPT = ROOT / "scripts" / "checkpoint-to-safetensors"


def tiny():
    torch.manual_seed(0)
    return torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.BatchNorm2d(4), torch.nn.Flatten(), torch.nn.Linear(4, 2))


@pytest.fixture
def convert(monkeypatch):
    """The script with these arguments."""

    def run(*arguments) -> None:
        monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
        runpy.run_path(str(SCRIPT))["main"]()

    return run


@pytest.mark.parametrize("form", ["surgvlp", "catseg", "several GPUs", "tied"])
def test_weights_come_back_by_name(convert, tmp_path, capsys, form):
    model, again = tiny(), tiny()
    state = model.state_dict()
    torch.save(
        {
            "surgvlp": OrderedDict(state),
            "catseg": {
                "model": state,
                "optimizer": {"state": {0: {"step": torch.ones(1)}}, "param_groups": [{"lr": 1e-4}]},
                "iteration": 9,
            },
            "several GPUs": {"state_dict": {f"module.{name}": value for name, value in state.items()}, "epoch": 3},
            "tied": {**state, "3.weight": state["3.weight"].T.contiguous().T},
        }[form],
        tmp_path / "in.pth",
    )
    convert(tmp_path / "in.pth", tmp_path / "out.safetensors")
    assert f"{len(state)} tensors" in capsys.readouterr().out
    with torch.no_grad():
        again[0].weight.zero_()
    again.load_state_dict(load_file(tmp_path / "out.safetensors"))
    assert all(torch.equal(value, again.state_dict()[name]) for name, value in state.items())
    with safe_open(tmp_path / "out.safetensors", "pt") as opened:
        assert opened.metadata()["source"] == "in.pth"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.pth", "out.safetensors"]
    with pytest.raises(SystemExit, match="is there already"):
        convert(tmp_path / "in.pth", tmp_path / "out.safetensors")


class Hostile:
    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def test_a_checkpoint_that_would_run_is_refused_and_does_not_run(convert, tmp_path):
    torch.save({"model": tiny().state_dict(), "extra": Hostile(tmp_path / "ran")}, tmp_path / "in.pth")
    (tmp_path / "text.pth").write_text("no checkpoint")
    torch.save([1, 2], tmp_path / "list.pth")
    cases = {"in.pth": "holds more than numbers", "text.pth": "no checkpoint", "list.pth": "no tensors by name", "none.pth": "No such file"}
    for name, words in cases.items():
        with pytest.raises(SystemExit, match=words):
            convert(tmp_path / name, tmp_path / "out.safetensors")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.pth", "list.pth", "text.pth"]

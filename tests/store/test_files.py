"""Whole or absent, and hostile files answered in one sentence."""

import os

import pytest
import torch

from degense.engine.errors import DegenseError, RunError
from degense.engine.files import replacing
from degense.engine.splats import Splats
from degense.engine.store.files import PROPERTIES, SH0, finite, read_json, read_tensors, save_ply, write_json, write_tensors
from tests.fakes import ply_columns


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path):
    path = tmp_path / "a.json"
    write_json(path, {"kept": 1})
    with pytest.raises(ValueError, match="half way"), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text("{")
        raise ValueError("half way")
    assert read_json(path) == {"kept": 1}
    assert os.listdir(tmp_path) == ["a.json"]


def test_a_full_disk_is_said_in_words(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    path = tmp_path / "a.json"
    write_json(path, 1)
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(DegenseError, match=r"No space left on device.*untouched"):
        write_json(path, 2)
    assert read_json(path) == 1


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"\x80" * 100])
def test_damaged_files_are_one_sentence(tmp_path, content):
    path = tmp_path / "x"
    path.write_bytes(content)
    with pytest.raises(RunError, match="x"):
        read_tensors(path)
    with pytest.raises(RunError, match="x"):
        read_json(path)


def test_tensors_that_promise_more_than_the_file_holds(tmp_path):
    path = tmp_path / "x.safetensors"
    header = b'{"a":{"dtype":"F32","shape":[1000000000000],"data_offsets":[0,4000000000000]}}'
    path.write_bytes(len(header).to_bytes(8, "little") + header + b"\0" * 16)
    with pytest.raises(RunError, match="damaged"):
        read_tensors(path)


def test_numbers_that_are_not_numbers(tmp_path):
    path = tmp_path / "x.safetensors"
    write_tensors(path, {"a": torch.tensor([1.0, float("nan")])})
    with pytest.raises(RunError, match="not numbers"):
        finite(read_tensors(path), path)


def some_splats(count=7):
    torch.manual_seed(0)
    quats = torch.nn.functional.normalize(torch.randn(count, 4), dim=1)
    return Splats(
        torch.randn(count, 3),
        quats,
        torch.rand(count, 3) + 0.01,
        torch.rand(count) * 0.9 + 0.05,
        torch.rand(count, 3),
        torch.zeros(count, 0),
    )


def test_ply_comes_back_as_it_went(tmp_path):
    splats = some_splats()
    save_ply(tmp_path / "a.ply", splats)
    table = torch.from_numpy(ply_columns(tmp_path / "a.ply"))
    assert table.shape == (7, len(PROPERTIES))
    assert torch.allclose(table[:, :3], splats.means)
    assert torch.allclose(table[:, 3:6] * SH0 + 0.5, splats.colors, atol=1e-5)
    assert torch.allclose(table[:, 6].sigmoid(), splats.opacities, atol=1e-5)
    assert torch.allclose(table[:, 7:10].exp(), splats.scales, atol=1e-5)
    assert torch.allclose(table[:, 10:], splats.quats)

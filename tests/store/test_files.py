"""Whole or absent, and hostile files answered in one sentence."""

import json
import os

import pytest
import torch

from degense.engine.errors import DegenseError, RunError
from degense.engine.files import replacing, replacing_folder, write_text
from degense.engine.store.files import finite, read_json, read_tensors, write_json, write_tensors


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


@pytest.fixture
def told(monkeypatch):
    """What is synced and renamed, in the order in which it is; a handle by its file's name."""
    told: list[tuple[str, str]] = []
    fsync, replace = os.fsync, os.replace

    def name(handle: int) -> str:
        return os.path.basename(os.readlink(f"/proc/self/fd/{handle}"))

    monkeypatch.setattr(os, "fsync", lambda handle: (told.append(("sync", name(handle))), fsync(handle))[1])
    monkeypatch.setattr(os, "replace", lambda source, target: (told.append(("move", os.path.basename(target))), replace(source, target))[1])
    return told


def test_a_file_is_on_the_disk_before_its_name_and_the_name_before_we_go_on(tmp_path, told):
    write_json(tmp_path / "new" / "a.json", 1)
    assert told[0] == ("sync", tmp_path.name)  # the name of the folder that was made
    assert [kind for kind, _ in told[1:]] == ["sync", "move", "sync"]
    assert told[1][1].startswith(".a-")
    assert told[2:] == [("move", "a.json"), ("sync", "new")]


def test_a_folder_is_on_the_disk_with_all_that_is_in_it(tmp_path, told):
    with replacing_folder(tmp_path / "out") as folder:
        (folder / "inner").mkdir()
        (folder / "inner" / "a").write_text("1")
        (folder / "b").write_text("2")
    moved = told.index(("move", "out"))
    assert {name for kind, name in told[:moved] if kind == "sync"} >= {"a", "b", "inner"}
    assert told[moved + 1 :] == [("sync", tmp_path.name)]


def test_half_a_letter_of_a_name_is_written_and_read_again(tmp_path):
    name = os.fsdecode(b"clip-\xff")
    write_text(tmp_path / "a.json", json.dumps({"name": name, "half": "\ud800"}, ensure_ascii=False))
    assert read_json(tmp_path / "a.json") == {"name": name, "half": "\ud800"}

"""Check sums of a run: sha256sum reads them, ssh-keygen signs them, and a run that was changed is found by the command."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from degense.app.cli.main import main
from degense.app.session.sample import demo_run
from degense.engine.store.checksums import SUMS


@pytest.fixture
def run(tmp_path):
    return shutil.copytree(demo_run(), tmp_path / "run")


@pytest.fixture
def summed(run, capsys):
    assert main(["checksum", str(run)]) == 0
    assert "model.safetensors" in capsys.readouterr().out
    return run


def said_of(run, capsys) -> tuple[int, str]:
    """The exit status of `degense checksum RUN --check`, and what it says."""
    status = main(["checksum", str(run), "--check"])
    told = capsys.readouterr()
    return status, told.out + told.err


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_sha256sum_reads_them(summed):
    done = subprocess.run(["sha256sum", "--strict", "-c", SUMS], cwd=summed, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "model.safetensors: OK" in done.stdout
    (summed / "metrics.jsonl").write_text("{}\n")
    assert subprocess.run(["sha256sum", "-c", SUMS], cwd=summed, capture_output=True).returncode == 1


def test_a_run_that_is_looked_at_is_the_same_and_one_that_was_changed_is_not(summed, capsys):
    (summed / "session.json").write_text("{}")
    (summed / "annotations").mkdir(exist_ok=True)
    assert said_of(summed, capsys)[0] == 0
    data = bytearray((summed / "model.safetensors").read_bytes())
    data[-1] ^= 1
    (summed / "model.safetensors").write_bytes(data)
    status, words = said_of(summed, capsys)
    assert (status, words.count("\n")) == (2, 1)
    assert "model.safetensors is another" in words


def test_files_that_are_gone_or_came_later_are_named(summed, capsys):
    (summed / "metrics.jsonl").rename(summed / "observability.safetensors")
    status, words = said_of(summed, capsys)
    assert status == 2
    assert "metrics.jsonl is gone" in words
    assert "observability.safetensors came later" in words


@pytest.mark.parametrize("text", ["", "a  run.json\n", f"{'0' * 64}  ../../etc/passwd\n", f"{'0' * 64}  passwd\n", "\xff", "0" * 100_000])
def test_what_is_no_list_of_check_sums_is_refused(run, capsys, text):
    (run / SUMS).write_text(text, encoding="latin-1")
    status, words = said_of(run, capsys)
    assert (status, words.count("\n")) == (2, 1)
    assert SUMS in words


def test_a_run_without_them_or_unfinished_is_a_sentence(run, capsys):
    assert "degense checksum" in said_of(run, capsys)[1]
    info = json.loads((run / "run.json").read_text(encoding="utf-8"))
    (run / "run.json").write_text(json.dumps({**info, "state": "stopped"}), encoding="utf-8")
    assert main(["checksum", str(run)]) == 2
    assert "not finished" in capsys.readouterr().err
    assert not (run / SUMS).exists()


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="needs ssh-keygen")
def test_they_are_signed_and_verified_as_the_threat_model_says(summed, tmp_path):
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "", "-f", key], check=True)
    kind, public = key.with_suffix(".pub").read_text().split()[:2]
    (tmp_path / "signers").write_text(f"me@example.org {kind} {public}\n")
    subprocess.run(["ssh-keygen", "-q", "-Y", "sign", "-f", key, "-n", "degense", summed / SUMS], check=True, capture_output=True)
    verify = [
        "ssh-keygen",
        "-Y",
        "verify",
        "-f",
        tmp_path / "signers",
        "-I",
        "me@example.org",
        "-n",
        "degense",
        "-s",
        summed / f"{SUMS}.sig",
    ]
    good = (summed / SUMS).read_bytes()
    assert subprocess.run(verify, input=good, capture_output=True).returncode == 0
    assert subprocess.run(verify, input=good.replace(b"0", b"1"), capture_output=True).returncode != 0

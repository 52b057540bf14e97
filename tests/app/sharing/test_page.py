"""A shared page: what it holds, that it asks nothing of a network, and what a browser shows of it."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path

import numpy as np
import pytest

from degense.app.cli.main import main
from degense.app.features.share.page import share
from degense.app.session.sample import demo_run
from degense.engine.errors import DegenseError, PromptError
from degense.engine.progress import finish
from degense.engine.scene import Scene
from degense.engine.semantics.prompts import PromptSet
from degense.widgets.splats.camera_moves import orbit
from tests import browser

ALL = PromptSet(())
PANEL = 270  # pixels at the left, which the panel of the page covers


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.open(demo_run(), device="cpu")


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("page") / "demo.html"
    assert main(["share", str(demo_run()), "--out", str(out)]) == 0
    return out


def unpacked(page: Path) -> tuple[dict, dict[str, np.ndarray], np.ndarray]:
    """Header, arrays float64 [T, N, c], and centres [N, 3] of a page, read as the header says; independent of the code that wrote it."""
    text = page.read_text(encoding="utf-8")
    header = json.loads(re.search(r'id="header">(.*?)</script>', text, re.DOTALL)[1])
    data = gzip.decompress(base64.b64decode(re.search(r'id="data">(.*?)</script>', text, re.DOTALL)[1]))
    gaussians, start = header["gaussians"], 12 * header["gaussians"]
    base = np.frombuffer(data[:start], "<f4").reshape(-1, 3)
    arrays = {}
    for entry in header["arrays"]:
        shape = entry["times"], gaussians, entry["width"]
        count, size = int(np.prod(shape)), entry["size"]
        planes = [np.frombuffer(data[start + k * count : start + (k + 1) * count], np.uint8).astype(np.int64) for k in range(size)]
        changes = sum(plane << (8 * k) for k, plane in enumerate(planes)).reshape(shape)
        numbers = np.cumsum(changes, 0) % 256**size
        arrays[entry["name"]] = entry["low"] + (entry["high"] - entry["low"]) * numbers / (256**size - 1)
        start += count * size
    assert start == len(data)
    return header, arrays, base


def test_the_page_holds_the_gaussians_of_every_frame(page, scene):
    header, arrays, base = unpacked(page)
    assert header["frames"] == list(range(24))
    assert page.stat().st_size < 30e6
    for frame in (0, 9, 23):
        splats = scene.splats(frame)
        seen = splats.opacities.numpy() >= 1 / 255
        assert np.abs(arrays["opacities"][frame, :, 0] - splats.opacities.numpy()).max() < 1e-4
        assert np.abs((base + arrays["means"][frame] - splats.means.numpy())[seen]).max() < 0.01  # mm
        assert np.abs(np.exp(arrays["scales"][frame]) / splats.scales.numpy() - 1)[seen].max() < 1e-3
        assert np.abs(arrays["colors"][frame] - splats.colors.numpy())[seen].max() < 1e-3
        quats = splats.quats.numpy() / np.linalg.norm(splats.quats.numpy(), axis=1, keepdims=True)
        assert (np.abs((arrays["quats"][frame] * quats).sum(1))[seen] > 1 - 1e-4).all()
        assert np.abs(arrays["displacement"][frame, :, 0] - scene.states.displacement(frame).numpy()).max() < 0.01
    assert (arrays["quats"][1:] * arrays["quats"][:-1]).sum(-1).min() > -1e-3  # neighbours in time can be interpolated


def test_the_page_asks_nothing_of_a_network(page):
    text = page.read_text(encoding="utf-8")
    assert "default-src 'none'" in text
    assert not re.findall(r"https?:|src=|href=|@import|fetch\(|XMLHttpRequest|WebSocket", text)


def test_names_cannot_become_part_of_the_page(scene, tmp_path, monkeypatch):
    monkeypatch.setattr(scene, "name", "</title><script>alert(1)</script>{data}")
    finish(share(scene, tmp_path / "a.html", ALL))
    text = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "<script>alert" not in text
    assert unpacked(tmp_path / "a.html")[0]["name"] == scene.name


def test_a_long_scene_is_sampled_at_fewer_times(scene, tmp_path, monkeypatch):
    monkeypatch.setattr("degense.app.features.share.sampling.MOST_BYTES", 9000 * 31 * 5)
    finish(share(scene, tmp_path / "a.html", ALL))
    header, arrays, _ = unpacked(tmp_path / "a.html")
    assert header["frames"] == [0, 5.75, 11.5, 17.25, 23]
    assert len(arrays["means"]) == 5


def test_what_cannot_be_written_is_refused(scene, tmp_path):
    with pytest.raises(DegenseError, match=r"must end in \.html"):
        finish(share(scene, tmp_path / "scene.pdf", ALL))
    with pytest.raises(PromptError):
        finish(share(scene, tmp_path / "scene.html", PromptSet(("zeppelin",))))
    assert not [*tmp_path.iterdir()]


@pytest.fixture(scope="module")
def shown(page, tmp_path_factory):
    """The page in a browser, at its start."""
    if not browser.installed():
        pytest.skip("needs Chromium and its WebDriver")
    with browser.Browser(tmp_path_factory.mktemp("profile")) as open_page:
        open_page.open(page)
        open_page.run("while (document.body.className === 'loading') await new Promise((done) => setTimeout(done, 20));")
        assert open_page.run("return document.body.className") == ""
        yield open_page
        assert open_page.messages() == []


def go_to(shown, frame: float) -> None:
    shown.run("const time = document.getElementById('time'); time.value = arguments[0]; time.dispatchEvent(new Event('input'))", frame)


def psnr(shown, scene: Scene, camera, frame: float, margin: int = 0) -> float:
    """Of what the page shows against the program's own picture, beside the panel, `margin` pixels off its sides."""
    width, height = shown.run("const { width, height } = document.getElementById('canvas'); return [width, height]")
    view = camera.letterboxed(width, height)
    ours, theirs = scene.render_rgb(frame, view), shown.screenshot()[:height, :width]
    inside = slice(PANEL, width - margin)
    assert ours[:, inside].mean() > 20
    return 10 * np.log10(255**2 / np.square(ours[:, inside].astype(float) - theirs[:, inside]).mean())


@pytest.mark.parametrize("frame", [0, 9.5, 23])
def test_a_browser_draws_what_the_program_draws(shown, scene, frame):
    go_to(shown, frame)
    camera = scene.camera(frame)
    width, height = shown.run("const { width, height } = document.getElementById('canvas'); return [width, height]")
    outside = int(np.ceil((width - camera.width * height / camera.height) / 2)) + 1  # the page shows the recording's picture alone
    assert psnr(shown, scene, camera, frame, outside) > 40


def test_the_camera_turns_and_comes_back(shown, scene):
    go_to(shown, 12)
    before = shown.screenshot()
    shown.run("document.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft', ctrlKey: true }))")
    pivot = np.median(scene.splats(0).means.numpy(), 0)
    assert psnr(shown, scene, orbit(scene.camera(12), pivot, 0.1, 0.0), 12) > 40
    shown.press("v")
    assert np.array_equal(shown.screenshot(), before)


def test_masks_and_displacement_are_shown(shown, scene):
    go_to(shown, 23)
    height = shown.run("return document.getElementById('canvas').height")
    plain = shown.screenshot()[:height, PANEL:]
    shown.press("m")
    masks = shown.screenshot()[:height, PANEL:]
    assert shown.run("return [...document.querySelectorAll('#prompts li')].map((item) => item.textContent)") == [*scene.classes]
    assert np.abs(masks.astype(int) - plain).mean() > 20
    shown.press("m")
    shown.press("d")
    moved = shown.screenshot()[:height, PANEL:]
    assert shown.run("return document.getElementById('high').textContent").endswith(" mm")
    yellow = (moved[..., 0] > 200) & (moved[..., 1] > 200) & (moved[..., 2] < 90)  # the last colour of viridis: it was pulled far
    assert 0.002 < yellow.mean() < 0.2
    shown.press("d")
    assert np.array_equal(shown.screenshot()[:height, PANEL:], plain)


def test_it_plays_until_it_is_stopped(shown):
    go_to(shown, 0)
    shown.press(" ")
    shown.run("while (document.getElementById('time').valueAsNumber === 0) await new Promise(requestAnimationFrame)")
    shown.press(" ")
    frame = shown.run("return document.getElementById('time').valueAsNumber")
    shown.screenshot()
    assert shown.run("return document.getElementById('time').valueAsNumber") == frame

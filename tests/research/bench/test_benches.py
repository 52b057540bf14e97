"""The benches measure what they say, against independent oracles; and each runs from end to end on something tiny."""

from __future__ import annotations

import copy
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from degense.engine.data.readers import open_clip
from degense.engine.data.synthetic import PhantomOptions, make_phantom
from degense.engine.errors import DegenseError
from degense.engine.metrics.image import psnr
from degense.engine.progress import silent
from degense.engine.research import growth
from degense.engine.research.bench.curves import draw_curves
from degense.engine.research.bench.run import BENCHES, BenchOptions, command_line, run
from degense.engine.research.bench.scenes import with_count
from degense.engine.research.bench.timing import measure, measure_in_turn, percentile, thread_counts, threads, throughput
from degense.engine.research.bench.trainings import psnr_ceiling
from degense.engine.research.benchmarks import field, presets, query, raster, savings, viewing
from degense.engine.scene import Scene
from degense.engine.training import TrainConfig, train


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Scene:
    folder = tmp_path_factory.mktemp("bench")
    make_phantom(folder / "clip", PhantomOptions(frames=9, width=64, height=48), silent)
    clip = open_clip(folder / "clip")
    config = TrainConfig.preset_of("quick", iterations=20, max_gaussians=500, device="cpu")
    train(clip, folder / "run", config, events=lambda event: None, stop=lambda: False)
    return Scene.open(folder / "run", device="cpu", clip=clip)


@pytest.fixture
def options(tmp_path: Path) -> BenchOptions:
    return BenchOptions("cpu", (0, 1), 2, True, tmp_path)


def test_a_scene_of_any_number_of_gaussians_looks_alike(scene):
    before = scene.render_rgb(4)
    for count, least in ((len(scene.model) - 20, 25), (len(scene.model) + 50, 25), (3 * len(scene.model), 18)):
        other = with_count(scene, count)
        assert len(other.model) == count
        assert psnr(other.render_rgb(4), before) > least
    same = with_count(scene, len(scene.model))
    assert torch.equal(same.splats(4).means, scene.splats(4).means)


def test_six_bilinear_samples_are_the_field(scene):
    exact = copy.deepcopy(scene.model).double()
    points = torch.rand(50, 3, dtype=torch.float64) * 2 - 1
    for t in (-1.0, -0.37, 0.2, 1.0):
        expected = exact.planes(points, t)
        planes = savings.still_planes(exact.planes, t)
        assert [plane.shape for plane in planes] == [plane.shape for plane in exact.planes.time]
        sampled = savings.bilinear_planes(exact.planes.space, planes, points, t)
        assert torch.allclose(sampled, expected, rtol=1e-12, atol=1e-12)


def test_overlap_does_not_depend_on_numbers_and_size():
    covered = []
    for count, width, height in ((300, 160, 120), (1500, 160, 120), (1500, 320, 240)):
        tensors, camera = raster.sized_scene(count, width, height, 4, "cpu")
        covered.append(raster.draw_scene(tensors, camera).alpha.mean().item())
    assert max(covered) - min(covered) < 0.04


def test_raster_tables(options, monkeypatch):
    monkeypatch.setattr(raster, "SMALL", (30, 24, 20))
    monkeypatch.setattr(raster, "QUICK_COUNTS", (40,))
    monkeypatch.setattr(raster, "QUICK_SIZES", ((32, 24),))
    monkeypatch.setattr(raster, "cores", lambda: 2)
    errors, times, scaling = run("raster", options)
    by_name = {row["name"]: row for row in errors.rows}
    assert by_name["reference, float64, 4"]["image"] == [0.0, 0.0]
    assert max(by_name["cpu (numba), float32, 20"]["image"]) < 1e-5
    assert max(by_name["cpu (numba), float32, 20"]["gradient"]) < 1e-4
    assert 1e-5 < max(by_name["cpu (numba), features float16, 4"]["image"]) < 1e-3
    assert [row["channels"] for row in times.rows] == [4, 20]
    assert all(len(row[key]) == options.repeats for row in times.rows for key in ("forward", "both", "features"))
    assert [row["threads"] for row in scaling.rows] == [1, 2, 1, 2]
    assert scaling.rows[0]["forward_gain"] == 1.0


def test_field_tables(options, scene, monkeypatch):
    monkeypatch.setattr(field, "trained_scene", lambda options, progress: (scene, "a tiny scene"))
    monkeypatch.setattr(field, "QUICK_COUNT", len(scene.model))
    monkeypatch.setattr(field, "cores", lambda: 2)
    states, saved, scaling = run("field", options)
    rows = {row["name"]: row for row in states.rows}
    assert rows["field, float64"]["rms"] == 0.0
    for name in ("field", "field, without semantics", "baked"):
        assert rows[name]["means"] < 1e-3, name
        assert rows[name]["picture"] > 70, name
    assert rows["baked, float16"]["megabytes"] == pytest.approx(rows["baked"]["megabytes"] / 2)
    assert rows["baked"]["rms"] < rows["baked, float16 but centres"]["rms"] < rows["baked, float16"]["rms"]
    assert rows["every second frame baked"]["means"] > rows["between two baked frames"]["means"] > rows["baked"]["means"]
    named = {row["name"]: row for row in saved.rows}
    assert named["superpixels kept, another prompt on the same picture"]["error"] == "0 pixels of the mask"
    assert len(scaling.rows) == 2


def test_viewing_tables(options, scene, monkeypatch):
    monkeypatch.setattr(viewing, "trained_scene", lambda options, progress: (scene, "a tiny scene"))
    monkeypatch.setattr(viewing, "QUICK_STAGES", ((len(scene.model), 80, 40),))
    monkeypatch.setattr(viewing, "SECONDS", {"cpu": 0.02})
    playing, asking = run("viewing", options)
    assert playing.rows[0]["share"] == pytest.approx(100)
    assert [row["what"] for row in playing.rows][:2] == ["raw: cpu (numba)", "baked states, drawn"]
    assert all(min(row["rate"]) > 0 and row["late"] >= row["time"] for row in playing.rows)
    assert len(asking.rows) == 4
    assert "80 × 40" in asking.rows[0]["scene"]


def test_query_table(options, scene, monkeypatch):
    monkeypatch.setattr(query, "trained_scene", lambda options, progress: (scene, "a tiny scene"))
    monkeypatch.setattr(query, "QUICK_STAGES", ((len(scene.model), 80, 40, 5),))
    [table] = run("query", options)
    together, single, alone = table.rows
    assert together["scene"] == f"{len(scene.model)} Gaussians, 80 × 40"
    assert together["differ"] == single["differ"] == 0
    assert (together["frames"], alone["frames"]) == (5, 5)
    assert all(len(row["seconds"]) == options.repeats and min(row["seconds"]) > 0 for row in table.rows)


def test_the_view_of_another_size_shows_the_same_width(scene):
    camera, view = scene.camera(0), viewing._view(scene, 128, 60)
    edges = camera.unproject(torch.tensor([[0.0, 24.0], [64.0, 24.0]]).numpy(), torch.tensor([1.0, 1.0]).numpy())
    assert view.project(edges)[0][:, 0] == pytest.approx([0, 128], abs=1e-3)


def test_presets_table(options, monkeypatch, tmp_path):
    monkeypatch.setattr(presets, "QUICK_PRESETS", {"quick": {"iterations": 8, "max_gaussians": 300}})
    monkeypatch.setattr(presets, "QUICK_PHANTOM", PhantomOptions(frames=9, width=48, height=40))
    table, tissue = run("presets", BenchOptions("cpu", (0,), 1, True, tmp_path))
    assert (table.name, tissue.name) == ("presets-phantom", "presets-phantom-tissue")
    [row] = table.rows
    assert row["short"][0] + row["psnr"][0] == pytest.approx(psnr_ceiling(1.5))
    assert row["wall"][0] > row["seconds"][0] > 0
    assert row["gaussians"][0] <= 300
    assert row["memory"] is None or row["memory"][0] > 50
    assert not list(tmp_path.glob("presets-run*"))


def test_growth_tables(monkeypatch, tmp_path):
    monkeypatch.setattr(growth, "STEPS", 6)
    ladder = tuple(replace(size, gaussians=150) for size in growth.QUICK_LADDERS["classes"])
    monkeypatch.setattr(growth, "QUICK_LADDERS", {"classes": ladder})
    monkeypatch.setattr(growth, "call_in_child", lambda work, *arguments: work(*arguments))  # with the fewer steps
    [table] = run("growth", BenchOptions("cpu", (0,), 1, True, tmp_path))
    *measured, fitted = table.rows
    assert [row["size"] for row in measured] == [2, 3]
    assert all(0 < row["gaussians"] <= 150 and row["step"] > 0 and row["flow"] > 0 and row["semantics"] > 0 for row in measured)
    assert all(row["whole"] > row["flow"] + row["semantics"] + row["save"] for row in measured)
    assert fitted["whole"] is not None
    assert [row["card"] for row in measured] == [None, None]
    assert "card" not in [column.key for column in table.columns]
    assert draw_curves(table, tmp_path / "curves.png")
    assert not (tmp_path / "growth").exists()


def test_the_exponent_of_a_power_is_found_beyond_what_every_training_costs():
    sizes = [10.0, 100.0, 1_000.0, 10_000.0, 100_000.0, 1_000_000.0]
    assert growth.exponent(sizes, [3 * size**1.5 for size in sizes]) == pytest.approx(1.5)
    assert growth.exponent(sizes, [100 + size for size in sizes]) == pytest.approx(1.0, abs=0.01)
    assert growth.exponent(sizes, [1.0, 2.0, 3.0, None, 4.0, 5.0]) is None


def test_the_noise_floor_is_that_of_noise():
    generator = torch.Generator().manual_seed(0)
    true = torch.rand(400_000, generator=generator) * 200 + 20
    seen = (true + 1.5 * torch.randn(len(true), generator=generator)).round()
    expected = 10 * torch.log10(255**2 / (seen - true.round()).square().mean()).item()
    assert psnr_ceiling(1.5) == pytest.approx(expected, abs=0.02)


def test_the_command_says_what_was_chosen(options, tmp_path):
    (tmp_path / "my clip").mkdir()
    chosen = BenchOptions("cuda", (0, 1, 2), 7, False, tmp_path, (tmp_path / "my clip",))
    assert command_line("raster", chosen) == "degense bench raster --device cuda --seeds 3 --repeats 7 --clip 'my clip'"
    assert command_line("raster", options).endswith("--seeds 2 --repeats 2 --quick")


def test_no_such_benchmark(options):
    with pytest.raises(DegenseError, match="choose from raster"):
        next(run("smell", options))
    assert all(text and text[0].islower() for _, text in BENCHES.values())


def test_timing_counts_what_it_says():
    calls: list[int] = []
    assert len(measure(lambda: calls.append(0), 4, warm=2)) == 4
    assert len(calls) == 6
    order: list[str] = []
    times = measure_in_turn([lambda: order.append("a"), lambda: order.append("b")], 2, warm=1)
    assert order == list("ababab")
    assert [len(of_work) for of_work in times] == [2, 2]
    assert throughput(calls.append, 5, warm=1) > 0
    assert calls[6:] == [0, 0, 1, 2, 3, 4]
    assert percentile([1, 2, 3, 4, 5], 50) == 3
    assert [thread_counts(n) for n in (1, 2, 6, 8)] == [[1], [1, 2], [1, 2, 4, 6], [1, 2, 4, 8]]
    before = torch.get_num_threads()
    with threads(1):
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == before

"""Gaussians in formats of other tools, read back by the letter of each format, apart from the code that writes it."""

from __future__ import annotations

import gzip
import struct

import numpy as np
import pygltflib
import pytest
import torch

from degense.engine.camera import Camera
from degense.engine.errors import DegenseError
from degense.engine.raster import rasterize
from degense.engine.splats import Splats
from degense.engine.store.splat_files import save_gltf, save_ply, save_spz
from degense.engine.store.splat_files.ply import PROPERTIES
from tests.fakes import ply_columns

Y00 = 0.5 / np.sqrt(np.pi)  # the spherical harmonic of degree 0
TURN = np.diag([1.0, -1.0, -1.0, 1.0])  # from x right, y down, z forward to x right, y up, z back
CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)


def some_splats(count: int = 40) -> Splats:
    random = torch.Generator().manual_seed(3)

    def numbers(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random)

    means = torch.cat([(numbers(count, 2) - 0.5) * 2, 2 + numbers(count, 1)], 1)
    quats = torch.randn(count, 4, generator=random)
    return Splats(
        means, 3 * quats, 0.02 + 0.3 * numbers(count, 3) ** 2, 0.05 + 0.9 * numbers(count), numbers(count, 3), torch.zeros(count, 0)
    )


def rotations(quats: np.ndarray) -> np.ndarray:
    """Rotation matrices [N, 3, 3] of quaternions wxyz."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(quats[:, [1, 2, 3, 0]]).as_matrix()


def covariances(quats: np.ndarray, scales: np.ndarray) -> np.ndarray:
    axes = rotations(quats) * scales[:, None]
    return axes @ axes.swapaxes(1, 2)


def psnr_of(read: Splats, view: np.ndarray, splats: Splats) -> float:
    """Of what was read, seen by a camera that stands in its axes, against what was written."""
    there = Camera(CAMERA.width, CAMERA.height, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, view)
    ours, theirs = rasterize(splats, splats.colors, CAMERA).image, rasterize(read, read.colors, there).image
    return float(-10 * torch.log10((ours - theirs).square().mean()))


def read_spz(data: bytes) -> Splats:
    """As nianticlabs/spz describes version 3: header, positions, alphas, colours, scales, rotations; one Gaussian after the other."""
    data = gzip.decompress(data)
    magic, version, count, degree, bits, flags, reserved = struct.unpack("<4sIIBBBB", data[:16])
    assert (magic, version, degree, flags, reserved) == (b"NGSP", 3, 0, 0, 0)
    assert len(data) == 16 + count * (9 + 1 + 3 + 3 + 4)
    place = 16
    columns = []
    for width in (9, 1, 3, 3, 4):
        columns.append(np.frombuffer(data[place : place + count * width], np.uint8).reshape(count, width))
        place += count * width
    positions, alphas, colors, scales, rotations = columns
    means = [[int.from_bytes(row[k : k + 3].tobytes(), "little", signed=True) / 2**bits for k in (0, 3, 6)] for row in positions]
    quats = []
    for row in rotations:
        word = int.from_bytes(row.tobytes(), "little")
        largest, others = word >> 30, []
        for shift in (20, 10, 0):
            field = word >> shift & 1023
            others.append((-1 if field & 512 else 1) * (field & 511) / 511 * np.sqrt(0.5))
        others.insert(largest, np.sqrt(max(0.0, 1 - np.square(others).sum())))
        quats.append([others[3], *others[:3]])
    return Splats(
        torch.tensor(means),
        torch.tensor(np.array(quats), dtype=torch.float32),
        torch.from_numpy(np.exp(scales / 16.0 - 10.0)).float(),
        torch.from_numpy(alphas[:, 0] / 255.0).float(),
        torch.from_numpy((colors / 255.0 - 0.5) / 0.15 * Y00 + 0.5).float(),
        torch.zeros(count, 0),
    )


def test_ply_comes_back_as_it_went(tmp_path):
    splats = some_splats()
    save_ply(tmp_path / "a.ply", splats)
    table = torch.from_numpy(ply_columns(tmp_path / "a.ply"))
    assert table.shape == (40, len(PROPERTIES))
    assert torch.allclose(table[:, :3], splats.means)
    assert torch.allclose(table[:, 3:6] * Y00 + 0.5, splats.colors, atol=1e-5)
    assert torch.allclose(table[:, 6].sigmoid(), splats.opacities, atol=1e-5)
    assert torch.allclose(table[:, 7:10].exp(), splats.scales, atol=1e-5)
    assert torch.allclose(table[:, 10:], splats.quats)


def test_spz_says_the_same_within_its_steps(tmp_path):
    splats = some_splats()
    save_spz(tmp_path / "a.spz", splats)
    read = read_spz((tmp_path / "a.spz").read_bytes())
    assert torch.allclose(read.means * torch.tensor([1.0, -1.0, -1.0]), splats.means, atol=0.51 / 4096)
    assert torch.allclose(read.opacities, splats.opacities, atol=0.51 / 255)
    assert torch.allclose(read.colors, splats.colors, atol=0.51 / 255 / 0.15 * Y00 + 1e-6)
    assert torch.allclose(read.scales.log(), splats.scales.log(), atol=0.51 / 16)
    turned = TURN[:3, :3] @ rotations(read.quats.numpy()) @ TURN[:3, :3]
    angles = np.arccos(np.clip((np.trace(turned.swapaxes(1, 2) @ rotations(splats.quats.numpy()), axis1=1, axis2=2) - 1) / 2, -1, 1))
    assert np.degrees(angles).max() < 0.4
    assert psnr_of(read, TURN, splats) > 35


def test_spz_gives_up_steps_for_scenes_that_reach_far(tmp_path):
    splats = some_splats()
    splats.means *= 1000
    save_spz(tmp_path / "a.spz", splats)
    read = read_spz((tmp_path / "a.spz").read_bytes())
    assert torch.allclose(read.means * torch.tensor([1.0, -1.0, -1.0]), splats.means, atol=0.51 / 2048)
    splats.means *= 1e6
    with pytest.raises(DegenseError, match="choose PLY"):
        save_spz(tmp_path / "b.spz", splats)
    assert not (tmp_path / "b.spz").exists()


def test_gltf_says_the_same(tmp_path):
    """Read by pygltflib; what the attributes mean is KHR_gaussian_splatting's."""
    splats = some_splats()
    save_gltf(tmp_path / "a.glb", splats)
    document = pygltflib.GLTF2().load_binary(str(tmp_path / "a.glb"))
    assert document.asset.version == "2.0"
    assert document.extensionsUsed == ["KHR_gaussian_splatting"]
    [primitive] = document.meshes[0].primitives
    assert primitive.mode == pygltflib.POINTS
    assert primitive.extensions["KHR_gaussian_splatting"]["kernel"] == "ellipse"
    assert primitive.extensions["KHR_gaussian_splatting"]["colorSpace"] == "srgb_rec709_display"
    named = {name: index for name, index in vars(primitive.attributes).items() if index is not None}
    blob, values = document.binary_blob(), {}
    for name, index in named.items():
        accessor = document.accessors[index]
        view = document.bufferViews[accessor.bufferView]
        assert view.byteOffset % 4 == 0
        dtype = {pygltflib.FLOAT: "<f4", pygltflib.UNSIGNED_BYTE: "u1"}[accessor.componentType]
        values[name] = np.frombuffer(blob[view.byteOffset : view.byteOffset + view.byteLength], dtype).reshape(accessor.count, -1)
        assert values[name].shape[1] == {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    extent = document.accessors[named["POSITION"]]
    assert np.allclose([extent.min, extent.max], [values["POSITION"].min(0), values["POSITION"].max(0)])
    attribute = {name.partition(":")[2] or name: value for name, value in values.items()}
    quats = attribute["ROTATION"][:, [3, 0, 1, 2]]
    assert np.allclose(np.linalg.norm(quats, axis=1), 1, atol=1e-6)
    assert np.allclose(attribute["POSITION"] * [1, -1, -1], splats.means.numpy())
    here = covariances(splats.quats.numpy(), splats.scales.numpy())
    assert np.allclose(TURN[:3, :3] @ covariances(quats, attribute["SCALE"]) @ TURN[:3, :3], here, atol=1e-6)
    colors = attribute["SH_DEGREE_0_COEF_0"] * Y00 + 0.5
    assert np.allclose(colors, splats.colors.numpy(), atol=1e-6)
    assert np.allclose(attribute["OPACITY"][:, 0], splats.opacities.numpy())
    assert np.allclose(attribute["COLOR_0"] / 255, np.c_[colors, attribute["OPACITY"]], atol=0.51 / 255)
    arrays = (attribute["POSITION"], quats, attribute["SCALE"], attribute["OPACITY"][:, 0], colors)
    read = Splats(*(torch.tensor(np.array(array, np.float32)) for array in arrays), torch.zeros(40, 0))
    assert psnr_of(read, TURN, splats) > 80
    with pytest.raises(DegenseError, match="no Gaussian"):
        save_gltf(tmp_path / "b.glb", splats.map(lambda tensor: tensor[:0]))

"""Learned segmentation: what the network sees, what it says, and weights that can't be used."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from bev_mapper.room import MOUNT, render, walk
from bev_mapper.segmentation import make_segmenter
from bev_mapper.segmentation.learned import (
    CONFIG_FILE,
    MODEL_FILE,
    SHIPPED,
    LearnedSegmenter,
    load_network,
    save_network,
)
from bev_mapper.segmentation.network import NetworkConfig, PixelNetwork
from bev_mapper.segmentation.pixels import (
    INPUTS,
    chosen,
    network_inputs,
    network_size,
    resized,
    spread,
)
from bev_mapper.unprojection import depth_in_metres, thin, unproject
from gridnav.rgbd import CLASSES, Camera, CameraMount, RgbdFrame

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

FLOOR, CEILING, WALL = (CLASSES.index(name) for name in ('floor', 'ceiling', 'wall'))

CAMERA = Camera(320, 240, 260.0, 260.0, 159.5, 119.5)

SMALL = NetworkConfig(widths=(8, 8), blocks=(1, 1), pixels=400)


def frame_of_room(
    number: int = 0, camera: Camera = CAMERA, mount: CameraMount = MOUNT
) -> RgbdFrame:
    """Return a look at the room, with depth in metres as the mapper hands it on."""
    frame = render(camera, walk(number, 8), mount=mount)
    return replace(frame, depth=depth_in_metres(frame.depth))


def points_of(frame: RgbdFrame) -> NDArray[np.float64]:
    """Return the points of a frame's pixels."""
    return unproject(frame.depth.astype(np.float32), frame.camera, frame.camera_to_map())


@pytest.fixture(scope='module')
def shipped() -> LearnedSegmenter:
    """Return the segmenter that comes with the package."""
    segmenter = make_segmenter('learned')
    assert isinstance(segmenter, LearnedSegmenter)
    return segmenter


def test_surfaces_are_seen_as_upright_as_they_are() -> None:
    """A floor is 1, a ceiling -1 and a wall 0; heights count from where they should."""
    wide = Camera(320, 240, 150.0, 150.0, 159.5, 119.5)
    frame = frame_of_room(0, wide, CameraMount(z=1.2))
    labels = frame.labels
    assert labels is not None
    seen = network_inputs(
        frame.color,
        frame.depth.astype(np.float32),
        points_of(frame),
        frame.camera,
        frame.camera_to_map(),
    )
    assert seen.shape == (len(INPUTS), 240, 320)
    assert np.isfinite(seen).all()
    channel = dict(zip(INPUTS, seen, strict=True))
    for label, upright in ((FLOOR, 1.0), (CEILING, -1.0), (WALL, 0.0)):
        there = labels == label
        assert there.any()
        assert abs(np.median(channel['upright'][there]) - upright) < 0.1
    assert abs(np.median(channel['low height'][labels == FLOOR])) < 0.02
    assert abs(np.median(channel['height'][labels == CEILING]) - 1.4) < 0.02
    # What looks up sees the ceiling, what looks down the floor.
    assert channel['slope'][0].mean() > channel['slope'][-1].mean()


def test_what_was_not_measured_is_seen_as_nothing() -> None:
    """Without depth there is colour and the direction, and neither distance nor height."""
    frame = frame_of_room()
    depth = frame.depth.astype(np.float32)
    depth[50:120, 100:200] = 0.0
    points = unproject(depth, frame.camera, frame.camera_to_map())
    seen = network_inputs(frame.color, depth, points, frame.camera, frame.camera_to_map())
    hole = seen[3:8, 50:120, 100:200]
    assert (hole == 0).all()
    # Nor is there a normal beside it.
    assert (seen[6, 48:50, 100:200] == 0).all()


def test_some_pixels_are_those_of_a_smaller_camera() -> None:
    """Points of chosen pixels are the points that their camera gives."""
    frame = frame_of_room()
    rows, cols = chosen(240, 120), chosen(320, 160)
    some = np.ix_(rows, cols)
    depth = frame.depth.astype(np.float32)
    small = unproject(depth[some], resized(frame.camera, rows, cols), frame.camera_to_map())
    np.testing.assert_allclose(small, points_of(frame)[:, some[0], some[1]], atol=1e-9)


@pytest.mark.parametrize('size', [(480, 640), (270, 480), (1080, 1920), (97, 131), (2, 2)])
def test_the_network_sees_pictures_of_any_size(size: tuple[int, int]) -> None:
    """It sees about as many pixels as it should, in even numbers, no more than there are."""
    rows, cols = network_size(*size, 19_200)
    assert rows % 2 == cols % 2 == 0
    assert rows * cols <= 19_200
    assert rows <= size[0]
    assert cols <= size[1]
    for count, of in zip((rows, cols), size, strict=True):
        places = chosen(of, count)
        assert 0 <= places[0] <= places[-1] < of


def test_edges_stay_where_the_depth_has_them() -> None:
    """A pixel takes the class of the pixel around it that is as far away as itself."""
    rows, cols = np.mgrid[:60, :80]
    truth = (rows + 2 * cols > 97).astype(np.uint8)
    depth = np.where(truth, 3.0, 1.5).astype(np.float32)
    some = np.ix_(chosen(60, 20), chosen(80, 26))
    found = spread(truth[some], depth[some], depth)
    assert (found == truth).mean() > 0.995
    nearest = truth[some][np.ix_(rows[:, 0] * 20 // 60, cols[0] * 26 // 80)]
    assert (nearest == truth).mean() < 0.99


def test_joined_layers_say_the_same() -> None:
    """The network for use gives the scores of the one that was trained."""
    torch.manual_seed(0)
    network = PixelNetwork(SMALL)
    seen = torch.randn(2, len(INPUTS), 18, 22)
    network.train()(seen)
    network.eval()
    with torch.inference_mode():
        torch.testing.assert_close(network.fused()(seen), network(seen), atol=1e-4, rtol=1e-4)
        assert network(seen).shape == (2, len(CLASSES), 18, 22)


@pytest.mark.parametrize('size', [(240, 320), (135, 241), (7, 5), (2, 3)])
def test_each_pixel_gets_a_class(size: tuple[int, int]) -> None:
    """Whatever the size, even when nothing was measured at all."""
    height, width = size
    camera = Camera(width, height, width, width, width / 2, height / 2)
    segmenter = LearnedSegmenter(PixelNetwork(SMALL))
    frame = frame_of_room(0, camera)
    for depth in (frame.depth, np.zeros_like(frame.depth)):
        blind = replace(frame, depth=depth)
        labels = segmenter.labels(blind, points_of(blind))
        assert labels.shape == size
        assert labels.dtype == np.uint8
        assert labels.max() < len(CLASSES)


def test_a_room_unlike_all_that_it_was_trained_on(shipped: LearnedSegmenter) -> None:
    """Floor is told from obstacles in a room of boxes in chequered colours."""
    right, either, wrong = 0, 0, 0
    for number in range(8):
        frame = thin(frame_of_room(number), 130_000)
        labels = shipped.labels(frame, points_of(frame))
        assert frame.labels is not None
        truth, found = frame.labels == FLOOR, labels == FLOOR
        right += int((truth & found).sum())
        either += int((truth | found).sum())
        wrong += int((found & (points_of(frame)[2] > 0.3)).sum())
    assert right / either > 0.9
    assert wrong < 0.005 * either


def test_the_shipped_weights_are_small_and_say_where_they_come_from() -> None:
    """The files have their size, their record and their card."""
    assert (SHIPPED / MODEL_FILE).stat().st_size < 3e6
    record = json.loads((SHIPPED / CONFIG_FILE).read_text())
    assert record['training']['homes']['seed'] > 100_000
    assert '| wall |' in (SHIPPED / 'README.md').read_text()


def test_weights_come_back_as_they_were_saved(tmp_path: Path) -> None:
    """A saved network is what it was before, in half precision."""
    torch.manual_seed(1)
    network = PixelNetwork(SMALL)
    save_network(tmp_path / 'a', SMALL, network.state_dict(), {'seed': 1})
    loaded = load_network(tmp_path / 'a')
    assert loaded.config == SMALL
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[name], tensor, rtol=1e-3, atol=1e-6)


def damage_missing(folder: Path) -> None:
    """Take the tensors away."""
    (folder / MODEL_FILE).unlink()


def damage_cut(folder: Path) -> None:
    """Leave only part of the tensors."""
    path = folder / MODEL_FILE
    path.write_bytes(path.read_bytes()[:500])


def damage_other(folder: Path) -> None:
    """Put other tensors there."""
    tensors = load_file(folder / MODEL_FILE)
    save_file({'strange': next(iter(tensors.values()))}, folder / MODEL_FILE)


def damage_json(folder: Path) -> None:
    """Break the configuration off."""
    (folder / CONFIG_FILE).write_text('{"config": ')


def damage_config(folder: Path) -> None:
    """Ask for a network that there is not."""
    (folder / CONFIG_FILE).write_text('{"config": {"widths": [8, 8], "blocks": [1]}}')


def damage_nothing_said(folder: Path) -> None:
    """Say nothing of the configuration."""
    (folder / CONFIG_FILE).write_text('[]')


@pytest.mark.parametrize(
    'damage',
    [
        damage_missing,
        damage_cut,
        damage_other,
        damage_json,
        damage_config,
        damage_nothing_said,
        shutil.rmtree,
    ],
)
def test_weights_that_can_not_be_used_are_refused_in_one_sentence(
    damage: object, tmp_path: Path
) -> None:
    """It names the folder and has one line."""
    folder = tmp_path / 'weights'
    save_network(folder, SMALL, PixelNetwork(SMALL).state_dict(), {})
    assert callable(damage)
    damage(folder)
    with pytest.raises(ValueError, match='weights') as caught:
        make_segmenter('learned', folder)
    assert len(str(caught.value).splitlines()) == 1

"""What names the classes of points."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bev_mapper.room import render, walk
from bev_mapper.segmentation import (
    SEGMENTERS,
    CloudSegmenter,
    GeometricSegmenter,
    GroundTruthSegmenter,
    make_segmenter,
)
from bev_mapper.unprojection import depth_in_metres, unproject
from gridnav.rgbd import CLASSES, Camera, CameraMount, Pose3D, RgbdFrame

FLOOR, CEILING, CLUTTER = (CLASSES.index(name) for name in ('floor', 'ceiling', 'clutter'))
CAMERA = Camera(160, 120, 125.0, 125.0, 79.5, 59.5)
WEIGHTS = Path(__file__).parents[3] / 'shared' / 'data' / 'dgcnn_s3dis' / 'model_5.t7'


def prepared(frame: RgbdFrame) -> tuple[RgbdFrame, np.ndarray]:
    """Return a frame as mappers hand it over, and its points."""
    frame = replace(frame, depth=depth_in_metres(frame.depth))
    return frame, unproject(frame.depth, frame.camera, frame.camera_to_map())  # type: ignore[arg-type]


@pytest.mark.parametrize('pitch', [0.4, -0.5])
def test_geometric_labels_are_floor_ceiling_and_clutter(pitch: float) -> None:
    """Those of the true room, looking up or down."""
    for number in range(6):
        frame = render(CAMERA, walk(number, 6), mount=CameraMount(z=1.2, pitch=pitch))
        frame, points = prepared(frame)
        labels = GeometricSegmenter().labels(frame, points)
        assert labels.shape == frame.depth.shape
        assert labels.dtype == np.uint8
        assert frame.labels is not None
        truth = np.where(np.isin(frame.labels, [FLOOR, CEILING]), frame.labels, CLUTTER)
        # The foot of a wall may be taken for floor, its head for ceiling, and no more.
        sure = (points[2] > 0.15) & (points[2] < 2.15) | (truth != CLUTTER)
        assert (labels == truth)[sure].mean() > 0.995


def test_a_low_ceiling_is_found_by_its_plane() -> None:
    """Below the height from which on all is ceiling."""
    frame, points = prepared(render(CAMERA, Pose3D(), mount=CameraMount(z=1.2, pitch=-0.9)))
    points[2] *= 2.05 / 2.6
    labels = GeometricSegmenter().labels(frame, points)
    assert (labels == CEILING)[frame.labels == CEILING].all()
    assert not (labels == CEILING)[points[2] < 1.85].any()


def test_true_labels_are_those_of_the_frame() -> None:
    """And a frame without any is refused."""
    frame, points = prepared(render(CAMERA, Pose3D()))
    assert GroundTruthSegmenter().labels(frame, points) is frame.labels
    with pytest.raises(ValueError, match='frame 0 has no true labels'):
        GroundTruthSegmenter().labels(replace(frame, labels=None), points)


def test_segmenters_by_name() -> None:
    """What is unknown or lacks its weights is refused in a sentence."""
    assert make_segmenter('geometric').name == 'geometric'
    assert make_segmenter('ground_truth').name == 'ground_truth'
    with pytest.raises(ValueError, match="no segmenter 'pointnet', only geometric, learned"):
        make_segmenter('pointnet')
    for name in ('dgcnn', 'swin3d'):
        assert name in SEGMENTERS
        with pytest.raises(ValueError, match=f"'{name}' comes without weights"):
            make_segmenter(name)


def test_files_that_are_no_weights_are_refused(tmp_path: Path) -> None:
    """Missing, not of PyTorch, or of another network."""
    torch = pytest.importorskip('torch', reason='PyTorch is not installed')
    file = tmp_path / 'weights.t7'
    with pytest.raises(ValueError, match=r'weights.t7 can not be read: there is no such file'):
        make_segmenter('dgcnn', file)
    file.write_bytes(b'nonsense')
    with pytest.raises(ValueError, match=r'weights.t7 can not be read: '):
        make_segmenter('dgcnn', file)
    torch.save(torch.zeros(3), file)
    with pytest.raises(ValueError, match='there are none in it'):
        make_segmenter('dgcnn', file)
    torch.save({'module.conv1.0.weight': torch.zeros(3)}, file)
    with pytest.raises(ValueError, match='not those of a DGCNN'):
        make_segmenter('dgcnn', file)


@pytest.mark.skipif(not WEIGHTS.exists(), reason='needs ../shared/data/dgcnn_s3dis')
def test_dgcnn_finds_the_floor_with_the_published_weights() -> None:
    """And takes nothing else for it; the same each time."""
    rng = np.random.default_rng(0)
    floor = np.column_stack([rng.uniform(0, 2, (1500, 2)), rng.normal(0, 0.005, 1500)])
    wall = np.column_stack(
        [rng.uniform(0, 2, 1500), rng.normal(0, 0.005, 1500), rng.uniform(0.1, 2.5, 1500)]
    )
    positions = np.concatenate([floor, wall])
    colors = np.repeat([[120, 110, 100], [200, 200, 190]], 1500, axis=0).astype(np.uint8)
    segmenter = make_segmenter('dgcnn', WEIGHTS)
    assert isinstance(segmenter, CloudSegmenter)
    labels = segmenter.cloud_labels(positions, colors)
    assert (labels[:1500] == FLOOR).mean() > 0.6
    assert (labels[1500:] == FLOOR).mean() < 0.02
    assert np.array_equal(labels, segmenter.cloud_labels(positions, colors))


def swin3d_stand_in(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Install modules with the interface of Swin3D and MinkowskiEngine; returns what is called.

    The network calls what is low floor and the rest clutter, by the coordinates that it is given.
    """
    torch = pytest.importorskip('torch', reason='PyTorch is not installed')
    calls: list[Any] = []

    class SparseTensor:
        def __init__(
            self,
            features: Any,  # noqa: ANN401
            coordinates: Any = None,  # noqa: ANN401
            coordinate_map_key: object = None,
            coordinate_manager: object = None,
        ) -> None:
            assert (coordinates is None) != (coordinate_map_key is None)
            if coordinates is not None:
                assert coordinates.dtype == torch.int32
                assert len(torch.unique(coordinates, dim=0)) == len(coordinates)
            self.F, self.C = features, coordinates
            self.coordinate_map_key, self.coordinate_manager = 'key', 'manager'
            assert coordinate_manager in {None, 'manager'}

    class Swin3DUNet(torch.nn.Module):  # type: ignore[misc, name-defined]
        def __init__(self, depths: list[int], channels: list[int], **settings: Any) -> None:  # noqa: ANN401
            super().__init__()
            calls.append((depths, channels, settings))
            self.classifier = torch.nn.Sequential(torch.nn.Linear(channels[0], channels[0]))

        def forward(self, sp: SparseTensor, coords_sp: SparseTensor) -> Any:  # noqa: ANN401
            calls.append((sp.F, coords_sp.F))
            scores = torch.zeros(len(sp.F), 13)
            low = coords_sp.F[:, 2] * 0.04 < 0.1
            scores[low, FLOOR] = 1.0
            scores[~low, CLUTTER] = 1.0
            return scores

    models = ModuleType('Swin3D.models')
    monkeypatch.setattr(models, 'Swin3DUNet', Swin3DUNet, raising=False)
    monkeypatch.setitem(sys.modules, 'Swin3D', ModuleType('Swin3D'))
    monkeypatch.setitem(sys.modules, 'Swin3D.models', models)
    stand_in = SimpleNamespace(SparseTensor=SparseTensor)
    monkeypatch.setitem(sys.modules, 'MinkowskiEngine', stand_in)
    return calls


@pytest.mark.parametrize(('width', 'heads'), [(48, 6), (80, 10)])
def test_swin3d_is_called_as_its_own_code_calls_it(
    width: int, heads: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Voxels of 4 cm, the second axis upright, colours from -1 to 1, one label for each point."""
    torch = pytest.importorskip('torch', reason='PyTorch is not installed')
    calls = swin3d_stand_in(monkeypatch)
    layer = {
        'module.backbone.classifier.0.weight': torch.zeros(width, width),
        'module.backbone.classifier.0.bias': torch.zeros(width),
    }
    torch.save({'epoch': 3, 'state_dict': layer}, tmp_path / 'model.pth')
    segmenter = make_segmenter('swin3d', tmp_path / 'model.pth')
    assert isinstance(segmenter, CloudSegmenter)
    _, channels, settings = calls.pop()
    assert (channels[0], settings['num_heads'][0], settings['num_classes']) == (width, heads, 13)

    rng = np.random.default_rng(0)
    positions = rng.uniform([-3, 5, 0], [-1, 6, 2], (3000, 3))
    positions[0] = -3.0, 5.0, 0.0
    colors = rng.integers(0, 256, (3000, 3), dtype=np.uint8)
    labels = segmenter.cloud_labels(positions, colors)
    low = positions[:, 2] < 0.1 - 0.04
    assert (labels[low] == FLOOR).all()
    assert (labels[positions[:, 2] > 0.1 + 0.04] == CLUTTER).all()
    features, signal = calls.pop()
    assert features.shape[1:] == (6,)
    assert signal.shape[1:] == (7,)
    assert features[:, :3].abs().max() <= 1.0
    assert features[:, 3:].min() >= 0.0
    assert features[:, 3:].max() < 1.0
    assert (signal[:, 0] == 0).all()


def test_swin3d_says_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its installation, or the right file."""
    torch = pytest.importorskip('torch', reason='PyTorch is not installed')
    file = tmp_path / 'model.pth'
    torch.save({'state_dict': {'classifier.0.weight': torch.zeros(7, 7)}}, file)
    monkeypatch.setitem(sys.modules, 'MinkowskiEngine', None)
    with pytest.raises(ValueError, match='Swin3D is not installed here: it needs'):
        make_segmenter('swin3d', file)
    swin3d_stand_in(monkeypatch)
    with pytest.raises(ValueError, match='not those of a Swin3D'):
        make_segmenter('swin3d', file)
    torch.save({'state_dict': {'classifier.0.weight': torch.zeros(48, 7)}}, file)
    with pytest.raises(ValueError, match='not those of a Swin3D'):
        make_segmenter('swin3d', file)
    file.write_bytes(b'')
    with pytest.raises(ValueError, match='can not be read'):
        make_segmenter('swin3d', file)

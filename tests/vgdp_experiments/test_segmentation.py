"""Training the segmentation: views of homes, what is done to them, the run and the scores."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import torch

from bev_mapper.room import render, walk
from bev_mapper.segmentation.learned import load_network, save_network
from bev_mapper.segmentation.network import NetworkConfig, PixelNetwork
from bev_mapper.unprojection import unproject
from gridnav.rgbd import CLASSES, UNLABELLED, Camera, CameraMount
from vgdp_experiments import evaluate_segmentation, spoiled_views, train_segmentation
from vgdp_experiments.home_views import TRAINING_SEED, HomeViews, View, Views, write_views
from vgdp_experiments.parallel import Team
from vgdp_experiments.spoiled_views import spoil
from vgdp_experiments.train_segmentation import SegmentationTraining, class_weights

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from torch import Tensor

ALONE = Team(0, 1, torch.device('cpu'))

TINY = HomeViews(seed=5, homes=1, views=6, width=48, height=36, workers=1)

SMALL = SegmentationTraining(
    steps=4, batch=2, checkpoint_every=2, device='cpu', threads=1, precision='float32'
)

FLOOR, CEILING, WALL = (CLASSES.index(name) for name in ('floor', 'ceiling', 'wall'))


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a few small views of a home."""
    pytest.importorskip('open3d', exc_type=ImportError)
    out = tmp_path_factory.mktemp('views') / 'tiny'
    write_views(replace(TINY, out=str(out)))
    return out


@pytest.fixture(scope='module')
def room() -> list[View]:
    """Return views of a simple room from a camera that is not level."""
    camera = Camera(160, 120, 90.0, 90.0, 79.5, 59.5)
    mount = CameraMount(z=1.1, roll=0.06, pitch=0.1)
    frames = [render(camera, walk(number, 6), mount=mount) for number in range(6)]
    return [
        View(1, frame.color, frame.depth.astype(np.uint16), frame.labels, camera, mount)
        for frame in frames
        if frame.labels is not None
    ]


def test_views_are_of_what_they_say(folder: Path) -> None:
    """Floors are at height 0 for the cameras that are told, and views differ."""
    views = Views(folder)
    assert len(views) == 6
    assert views.settings.seed == 5
    errors = []
    for index in range(len(views)):
        view = views[index]
        assert (view.labels != UNLABELLED).mean() > 0.97
        points = unproject(view.depth * np.float32(0.001), view.camera, view.mount.matrix())
        errors.append(points[2][view.labels == FLOOR])
    heights = np.concatenate(errors)
    assert len(heights) > 500
    assert np.percentile(np.abs(heights), 90) < 0.02
    assert len({views[index].camera.fx for index in range(6)}) == 6


def test_views_that_are_there_are_kept(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A second run draws nothing; other settings are refused."""
    before = (folder / 'home-00001.npz').stat().st_mtime_ns
    write_views(replace(TINY, out=str(folder)))
    assert (folder / 'home-00001.npz').stat().st_mtime_ns == before
    with pytest.raises(ValueError, match='other settings'):
        write_views(replace(TINY, out=str(folder), views=7))
    capfd.readouterr()


def test_views_that_can_not_be_read_are_refused(folder: Path, tmp_path: Path) -> None:
    """An empty folder, a file that is missing and one that is cut, in one sentence each."""
    with pytest.raises(ValueError, match='holds no views of homes'):
        Views(tmp_path)
    (tmp_path / 'settings.json').write_bytes((folder / 'settings.json').read_bytes())
    with pytest.raises(ValueError, match=r'home-00001\.npz is missing or damaged'):
        Views(tmp_path)
    whole = (folder / 'home-00001.npz').read_bytes()
    (tmp_path / 'home-00001.npz').write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r'home-00001\.npz is missing or damaged'):
        Views(tmp_path)


def test_spoiled_views_are_still_of_the_same_room(room: list[View]) -> None:
    """Cut, mirrored, scaled and noisy as they are, the floor is below and faces up."""
    floors, walls, low = [], [], []
    for number in range(60):
        seen, labels = spoil(room[number % 6], np.random.default_rng(number))
        assert seen.shape[1:] == labels.shape == spoiled_views.CROP
        assert np.isfinite(seen).all()
        there = seen[7] > 0
        floor, wall = (there & (labels == label) for label in (FLOOR, WALL))
        if floor.sum() > 200 and wall.sum() > 200:
            floors.append(float(np.median(seen[6][floor])))
            low.append(float(np.median(np.abs(seen[5][floor]))))
            walls.append(float(np.median(seen[6][wall])))
    assert len(floors) > 20
    # Where noise is larger than the distance of pixels, normals point anywhere.
    assert np.median(floors) > 0.6
    assert np.median(np.abs(walls)) < 0.1
    # In units of 0.3 m, with errors of the pose.
    assert np.median(low) < 0.15


def test_a_mirrored_view_has_a_mirrored_camera(room: list[View]) -> None:
    """Points of a mirrored view are the mirrored points of the view."""
    view = room[0]._replace(depth=np.full((120, 160), 2000, np.uint16))
    planes = []
    for number in range(30):
        rng = np.random.default_rng(number)
        part = spoiled_views._part(view, rng)
        points = unproject(part.depth * np.float32(0.001), part.camera, part.mount.matrix())
        planes.append((part.mount.roll, points[2]))
    assert {np.sign(roll) for roll, _ in planes} == {-1.0, 1.0}
    # The picture of a rolled camera is higher on one side; mirrored, on the other.
    for roll, height in planes:
        tilt = height[:, -1].mean() - height[:, 0].mean()
        assert np.sign(tilt) == -np.sign(roll)


def test_what_is_drawn_depends_on_the_seed_alone(room: list[View]) -> None:
    """The same seed spoils a view in the same way, another one in another way."""
    first, again, other = (spoil(room[1], np.random.default_rng(seed)) for seed in (3, 3, 4))
    assert np.array_equal(first.seen, again.seen)
    assert not np.array_equal(first.seen, other.seen)


def test_rare_classes_count_for_more_and_all_for_one(folder: Path) -> None:
    """Over all pixels the weights are 1 on the average."""
    views = Views(folder)
    weights = class_weights(views).numpy()
    counts = np.bincount(views.labels[views.labels != UNLABELLED], minlength=len(CLASSES))
    assert abs((weights * counts).sum() / counts.sum() - 1) < 1e-5
    assert weights[counts.argmin()] > weights[counts.argmax()]


def test_an_interrupted_training_goes_on_as_if_nothing_had_happened(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped after its checkpoint and started again, a run ends with the very same weights."""
    views = Views(folder)

    def fresh() -> PixelNetwork:
        torch.manual_seed(0)
        return PixelNetwork(NetworkConfig(widths=(8, 8), blocks=(1, 1)))

    whole, resumed = fresh(), fresh()
    losses = train_segmentation.train(
        whole, views, replace(SMALL, out=str(tmp_path / 'whole')), ALONE
    )
    assert set(losses) == {'classes', 'free'}

    class StopError(Exception):
        """Ends a run in the middle."""

    batch = train_segmentation.batch

    def stop(*arguments: object) -> tuple[Tensor, Tensor]:
        if arguments[-1] == 3:
            raise StopError
        return batch(*arguments)  # type: ignore[arg-type]

    stopped = replace(SMALL, out=str(tmp_path / 'stopped'))
    monkeypatch.setattr(train_segmentation, 'batch', stop)
    with pytest.raises(StopError):
        train_segmentation.train(resumed, views, stopped, ALONE)
    monkeypatch.undo()
    resumed = fresh()
    train_segmentation.train(resumed, views, stopped, ALONE)
    for name, tensor in whole.state_dict().items():
        assert torch.equal(resumed.state_dict()[name], tensor), name


def test_a_network_learns_what_it_is_shown(room: list[View]) -> None:
    """Within a few steps, the losses of a small network fall to a part of what they were."""
    torch.manual_seed(0)
    network = PixelNetwork(NetworkConfig(widths=(16, 24), blocks=(1, 1)))
    loss = train_segmentation.SegmentationLoss(network, torch.ones(len(CLASSES)))
    samples = [spoil(view, np.random.default_rng(1)) for view in room]
    seen = torch.from_numpy(np.stack([sample.seen for sample in samples]))
    labels = torch.from_numpy(np.stack([sample.labels for sample in samples])).long()
    optimizer = torch.optim.Adam(network.parameters(), lr=0.02)
    totals = []
    for _ in range(12):
        optimizer.zero_grad()
        total = torch.stack(list(loss(seen, labels).values())).sum()
        total.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
        totals.append(float(total.detach()))
    assert totals[-1] < 0.5 * totals[0]


def test_unlabelled_pixels_play_no_part() -> None:
    """Whatever is said there, the losses are the same."""
    torch.manual_seed(0)
    network = PixelNetwork(NetworkConfig(widths=(8,), blocks=(1,))).eval()
    loss = train_segmentation.SegmentationLoss(network, torch.ones(len(CLASSES)))
    scores = torch.randn(1, len(CLASSES), 8, 8)
    labels = torch.randint(len(CLASSES), (1, 8, 8))
    labels[:, :, :3] = UNLABELLED
    network.forward = lambda _: scores  # type: ignore[method-assign, assignment]
    before = loss(scores, labels)
    scores[:, :, :, :3] += 5 * torch.randn(1, len(CLASSES), 8, 3)
    after = loss(scores, labels)
    for name, value in before.items():
        torch.testing.assert_close(after[name], value)


def test_scores_are_what_they_should_be() -> None:
    """Of a table of pixels that is worked out by hand."""
    confusion = np.zeros((2, len(CLASSES), len(CLASSES)), dtype=np.int64)
    confusion[0, FLOOR, FLOOR], confusion[0, FLOOR, WALL] = 60, 20
    confusion[1, WALL, WALL], confusion[1, CEILING, FLOOR] = 100, 20
    found = evaluate_segmentation.summary(confusion)
    assert found['iou']['floor'][0] == pytest.approx(60 / 100)
    assert found['iou']['wall'][0] == pytest.approx(100 / 120, abs=1e-5)
    assert found['iou']['ceiling'][0] == 0.0
    assert np.isnan(found['iou']['sofa'][0])
    assert found['mean_iou'][0] == pytest.approx((0.6 + 100 / 120) / 3, abs=1e-5)
    assert found['accuracy'][0] == pytest.approx(0.8)
    assert found['free_iou'][0] == pytest.approx(80 / 100)
    assert found['obstacle_iou'][0] == pytest.approx(100 / 120, abs=1e-5)
    value, low, high = found['iou']['floor']
    assert low <= value <= high


def arguments(folder: Path, weights: Path, tmp_path: Path) -> list[str]:
    """Return the options of an evaluation that also writes the card."""
    limits = tmp_path / 'limits.txt'
    limits.write_text('None are known.\n')
    return [
        *('--views', str(folder), '--weights', str(weights)),
        *('--limits', str(limits), '--out', str(tmp_path / 'scores.json')),
    ]


def trained(tmp_path: Path, seed: int) -> Path:
    """Return a folder with small weights that say on which homes they were trained."""
    config = NetworkConfig(widths=(8,), blocks=(1,), pixels=300)
    torch.manual_seed(0)
    record = {
        **asdict(SMALL),
        'homes': asdict(replace(TINY, seed=seed)),
        'losses': {'classes': 1.0, 'free': 0.5},
    }
    weights = tmp_path / 'weights'
    save_network(weights, config, PixelNetwork(config).state_dict(), record)
    assert load_network(weights).config == config
    return weights


@pytest.fixture
def evaluate() -> Callable[[list[str]], int]:
    """Return the command."""
    import argparse  # noqa: PLC0415

    parser = argparse.ArgumentParser()
    evaluate_segmentation.add_arguments(parser)
    return lambda options: evaluate_segmentation.run(parser.parse_args(options))


def test_an_evaluation_writes_scores_and_card(
    folder: Path,
    tmp_path: Path,
    evaluate: Callable[[list[str]], int],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Both say the same, and the card how to make the weights again."""
    weights = trained(tmp_path, TRAINING_SEED)
    assert evaluate(arguments(folder, weights, tmp_path)) == 0
    scores = json.loads((tmp_path / 'scores.json').read_text())
    assert set(scores['sigma_mm']['learned']) == {'0', '10', '30', '100'}
    mean = scores['sigma_mm']['learned']['10']['mean_iou'][0]
    card = (weights / 'README.md').read_text()
    assert f'{100 * mean:.1f} ±' in card
    assert f'--seed {TRAINING_SEED}' in card
    assert 'None are known.' in card
    assert '{' not in card
    assert f'{100 * mean:.1f} ±' in capsys.readouterr().out


def test_homes_of_the_training_are_refused(
    folder: Path, tmp_path: Path, evaluate: Callable[[list[str]], int]
) -> None:
    """Scores on what was trained on say nothing."""
    weights = trained(tmp_path, TINY.seed)
    with pytest.raises(ValueError, match='trained on homes of the seed 5'):
        evaluate(arguments(folder, weights, tmp_path))

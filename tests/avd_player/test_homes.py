"""Synthetic homes: what they hold, what pictures of them show, and what is written."""

from __future__ import annotations

import fcntl
import json
import os
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from scipy.io import loadmat

from avd_player.avd_format import DEFAULT_LENS, INSTANCES, STRUCT_FIELDS
from avd_player.homes.furniture import CEILING, FLOOR, WALL
from avd_player.homes.home import FREE, OCCUPIED, OUTSIDE
from avd_player.homes.instances import BOTTLE, BOTTLE_ID
from avd_player.homes.noise import DepthNoise, add_noise
from avd_player.homes.plan import draw_home
from avd_player.homes.rays import NOTHING, Caster
from avd_player.homes.render import HomeRenderer
from avd_player.homes.scene import HEADINGS, Box, Scan, SceneSettings
from avd_player.homes.synth import write_homes
from avd_player.homes.write import image_stem, write_scene, write_shot
from gridnav.actions import STEPS
from gridnav.rgbd import CLASSES, Camera, CameraMount
from vgdp_bringup.cli import main

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SEED, NUMBER = 5, 19
SETTINGS = SceneSettings(width=160, height=90)


@cache
def scan() -> Scan:
    """Return a small home with the poses of a scan."""
    return Scan(SEED, NUMBER, SETTINGS)


def beside() -> int:
    """Return the first image of a position next to the first one."""
    return int(scan().home.moves[0].max()) * HEADINGS


@pytest.fixture(scope='module')
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write the scene, but images of the first positions only."""
    folder = tmp_path_factory.mktemp('homes') / 'Home_119_1'
    for part in ('jpg_rgb', 'high_res_depth', 'labels'):
        (folder / part).mkdir(parents=True)
    boxes: list[list[Box]] = [[] for _ in scan().poses]
    for index in [*range(HEADINGS), *range(beside(), beside() + HEADINGS)]:
        shot = scan().shoot(index)
        boxes[index] = shot.boxes
        write_shot(folder, NUMBER, index, shot)
    write_scene(folder, scan(), boxes)
    return folder


def test_a_home_is_furnished() -> None:
    """There are rooms, furniture of nearly all classes, and one bottle within reach."""
    home = scan().home
    assert 3 <= len(home.layout.rooms) <= 6
    labels = set(home.mesh.labels.tolist())
    assert {CLASSES[label] for label in range(len(CLASSES)) if label not in labels} <= {'beam'}
    assert len(home.mesh.faces) > 10_000
    assert [thing.number for thing in home.things].count(BOTTLE_ID) == 1
    assert home.things[0].number == BOTTLE_ID
    x, y, z = home.things[0].center
    assert 0.4 < z < 1.4
    assert np.hypot(*(home.positions - (x, y)).T).min() < 0.8
    assert 0 < len(home.positions) <= SETTINGS.positions


def test_normals_point_outwards() -> None:
    """Triangles are counter-clockwise as seen from where their normals point."""
    mesh = scan().home.mesh
    a, b, c = (mesh.vertices[mesh.faces[:, corner]].astype(np.float64) for corner in range(3))
    across = np.cross(b - a, c - a)
    outward = (across * mesh.normals[mesh.faces].mean(1)).sum(1)
    assert (np.linalg.norm(across, axis=1) > 0).all()
    assert (outward > 0).mean() > 0.999


def test_positions_are_free_and_joined() -> None:
    """Positions lie on the grid, away from what the plan says is there, and moves join all."""
    home = scan().home
    plan = home.plan
    np.testing.assert_allclose(home.positions / 0.3, np.round(home.positions / 0.3), atol=1e-4)
    clear = ndimage.distance_transform_edt(plan.cells == FREE) * plan.resolution
    column, row = ((home.positions - (plan.x, plan.y)) / plan.resolution).astype(int).T
    assert clear[row, column].min() > 0.2 - 1.5 * plan.resolution
    start, action = np.nonzero(home.moves >= 0)
    end = home.moves[start, action]
    way = home.positions[end] - home.positions[start]
    np.testing.assert_allclose(way, 0.3 * STEPS[action][:, ::-1], atol=1e-6)
    assert (home.moves[end, (action + 4) % 8] == start).all()
    reached = {0}
    edge = [0]
    while edge:
        found = {int(p) for p in home.moves[edge].ravel() if p >= 0} - reached
        reached |= found
        edge = sorted(found)
    assert len(reached) == len(home.positions)


def test_the_plan_shows_rooms_and_walls() -> None:
    """Walls are occupied, most of the floor is free, and nothing outside is either."""
    home = scan().home
    cells = home.plan.cells
    assert (cells[[0, -1]] == OUTSIDE).all()
    inside = cells[cells != OUTSIDE]
    assert 0.25 < (inside == FREE).mean() < 0.75
    x, y, _ = home.things[0].center
    row, column = int((y - home.plan.y) / 0.05), int((x - home.plan.x) / 0.05)
    assert cells[row, column] == OCCUPIED


def test_a_seed_is_a_home() -> None:
    """The same seed gives the same home, another one another."""
    home, again = scan().home, draw_home([SEED, NUMBER])
    np.testing.assert_array_equal(home.mesh.vertices, again.mesh.vertices)
    np.testing.assert_array_equal(home.positions, again.positions)
    assert home.lights == again.lights


def test_nobody_stands_inside_of_anything() -> None:
    """No wall, column, door or bookcase is met from behind; a column stands on the floor here."""
    home = draw_home([1, 16])
    rays = np.zeros((len(home.positions), 4, 6), np.float32)
    rays[..., :2], rays[..., 2] = home.positions[:, None], 0.7
    rays[..., 3:5] = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    hit = Caster(home.mesh).cast(rays)
    met = hit['primitive_ids']
    solid = [CLASSES.index(name) for name in ('wall', 'column', 'door', 'bookcase')]
    from_behind = (hit['primitive_normals'] * rays[..., 3:]).sum(axis=-1) > 0
    assert (met != NOTHING).all()
    assert not (from_behind & np.isin(home.mesh.labels[met], solid)).any()


def test_a_home_needs_positions() -> None:
    """Too small homes are refused."""
    with pytest.raises(ValueError, match='not for 10'):
        draw_home(1, positions=10)


def test_pictures_without_distortion() -> None:
    """Straight down is the floor, straight up the ceiling, at the distances that they have."""
    home = scan().home
    camera = Camera(33, 25, 100.0, 100.0, 16.0, 12.0)
    renderer = HomeRenderer(home, camera)
    x, y = home.positions[0]
    for pitch, label, distance in (
        (np.pi / 2, FLOOR, 1.2),
        (-np.pi / 2, CEILING, home.layout.height - 1.2),
    ):
        picture = renderer.render(CameraMount(x, y, 1.2, 0.0, pitch, 0.0).matrix())
        seen = picture.labels == label
        assert seen.any()
        np.testing.assert_allclose(np.median(picture.depth[seen]), distance, atol=0.02)
    assert picture.rgb.shape == (25, 33, 3)
    assert picture.rgb.std() > 0


def test_lens_and_directions_agree() -> None:
    """What is projected comes back to its pixel."""
    lens = DEFAULT_LENS.resized(96, 54)
    pixels = lens.project(lens.directions()[..., :2].astype(np.float64)) - 0.5
    u, v = np.meshgrid(np.arange(96), np.arange(54))
    np.testing.assert_allclose(pixels, np.stack([u, v], -1), atol=1e-3)


def written(scene: Path, index: int) -> tuple[NDArray[np.float64], ...]:
    """Return depth, rotation and position in metres of an image, from the files."""
    file = loadmat(scene / 'image_structs.mat')
    one = file['image_structs'][0, index]
    with Image.open(scene / 'high_res_depth' / f'{image_stem(NUMBER, index, 3)}.png') as image:
        depth = np.asarray(image, np.float64) / 1000
    return depth, one['R'], one['world_pos'].ravel() * float(file['scale'][0, 0]) / 1000


def pixels_of(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the columns and rows (N, 2) where the scan's camera has points (N, 3)."""
    return scan().lens.project(points[:, :2] / points[:, 2:]) - 0.5


@pytest.mark.parametrize('turned', [True, False])
def test_two_views_agree(scene: Path, *, turned: bool) -> None:
    """What two images see of the same surface is in the same place to 5 mm, as written.

    All but one in a thousand: surfaces that are seen at a grazing angle are not linear enough.
    """
    far = [float(np.median(written(scene, index)[0])) for index in range(HEADINGS)]
    first = int(np.argmax(far))
    other = (first + 1) % HEADINGS if turned else beside() + first
    depth, rotation, place = written(scene, first)
    world = (scan().lens.directions() * depth[..., None]) @ rotation + place
    depth, rotation, place = written(scene, other)
    local = (world.reshape(-1, 3) - place) @ rotation.T
    local = local[local[:, 2] > 0.2]
    u, v = pixels_of(local).T
    inside = (u > 1) & (u < SETTINGS.width - 2) & (v > 1) & (v < SETTINGS.height - 2)
    u, v, ahead = u[inside], v[inside], local[inside, 2]
    # On flat surfaces the inverse of depth is linear between pixels.
    inverse = 1 / depth
    there = 1 / ndimage.map_coordinates(inverse, [v, u], order=1)
    bent = np.abs(ndimage.laplace(inverse)) > 1e-3
    near_edge = ndimage.binary_dilation(bent, iterations=2)
    same = ~near_edge[v.round().astype(int), u.round().astype(int)]
    # What is hidden from the other view is much farther away than what that sees.
    same &= ahead - there < 0.1
    assert same.sum() > 200
    assert np.quantile(np.abs(there - ahead)[same], 0.999) < 0.005


def test_the_mat_file_is_as_others_read_it(scene: Path) -> None:
    """Its fields, shapes and conventions are AVD's."""
    file = loadmat(scene / 'image_structs.mat')
    structs = file['image_structs']
    assert structs.dtype.names == STRUCT_FIELDS
    assert structs.shape == (1, len(scan().poses))
    assert np.issubdtype(file['scale'].dtype, np.integer)
    for index in (0, 5, structs.shape[1] - 1):
        one = structs[0, index]
        assert str(one['image_name'][0]) == f'{image_stem(NUMBER, index)}.jpg'
        assert float(one['cluster_id'][0, 0]) == index // HEADINGS
    for one in structs[0]:
        assert one['world_pos'].shape == one['direction'].shape == (3, 1)
        if not one['R'].size:
            assert not one['t'].size
            continue
        np.testing.assert_allclose(one['world_pos'], -one['R'].T @ one['t'], atol=1e-9)
        np.testing.assert_allclose(one['direction'].ravel(), one['R'][2], atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(one['quat']), 1.0)
    missing = np.array([not one['R'].size for one in structs[0]])
    assert 0 < missing.sum() < 0.05 * len(missing)
    heights = np.array([one['world_pos'][1, 0] for one in structs[0]])
    assert heights.std() > 0  # the world is tilted


def test_annotations_link_the_images(scene: Path) -> None:
    """Turns are cycles of twelve, moves lead to other positions in their direction."""
    entries = json.loads((scene / 'annotations.json').read_text())
    names = list(entries)
    assert names == [f'{image_stem(NUMBER, index)}.jpg' for index in range(len(scan().poses))]
    number = {name: index for index, name in enumerate(names)}
    poses = scan().scan_poses()
    moves = 0
    for name, entry in entries.items():
        assert next(iter(entry)) == 'bounding_boxes'
        assert entries[entry['rotate_ccw']]['rotate_cw'] == name
        first = number[name] // HEADINGS
        assert number[entry['rotate_ccw']] // HEADINGS == first
        if entry['forward']:
            moves += 1
            there = number[entry['forward']]
            assert there // HEADINGS != first
            way = (poses[there, :3, 3] - poses[number[name], :3, 3])[[0, 2]]
            ahead = poses[number[name], [0, 2], 2]
            assert np.linalg.norm(way) < 0.75
            assert way @ ahead / np.linalg.norm(way) / np.linalg.norm(ahead) > 0.86
    assert moves > len(entries) / 4
    for index in range(2 * HEADINGS):
        turned = poses[index, [0, 2], 2]
        assert np.isfinite(turned).all()
        angle = np.degrees(np.arctan2(turned[1], turned[0]))
        assert abs((angle - 30 * (index % HEADINGS) + 180) % 360 - 180) < 3


def test_boxes_hold_their_things() -> None:
    """The bottle has a box in some image, at its place."""
    home = scan().home
    x, y, _ = home.things[0].center
    away = np.hypot(*(home.positions - (x, y)).T)
    boxes = []
    for position in np.argsort(np.abs(away - 1.2))[:4].tolist():
        for index in range(position * HEADINGS, (position + 1) * HEADINGS):
            toward = np.arctan2(y - scan().poses[index, 1, 3], x - scan().poses[index, 0, 3])
            ahead = np.arctan2(scan().poses[index, 1, 2], scan().poses[index, 0, 2])
            if np.cos(toward - ahead) < 0.9:
                continue
            for box in scan().shoot(index).boxes:
                if box.instance == BOTTLE_ID:
                    boxes.append(box)
                    local = (home.things[0].points[:, :3] - scan().poses[index, :3, 3]) @ (
                        scan().poses[index, :3, :3]
                    )
                    u, v = pixels_of(local.astype(np.float64)).mean(0)
                    assert box.xmin - 2 <= u <= box.xmax + 2
                    assert box.ymin - 3 <= v <= box.ymax + 3
    assert boxes


def test_files_beside_the_images(scene: Path) -> None:
    """Cameras, names and the truth are there."""
    line = (scene / 'cameras.txt').read_text().splitlines()[3].split()
    assert line[1:4] == ['OPENCV_FISHEYE', '160', '90']
    assert len(line) == 12
    names = (scene / 'present_instance_names.txt').read_text().split()
    assert BOTTLE in names
    assert set(names) <= set(INSTANCES)
    truth = json.loads((scene / 'ground_truth.json').read_text())
    arrays = np.load(scene / 'ground_truth.npz')
    np.testing.assert_array_equal(arrays['plan'], scan().home.plan.cells)
    # The camera is as high above the floor of the home's frame as the truth says.
    structs = loadmat(scene / 'image_structs.mat')
    center = structs['image_structs'][0, 0]['world_pos'].ravel() * structs['scale'][0, 0] / 1000
    home = np.array(truth['scan_to_home']) @ [*center, 1.0]
    np.testing.assert_allclose(home[2], truth['camera_height'], atol=1e-6)
    np.testing.assert_allclose(home[:2], arrays['positions'][0], atol=0.01)
    with Image.open(scene / 'labels' / f'{image_stem(NUMBER, 0, 4)}.png') as image:
        labels = np.asarray(image)
    assert labels.dtype == np.uint8
    assert WALL in labels


def test_noise() -> None:
    """Each error of a depth camera does what it says, the same for the same draw."""
    depth = np.full((40, 60), 2000, np.uint16)
    depth[:, 30:] = 3000
    depth[0] = 0
    color = np.full((40, 60, 3), 200, np.uint8)
    color[20:] = 0

    def noisy(noise: DepthNoise) -> NDArray[np.uint16]:
        return add_noise(depth, noise, np.random.default_rng(1), color)

    np.testing.assert_array_equal(noisy(DepthNoise()), depth)
    gauss = noisy(DepthNoise(sigma=30.0))
    assert (gauss[0] == 0).all()
    assert 25 < (gauss[1:].astype(float) - depth[1:]).std() < 35
    np.testing.assert_array_equal(gauss, noisy(DepthNoise(sigma=30.0)))
    assert set(noisy(DepthNoise(step=700.0)).ravel().tolist()) == {0, 2100, 2800}
    lost = noisy(DepthNoise(edges=1.0)) == 0
    assert lost[5, 29:31].all()
    assert not lost[5, :28].any()
    assert (noisy(DepthNoise(dark=1.0)) == 0)[20:].all()
    metres = add_noise(
        (depth / 1000).astype(np.float32), DepthNoise(sigma=30.0), np.random.default_rng(1), color
    )
    np.testing.assert_allclose(metres, gauss / 1000, atol=1e-3)


@pytest.mark.parametrize(
    'change', [{'sigma': -1.0}, {'step': float('nan')}, {'edges': 2.0}, {'dark': -0.1}]
)
def test_noise_out_of_range(change: dict[str, float]) -> None:
    """Errors that make no sense are refused."""
    with pytest.raises(ValueError, match='got'):
        DepthNoise(**change)


def test_scenes_are_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A complete scene is kept, part of one is made anew, other options are refused."""
    from avd_player.homes import synth  # noqa: PLC0415

    monkeypatch.setattr(synth, 'Scan', lambda *_: scan())
    shot = scan().shoot(0)
    monkeypatch.setattr(scan(), 'shoot', lambda _index: shot)
    monkeypatch.setattr(synth, 'write_shot', lambda *_: None)
    part = tmp_path / '.Home_119_1.part'
    part.mkdir()
    (part / 'left').write_text('from before')
    write = partial(write_homes, settings=SETTINGS, first=NUMBER, progress=False)
    descriptor = os.open(part, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with pytest.raises(OSError, match='Another process is writing'):
        write(tmp_path, 1, SEED)
    os.close(descriptor)
    assert write(tmp_path, 1, SEED) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'Home_119_1',
        'instance_id_map.txt',
    ]
    made = {path.name: path.read_bytes() for path in (tmp_path / 'Home_119_1').glob('*.*')}
    assert 'left' not in made
    assert write(tmp_path, 1, SEED) == 0
    with pytest.raises(ValueError, match='other options'):
        write(tmp_path, 1, SEED + 1)
    write(tmp_path / 'again', 1, SEED)
    again = tmp_path / 'again' / 'Home_119_1'
    assert made == {path.name: path.read_bytes() for path in again.glob('*.*')}


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        (['--scenes', '0'], 'scenes'),
        (['--first', '900'], '799'),
        (['--width', '4000'], '4000'),
        (['--noise-sigma', '-3'], '-3'),
        (['--jitter', '99'], '99'),
    ],
)
def test_bad_options(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What can't be used is said in one sentence."""
    assert main(['avd', 'synth', str(tmp_path), *options]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count('\n') == 1

"""Evidence for cells."""

from __future__ import annotations

import numpy as np
import pytest

from bev_mapper.evidence_grid import Crop, Evidence, EvidenceGrid
from gridnav.grid import GridGeometry

GEOMETRY = GridGeometry(40, 40, 0.1)
CAMERA = (0.55, 2.05, 1.2)
FREE, WALL, UNKNOWN = 0, 100, -1


def make_grid(geometry: GridGeometry = GEOMETRY, growth: int = 0, **given: float) -> EvidenceGrid:
    """Return an empty grid."""
    options = {'footprint': 0.0, 'free_below': 0.3, **given}
    return EvidenceGrid(geometry, Crop(), growth=growth, max_cells=10_000, min_points=3, **options)


def spread(low: tuple[float, ...], high: tuple[float, ...], step: float = 0.02) -> np.ndarray:
    """Return points all over a box, (3, N)."""
    axes = [
        np.arange(a + step / 2, max(b, a + step), step) for a, b in zip(low, high, strict=True)
    ]
    return np.array(np.meshgrid(*axes)).reshape(3, -1)


def look(
    floor: np.ndarray | None = None,
    solid: np.ndarray | None = None,
    *,
    robot: tuple[float, float] | None = None,
    camera: tuple[float, float, float] = CAMERA,
) -> Evidence:
    """Return what a camera saw."""
    floor = np.empty((3, 0)) if floor is None else floor
    solid = np.empty((3, 0)) if solid is None else solid
    points = np.concatenate([floor, solid], axis=1)
    is_floor = np.arange(points.shape[1]) < floor.shape[1]
    rays = points[:, :: max(1, points.shape[1] // 3000)]
    return Evidence(points, is_floor, ~is_floor, np.array(camera), rays, robot)


DOOR = (slice(18, 23), slice(15, 25))
FLOOR = spread((0.0, 1.5, 0.0), (4.0, 2.6, 0.0))
PERSON = spread((2.0, 1.9, 0.0), (2.1, 2.2, 1.5), 0.05)


def test_one_bad_label_does_not_close_a_door() -> None:
    """Not even three in a row, and what was wrong is forgotten soon."""
    grid = make_grid()
    for _ in range(6):
        grid.update(look(FLOOR))
    assert (grid.occupancy[DOOR] == FREE).all()
    for _ in range(3):
        raised = FLOOR + np.array([[0.0], [0.0], [0.5]])
        grid.update(look(solid=raised))
        assert (grid.occupancy[DOOR] != WALL).all()
    for _ in range(3):
        grid.update(look(FLOOR))
    assert (grid.occupancy[DOOR] == FREE).all()


def test_the_first_look_at_an_obstacle_counts() -> None:
    """A planner does not have to wait."""
    grid = make_grid()
    grid.update(look(FLOOR, PERSON))
    assert (grid.occupancy[19:22, 20] == WALL).all()
    assert grid.probability[20, 20] == 70


def test_a_person_who_walked_through_is_forgotten() -> None:
    """Once the wall behind is seen through where they stood."""
    grid = make_grid()
    wall = spread((3.9, 1.5, 0.0), (3.95, 2.6, 2.5), 0.03)
    for _ in range(20):
        grid.update(look(None, PERSON))
    assert (grid.occupancy[19:22, 20] == WALL).all()
    for _ in range(12):
        grid.update(look(FLOOR, wall))
    assert (grid.occupancy[19:22, 20] == FREE).all()
    assert (grid.occupancy[16:25, 39] == WALL).all()


def test_thin_legs_on_much_floor_stay_obstacles() -> None:
    """Three points of a chair's leg against hundreds of the floor in their cell."""
    grid = make_grid()
    leg = np.array([[2.03, 2.03, 2.03], [2.05, 2.05, 2.05], [0.15, 0.25, 0.35]])
    seen_floor = spread((1.5, 1.8, 0.0), (3.5, 2.3, 0.0), 0.005)
    assert ((seen_floor[0] // 0.1 == 20) & (seen_floor[1] // 0.1 == 20)).sum() > 300
    grid.update(look(seen_floor, leg))
    for number in range(12):
        # In every second look the leg is missed, and rays go by.
        grid.update(look(seen_floor, leg if number % 2 == 0 else None))
        assert grid.occupancy[20, 20] == WALL
    assert grid.occupancy[20, 21] == FREE


def test_a_speckle_is_no_obstacle() -> None:
    """Two points alone in a cell say nothing."""
    grid = make_grid()
    grid.update(look(FLOOR, np.array([[2.03, 2.03], [2.05, 2.05], [0.15, 0.25]])))
    assert grid.occupancy[20, 20] == FREE


def test_looking_over_something_does_not_clear_it() -> None:
    """A box of 0.4 m, and then rays above it to the wall behind."""
    grid = make_grid()
    box = spread((2.0, 2.0, 0.0), (2.1, 2.1, 0.4))
    grid.update(look(FLOOR, box))
    over = spread((3.9, 1.5, 0.9), (3.95, 2.6, 1.5))
    for _ in range(50):
        grid.update(look(None, over))
    assert grid.occupancy[20, 20] == WALL


def test_cells_are_free_where_the_floor_shows_or_rays_pass_close_above_it() -> None:
    """And unknown where the camera only looked over them."""
    far_floor = spread((3.0, 2.0, 0.0), (3.2, 2.1, 0.0))
    low, high = make_grid(), make_grid(free_below=0.0)
    for grid in (low, high):
        for _ in range(3):
            grid.update(look(far_floor))
        assert (grid.occupancy[20, 30:32] == FREE).all()
        assert grid.occupancy[20, 15] == UNKNOWN
    assert (low.occupancy[20, 27:29] == FREE).all()
    assert (high.occupancy[20, 15:29] == UNKNOWN).all()


def test_what_is_above_the_robot_or_below_the_floor_is_left_out() -> None:
    """Lamps, lintels and reflections."""
    grid = make_grid()
    above = spread((2.0, 2.0, 1.6), (2.3, 2.3, 2.5), 0.05)
    below = spread((2.0, 2.0, -0.6), (2.3, 2.3, -0.5), 0.05)
    grid.update(look(below, above))
    assert (grid.occupancy == UNKNOWN).all()


def test_the_robot_s_own_footprint_is_free() -> None:
    """Whatever is seen there, and the cell of its centre at least."""
    grid = make_grid(footprint=0.2)
    arm = spread((1.9, 1.9, 0.3), (2.2, 2.2, 0.5), 0.03)
    grid.update(look(None, arm, robot=(2.05, 2.05)))
    y, x = (np.indices((40, 40)) + 0.5) * 0.1
    under = np.hypot(x - 2.05, y - 2.05) <= 0.2
    assert (grid.occupancy[under] == FREE).all()
    assert (grid.occupancy[~under] != FREE).all()
    coarse = make_grid(GridGeometry(5, 5, 1.0), footprint=0.2)
    coarse.update(look(robot=(2.9, 2.1)))
    assert np.argwhere(coarse.occupancy == FREE).tolist() == [[2, 2]]


@pytest.mark.parametrize('growth', [3, 16])
def test_it_grows_by_chunks_and_cells_keep_their_places(growth: int) -> None:
    """As a grid that was large enough from the start."""
    small = make_grid(GridGeometry(3, 3, 0.1, 1.5, 1.5), growth)
    large = make_grid(GridGeometry(100, 100, 0.1, -2.5, -2.5))
    rng = np.random.default_rng(0)
    for _ in range(6):
        x, y = rng.uniform(0, 3, 2)
        floor, solid = (
            spread((x, y, 0), (x + 0.8, y + 0.9, 0)),
            spread((x, y, 0.1), (x + 0.2, y + 0.3, 0.9), 0.05),
        )
        seen = look(floor, solid, robot=(x, y), camera=(x + 1.0, y - 0.5, 1.2))
        small.update(seen)
        large.update(seen)
    offset = [
        round((small.geometry.origin_y + 2.5) / 0.1),
        round((small.geometry.origin_x + 2.5) / 0.1),
    ]
    rows, cols = small.geometry.shape
    assert {(rows - 3) % growth, (cols - 3) % growth} == {0}
    for name in ('occupancy', 'probability'):
        part = getattr(large, name)[offset[0] : offset[0] + rows, offset[1] : offset[1] + cols]
        assert np.array_equal(getattr(small, name), part)
    assert (small.occupancy != UNKNOWN).sum() == (large.occupancy != UNKNOWN).sum()
    rim = np.ones((rows, cols), dtype=np.bool_)
    rim[1:-1, 1:-1] = False
    assert (small.occupancy[rim] == UNKNOWN).all()


def test_a_map_that_would_be_too_large_is_left_as_it_was() -> None:
    """And a first one that is, is refused."""
    grid = make_grid(growth=10)
    grid.update(look(FLOOR))
    before, geometry = grid.occupancy.copy(), grid.geometry
    with pytest.raises(ValueError, match='more than the limit of 10000'):
        grid.update(look(FLOOR + 50.0 * np.array([[1.0], [1.0], [0.0]])))
    assert np.array_equal(grid.occupancy, before)
    assert grid.geometry == geometry
    with pytest.raises(ValueError, match='map is 400 x 400 cells, more than the limit of 10000'):
        make_grid(GridGeometry(400, 400, 0.1))
    grid.clear()
    assert (grid.occupancy == UNKNOWN).all()
    assert grid.geometry == GEOMETRY


def test_nothing_seen_changes_nothing() -> None:
    """A frame without depth."""
    grid = make_grid(growth=10)
    grid.update(look())
    assert (grid.occupancy == UNKNOWN).all()
    assert grid.geometry == GEOMETRY

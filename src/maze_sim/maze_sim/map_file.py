"""Maps of a map server: a YAML file that names an image and says how to read it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import yaml
from PIL import Image

from gridnav.grid import GridGeometry

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_CELLS = 4_000_000
"""Maps with more cells than this are refused: looking for ways would take the memory."""

MODES = ('trinary', 'scale')
"""Modes whose thresholds say what is free; they differ only in what is not."""

OPAQUE = 255


class WorldMap(NamedTuple):
    """A map to move in.

    Attributes:
        blocked: Cells that are not known to be free, (H, W). Row 0 is the lowest of the image.
        geometry: Where the map lies.
    """

    blocked: NDArray[np.bool_]
    geometry: GridGeometry


def read_map(path: str | Path) -> WorldMap:
    """Read a map of a map server.

    The file has the keys ``image``, ``resolution``, ``origin``, ``negate``, ``occupied_thresh``
    and ``free_thresh``, and may have ``mode`` (trinary or scale). A pixel is free if its darkness,
    or its brightness with ``negate``, is below ``free_thresh``. All others, the transparent ones
    and those that are neither free nor occupied included, are blocked.

    Args:
        path: The YAML file; the image is looked for beside it.

    Raises:
        ValueError: If a file can't be read or does not say what it should.
    """
    path = Path(path)
    settings = _read_settings(path)
    occupancy = _read_image(path.parent / str(_setting(path, settings, 'image')))
    if not _number(path, settings, 'negate'):
        occupancy = 1.0 - occupancy
    mode = settings.get('mode', MODES[0])
    if mode not in MODES:
        msg = f'{path}: the mode must be {" or ".join(MODES)}, got {mode!r}.'
        raise ValueError(msg)
    free_below = _number(path, settings, 'free_thresh')
    occupied_above = _number(path, settings, 'occupied_thresh')
    if not 0.0 < free_below <= occupied_above <= 1.0:
        msg = (
            f'{path}: free_thresh must be above 0 and at most occupied_thresh, and that at most '
            f'1, got {free_below} and {occupied_above}.'
        )
        raise ValueError(msg)
    x, y = _origin(path, settings)
    rows, cols = occupancy.shape
    try:
        geometry = GridGeometry(rows, cols, _number(path, settings, 'resolution'), x, y)
    except ValueError as error:
        msg = f'{path}: {error}'
        raise ValueError(msg) from error
    # Not a number where the image is transparent: that is not free either.
    return WorldMap(~(occupancy < free_below)[::-1], geometry)


def _read_settings(path: Path) -> dict[str, Any]:
    try:
        settings = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        msg = f'The map {path} can not be read: {error.strerror}.'
        raise ValueError(msg) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        msg = f'The map {path} is not YAML.'
        raise ValueError(msg) from error
    if not isinstance(settings, dict):
        msg = f'The map {path} has no settings.'
        raise ValueError(msg)  # noqa: TRY004 - one kind of error for a file that is no map
    return settings


def _setting(path: Path, settings: dict[str, Any], key: str) -> Any:  # noqa: ANN401
    if key not in settings:
        msg = f'{path}: {key!r} is missing.'
        raise ValueError(msg)
    return settings[key]


def _number(path: Path, settings: dict[str, Any], key: str) -> float:
    value = _setting(path, settings, key)
    if not isinstance(value, int | float) or not math.isfinite(value):
        msg = f'{path}: {key!r} must be a number, got {value!r}.'
        raise ValueError(msg)
    return float(value)


def _origin(path: Path, settings: dict[str, Any]) -> tuple[float, float]:
    """Return x and y of the lower-left corner in metres."""
    origin = _setting(path, settings, 'origin')
    if not (
        isinstance(origin, list)
        and len(origin) == 3  # noqa: PLR2004
        and all(isinstance(value, int | float) and math.isfinite(value) for value in origin)
    ):
        msg = f"{path}: 'origin' must be x, y and yaw, got {origin!r}."
        raise ValueError(msg)
    x, y, yaw = origin
    if yaw:
        msg = f'{path}: the map must not be turned, got a yaw of {yaw}.'
        raise ValueError(msg)
    return float(x), float(y)


def _read_image(path: Path) -> NDArray[np.float64]:
    """Return the brightness of an image, 0 to 1 and NaN where it is transparent, (H, W)."""
    try:
        with Image.open(path) as image:
            size = image.size
            pixels = _pixels(image) if size[0] * size[1] <= MAX_CELLS else None
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or 'it is no image'
        msg = f'The image {path} can not be read: {reason}.'
        raise ValueError(msg) from error
    if pixels is None:
        msg = f'The image {path} has {size[0]} x {size[1]} cells, more than {MAX_CELLS}.'
        raise ValueError(msg)
    return pixels


def _pixels(image: Image.Image) -> NDArray[np.float64]:
    if image.mode.startswith('I'):
        # Pillow scales grey of more than eight bits to sixteen.
        return np.asarray(image, dtype=np.float64) / 65535
    pixels = np.asarray(image.convert('RGBA'))
    brightness: NDArray[np.float64] = pixels[..., :3].mean(axis=-1) / 255
    return np.where(pixels[..., 3] < OPAQUE, np.nan, brightness)

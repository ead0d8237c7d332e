# ruff: noqa: PLR2004 - sizes of things
"""Textures that are drawn, not taken: wood, tiles, plaster, cloth and what hangs on walls.

Each is a square of `SIZE` pixels, and all but pictures can be repeated without a seam.
"""

from __future__ import annotations

import colorsys
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Colour = tuple[float, float, float]
"""Red, green and blue from 0 to 1, as screens show them."""

SIZE = 256
"""Pixels across each texture."""

LEVELS = 5
"""Each texture is kept at this many sizes, each half of the one before."""


class Material(NamedTuple):
    """What a surface looks like.

    Attributes:
        texture: Square picture, uint8 (SIZE, SIZE, 3).
        extent: Metres that it spans, 1 for pictures.
        glow: Light of its own; 0 for what only is lit.
        gloss: Share of reflected light that is mirrored, from 0 to 1.
    """

    texture: NDArray[np.uint8]
    extent: float
    glow: float = 0.0
    gloss: float = 0.0


def hsv(hue: float, saturation: float, value: float) -> Colour:
    """Return a colour by its hue, saturation and value, each from 0 to 1."""
    return colorsys.hsv_to_rgb(
        hue % 1.0, min(max(saturation, 0.0), 1.0), min(max(value, 0.0), 1.0)
    )


def noise(rng: np.random.Generator, roughness: float, stretch: float = 1.0) -> NDArray[np.float32]:
    """Draw smooth noise that can be repeated.

    Args:
        rng: Source of the draws.
        roughness: Typical number of blotches across the picture.
        stretch: How much longer they are to the right than upwards.

    Returns:
        Zero mean and unit deviation, (SIZE, SIZE).
    """
    white = np.fft.rfft2(rng.standard_normal((SIZE, SIZE)))
    up = np.fft.fftfreq(SIZE)[:, None] * SIZE
    right = np.fft.rfftfreq(SIZE)[None] * SIZE * stretch
    smooth = np.fft.irfft2(white * np.exp(-(up**2 + right**2) / (2 * roughness**2)), (SIZE, SIZE))
    smooth -= smooth.mean()
    return (smooth / max(float(smooth.std()), 1e-9)).astype(np.float32)


def _paint(colour: Colour, shade: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a colour that is made lighter and darker, (H, W, 3)."""
    return np.asarray(colour, np.float32) * (1.0 + shade[..., None])


def _finish(picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    return (picture.clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


def plain(_rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Return one colour."""
    return np.full((SIZE, SIZE, 3), np.asarray(colour) * 255.0 + 0.5).astype(np.uint8)


def plaster(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a painted wall."""
    shade = 0.015 * noise(rng, 4) + rng.uniform(0.005, 0.03) * noise(rng, rng.uniform(30, 90))
    return _finish(_paint(colour, shade))


def wallpaper(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a wall with stripes or a pattern of dots."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE * 2 * np.pi
    count = int(rng.integers(3, 9))
    pattern = np.sin(u * count) if rng.random() < 0.5 else np.sin(u * count) * np.sin(v * count)
    shade = rng.uniform(0.05, 0.2) * (pattern > rng.uniform(-0.3, 0.5)) + 0.01 * noise(rng, 60)
    return _finish(_paint(colour, shade.astype(np.float32) - 0.05))


def planks(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a wooden floor of boards or parquet."""
    rows = int(rng.choice([6, 8, 10, 12]))
    joints = int(rng.choice([1, 2, 3]))
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    row = np.floor(v * rows).astype(int)
    shifted = (u + rng.random(rows)[row]) * joints
    board = (np.floor(shifted).astype(int) % joints) + row * joints
    tone = rng.normal(0.0, rng.uniform(0.03, 0.12), rows * joints)[board]
    grain = noise(rng, 60, 12.0) * 0.05 + noise(rng, 20, 5.0) * 0.03
    gap = ((v * rows) % 1.0 < 0.035 * rows / 8) | (shifted % 1.0 < 0.006 * joints)
    return _finish(_paint(colour, (tone + grain - 0.35 * gap).astype(np.float32)))


def herringbone(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw parquet of squares whose boards change direction."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE * 4
    turned = (np.floor(u) + np.floor(v)).astype(int) % 2 == 0
    along, across = np.where(turned, u, v), np.where(turned, v, u)
    board = np.floor(across * 4).astype(int) * 4 + np.floor(along).astype(int)
    tone = rng.normal(0.0, 0.09, 64)[board % 64]
    gap = ((across * 4) % 1.0 < 0.07) | (along % 1.0 < 0.02)
    grain = np.where(turned, noise(rng, 50, 8.0), noise(rng, 50, 8.0).T) * 0.04
    return _finish(_paint(colour, (tone + grain - 0.3 * gap).astype(np.float32)))


def wood(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw the wood of furniture; the grain runs to the right."""
    rings = np.sin(noise(rng, 5, 10.0) * rng.uniform(2.0, 6.0))
    shade = rng.uniform(0.03, 0.1) * rings + 0.04 * noise(rng, 70, 20.0)
    return _finish(_paint(colour, shade.astype(np.float32)))


def tiles(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw tiles with joints, in one colour or as a chequerboard."""
    across = int(rng.choice([3, 4, 4, 6, 8]))
    down = across * int(rng.choice([1, 1, 2]))
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    column, row = np.floor(u * across).astype(int), np.floor(v * down).astype(int)
    tone = rng.normal(0.0, rng.uniform(0.005, 0.05), (down, across))[row, column]
    if rng.random() < 0.25:
        tone -= rng.uniform(0.15, 0.6) * ((column + row) % 2)
    joint = ((u * across) % 1.0 < 0.02 * across / 2) | ((v * down) % 1.0 < 0.02 * down / 2)
    picture = _paint(colour, (tone + 0.02 * noise(rng, 25)).astype(np.float32))
    picture[joint] = rng.uniform(0.35, 0.85)
    return _finish(picture)


def carpet(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a carpet."""
    shade = 0.08 * rng.standard_normal((SIZE, SIZE)) + 0.05 * noise(rng, 12)
    return _finish(_paint(colour, shade.astype(np.float32)))


def fabric(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw cloth: plain, striped or checked."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE * 2 * np.pi
    weave = 0.04 * np.sin(u * 64) * np.sin(v * 64) + 0.05 * noise(rng, 40) + 0.03 * noise(rng, 6)
    count, kind = int(rng.integers(3, 12)), rng.random()
    if kind < 0.2:
        weave = weave + rng.uniform(0.1, 0.35) * (np.sin(v * count) > 0.2)
    elif kind < 0.35:
        weave = weave + 0.15 * ((np.sin(u * count) > 0).astype(float) + (np.sin(v * count) > 0))
    return _finish(_paint(colour, weave.astype(np.float32) - 0.05))


def leather(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw leather or plastic."""
    return _finish(_paint(colour, 0.05 * noise(rng, 70) + 0.04 * noise(rng, 8)))


def stone(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw stone: speckled as granite, or veined as marble."""
    if rng.random() < 0.5:
        shade = 0.12 * noise(rng, 80) + 0.08 * noise(rng, 30)
    else:
        shade = -0.35 * np.exp(-20.0 * np.abs(noise(rng, 6, 1.6))) + 0.03 * noise(rng, 15)
    return _finish(_paint(colour, shade.astype(np.float32)))


def metal(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw brushed metal."""
    return _finish(_paint(colour, 0.04 * noise(rng, 90, 25.0) + 0.04 * noise(rng, 2)))


def concrete(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw concrete or rough stone."""
    return _finish(_paint(colour, 0.03 * noise(rng, 5) + 0.04 * noise(rng, 50)))


def bricks(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a wall of bricks."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    row = np.floor(v * 12).astype(int)
    shifted = u * 4 + 0.5 * (row % 2)
    brick = row * 4 + np.floor(shifted).astype(int) % 4
    shade = rng.normal(0, rng.uniform(0.02, 0.12), 48)[brick] + 0.04 * noise(rng, 40)
    joint = ((v * 12) % 1 < 0.12) | (shifted % 1 < 0.04)
    return _finish(_paint(colour, np.where(joint, rng.uniform(-0.3, 0.35), shade)))


def leaves(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw foliage."""
    return _finish(_paint(colour, 0.18 * noise(rng, 20, 3.0) + 0.1 * noise(rng, 60)))


def rug(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a rug with a border and an ornament; to be stretched once."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    edge = np.minimum.reduce([u, 1 - u, v, 1 - v])
    waves = rng.integers(3, 12, 2)
    ornament = np.sin(u * 2 * np.pi * waves[0]) * np.sin(v * 2 * np.pi * waves[1])
    other = np.asarray(hsv(rng.random(), rng.uniform(0.1, 0.7), rng.uniform(0.3, 0.9)), np.float32)
    picture = _paint(colour, 0.08 * rng.standard_normal((SIZE, SIZE)).astype(np.float32))
    mix = (ornament > rng.uniform(0.1, 0.8)) | ((edge > 0.05) & (edge < rng.uniform(0.06, 0.12)))
    picture[mix] = 0.3 * picture[mix] + 0.7 * other
    return _finish(picture)


def painting(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a picture: a landscape, fields of colour or blotches; to be stretched once."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    picture = _paint(colour, 0.1 * noise(rng, 6))
    kind = rng.integers(3)
    if kind == 0:
        for height in np.sort(rng.uniform(0.15, 0.8, 4))[::-1].tolist():
            below = v < height + 0.06 * noise(rng, 3)[0][None]
            picture[below] = hsv(rng.random(), rng.uniform(0.2, 0.8), rng.uniform(0.2, 0.9))
    elif kind == 1:
        for _ in range(int(rng.integers(4, 10))):
            (left, right), (low, high) = np.sort(rng.random((2, 2)), axis=1).tolist()
            inside = (u > left) & (u < right) & (v > low) & (v < high)
            picture[inside] = hsv(rng.random(), rng.uniform(0.1, 1.0), rng.uniform(0.1, 1.0))
    else:
        for _ in range(int(rng.integers(3, 7))):
            blotch = noise(rng, 3) > rng.uniform(0.6, 1.4)
            picture[blotch] = hsv(rng.random(), rng.uniform(0.1, 0.9), rng.uniform(0.1, 1.0))
    return _finish(picture + 0.02 * noise(rng, 70)[..., None])


def writing(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a board with lines of writing, or notes pinned to it; to be stretched once."""
    picture = _paint(colour, 0.02 * noise(rng, 5) + 0.02 * noise(rng, 60))
    dark = sum(colour) > 1.5
    if rng.random() < 0.5:
        ink = hsv(rng.random(), rng.uniform(0.0, 0.9), 0.25 if dark else 0.95)
        for _ in range(int(rng.integers(0, 9))):
            row, left = int(rng.integers(20, 236)), int(rng.integers(10, 150))
            length = int(rng.integers(30, 100))
            wave = (row + 4 * np.sin(np.arange(length) * rng.uniform(0.5, 1.5))).astype(int)
            for thick in range(3):
                picture[wave + thick, left + np.arange(length)] = ink
    else:
        for _ in range(int(rng.integers(2, 12))):
            row, left = rng.integers(10, 200, 2).tolist()
            high, wide = rng.integers(20, 50, 2).tolist()
            note = hsv(rng.random(), rng.uniform(0.0, 0.6), rng.uniform(0.7, 1.0))
            picture[row : row + high, left : left + wide] = note
    return _finish(picture)


def spines(rng: np.random.Generator, _colour: Colour) -> NDArray[np.uint8]:
    """Draw the backs of books; to be stretched once over a row of them."""
    picture = np.zeros((SIZE, SIZE, 3), np.float32)
    left = 0
    while left < SIZE:
        right = left + int(rng.integers(6, 18))
        back = hsv(rng.random(), rng.uniform(0.0, 0.9), rng.uniform(0.1, 0.95))
        picture[:, left:right] = back
        picture[:, left : left + 1] *= 0.4
        low = int(rng.integers(20, 180))
        picture[low : low + int(rng.integers(6, 50)), left + 2 : right - 2] = 1.0 - np.array(back)
        left = right
    return _finish(picture)


def outside(rng: np.random.Generator, _colour: Colour) -> NDArray[np.uint8]:
    """Draw what is seen through a window: sky, and trees or houses; to be stretched once."""
    v, u = np.mgrid[0:SIZE, 0:SIZE] / SIZE
    sky = np.array(hsv(rng.uniform(0.52, 0.62), rng.uniform(0.05, 0.5), 0.97), np.float32)
    picture = sky * (0.9 + 0.1 * v[..., None].astype(np.float32))
    picture += 0.03 * noise(rng, 4, 0.5)[..., None]
    kind = rng.random()
    if kind < 0.5:
        for depth in range(3):
            crowns = rng.uniform(0.2, 0.55) - 0.1 * depth + 0.04 * noise(rng, 6)[0]
            green = hsv(rng.uniform(0.15, 0.4), rng.uniform(0.2, 0.6), 0.6 - 0.15 * depth)
            below = v < crowns + 0.01 * noise(rng, 50)
            picture[below] = _paint(green, 0.1 * noise(rng, 30))[below]
    elif kind < 0.85:
        wall = hsv(rng.uniform(0, 0.15), rng.uniform(0.05, 0.5), rng.uniform(0.4, 0.85))
        house = (v < rng.uniform(0.4, 0.95)) & (np.abs(u - rng.random()) < rng.uniform(0.2, 0.6))
        picture[house] = _paint(wall, 0.03 * noise(rng, 40))[house]
        count = rng.integers(3, 7)
        window = house & ((u * count) % 1 > 0.55) & ((v * count) % 1 > 0.45)
        picture[window] = hsv(0.6, 0.2, rng.uniform(0.15, 0.4))
    return _finish(picture.astype(np.float32))


def package(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw the print of a package: a band, a field and lines of text; to be stretched once."""
    picture = _paint(colour, 0.02 * noise(rng, 30))
    band = rng.integers(30, 150, 2).tolist()
    other = hsv(rng.random(), rng.uniform(0.2, 1.0), rng.uniform(0.5, 1.0))
    picture[band[0] : band[0] + 50] = other
    picture[band[1] : band[1] + 70, 60:190] = 0.6 * np.asarray(colour) + 0.4
    for row in rng.integers(10, 240, 8).tolist():
        picture[row : row + 4, 50 : int(rng.integers(80, 220))] = 0.95
    return _finish(picture)


def cola(rng: np.random.Generator, colour: Colour) -> NDArray[np.uint8]:
    """Draw a red label with a white wave; to be stretched once around a bottle."""
    picture = _paint(colour, 0.02 * noise(rng, 30))
    u = np.arange(SIZE)
    for phase in (0.0, np.pi):
        wave = (SIZE * (0.5 + 0.12 * np.sin(u / SIZE * 4 * np.pi + phase))).astype(int)
        for thick in range(-14, 14):
            picture[wave + thick, u] = 0.95
    picture[:12], picture[-12:] = 0.95, 0.95
    return _finish(picture)


PICTURES = frozenset({rug, painting, writing, spines, outside, package, cola})
"""Textures that are stretched over their surface once."""


class _Recipe(NamedTuple):
    texture: Callable[[np.random.Generator, Colour], NDArray[np.uint8]]
    colour: Colour
    extent: float
    glow: float
    gloss: float


class Materials:
    """The materials of one home, in the order in which they were added."""

    def __init__(self, seed: int) -> None:
        """Begin without any; their textures follow from the seed."""
        self._seed = seed
        self._recipes: list[_Recipe] = []
        self._plain: dict[tuple[int, ...], int] = {}

    def add(
        self,
        texture: Callable[[np.random.Generator, Colour], NDArray[np.uint8]],
        colour: Colour,
        extent: float = 1.0,
        *,
        glow: float = 0.0,
        gloss: float = 0.0,
    ) -> int:
        """Add a material and return its number.

        Args:
            texture: Draws it.
            colour: Its main colour.
            extent: Metres that the texture spans; 1 for pictures.
            glow: Light of its own.
            gloss: Share of reflected light that is mirrored.
        """
        extent = 1.0 if texture in PICTURES else extent
        self._recipes.append(_Recipe(texture, colour, extent, glow, gloss))
        return len(self._recipes) - 1

    def colour(self, colour: Colour, *, glow: float = 0.0, gloss: float = 0.0) -> int:
        """Return the number of a material of one colour; the same one for nearly the same."""
        key = *(round(part * 24) for part in colour), round(glow * 10), round(gloss * 10)
        if key not in self._plain:
            self._plain[key] = self.add(plain, colour, glow=glow, gloss=gloss)
        return self._plain[key]

    def draw(self) -> tuple[Material, ...]:
        """Draw all of them, which is left to the end as it takes the longest."""
        return tuple(
            Material(
                recipe.texture(np.random.default_rng([self._seed, number]), recipe.colour),
                recipe.extent,
                recipe.glow,
                recipe.gloss,
            )
            for number, recipe in enumerate(self._recipes)
        )

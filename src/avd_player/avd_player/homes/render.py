"""Pictures of homes: colour, depth, classes and things, by casting a ray for each pixel."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from avd_player.distortion import Lens
from avd_player.homes.light import GAMMA, bake
from avd_player.homes.rays import NOTHING, Caster
from avd_player.homes.textures import LEVELS, SIZE
from gridnav.rgbd import UNLABELLED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from avd_player.homes.home import Home
    from avd_player.homes.textures import Material
    from gridnav.rgbd import Camera

LEAST_GLOSS = 0.05
"""Less glossy surfaces mirror nothing."""

BRIGHTNESS = 0.2
"""Mean of the light that exposure aims at, from 0 to 1."""


class Picture(NamedTuple):
    """What the camera sees; H and W are its pixels.

    Attributes:
        rgb: uint8 (H, W, 3).
        depth: Metres along the optical axis, 0 where there is nothing, float32 (H, W).
        labels: Indices into `gridnav.rgbd.CLASSES`, `UNLABELLED` where there is nothing, uint8
            (H, W).
        instances: 1 for the first of the home's things, and so on, 0 elsewhere, uint8 (H, W).
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    labels: NDArray[np.uint8]
    instances: NDArray[np.uint8]


class HomeRenderer:
    """Draws pictures of a home.

    Attributes:
        home: The home.
        caster: Casts rays at it.
    """

    def __init__(self, home: Home, camera: Camera | Lens) -> None:
        """Compute the light in the home; takes some seconds.

        Args:
            home: The home.
            camera: Of the pictures; a lens has its distortion in them.

        Raises:
            ValueError: If open3d is missing.
        """
        self.home = home
        self.caster = Caster(home.mesh)
        mesh = home.mesh
        light = bake(mesh, home.materials, home.lights, self.caster)
        # What is needed at the three corners of a triangle, side by side in memory.
        self._corners = np.concatenate([light, mesh.uvs], 1)[mesh.faces].astype(np.float32)
        glow = np.array([material.glow for material in home.materials], np.float32)
        own = glow[mesh.materials]
        self._corners[own > 0, :, :3] = own[own > 0, None, None]
        extents = np.array([material.extent for material in home.materials], np.float32)
        self._corners[:, :, 3:] *= (SIZE / extents[mesh.materials])[:, None, None]
        self._texels = SIZE / extents
        self._gloss = np.array([material.gloss for material in home.materials], np.float32)
        self._atlas = _atlas(home.materials)
        self._linear = ((np.arange(256) / 255.0) ** GAMMA).astype(np.float32)
        self._screen = ((np.linspace(0.0, 1.0, 4096) ** (1 / GAMMA)) * 255.0 + 0.5).astype(
            np.uint8
        )
        self.set_camera(camera)

    def set_camera(self, camera: Camera | Lens) -> None:
        """Draw with another camera from now on."""
        if isinstance(camera, Lens):
            self._directions = camera.directions()
        else:
            u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
            x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
            self._directions = np.stack([x, y, np.ones_like(x)], -1).astype(np.float32)
        self._pixel = 1.0 / camera.fx

    def render(self, camera_to_world: NDArray[np.float64]) -> Picture:
        """Draw what the camera sees.

        Args:
            camera_to_world: What takes points of the optical frame to the home's, (4, 4).
        """
        shape = self._directions.shape[:2]
        rays = np.empty((*shape, 6), np.float32)
        rays[..., :3] = camera_to_world[:3, 3]
        rays[..., 3:] = self._directions @ camera_to_world[:3, :3].T.astype(np.float32)
        rays = rays.reshape(-1, 6)
        hit = self.caster.cast(rays)
        seen = hit['primitive_ids'] != NOTHING
        triangles = np.where(seen, hit['primitive_ids'], 0).astype(np.int64)
        depth = np.where(seen, hit['t_hit'], np.float32(0.0))
        mesh = self.home.mesh
        light = self.radiance(triangles, hit['primitive_uvs'], depth)
        self._add_mirrored(light, triangles, rays, hit)
        labels = np.where(seen, mesh.labels[triangles], np.uint8(UNLABELLED))
        instances = np.where(seen, mesh.instances[triangles], np.uint8(0))
        return Picture(
            self.expose(light).reshape(*shape, 3),
            depth.reshape(shape),
            labels.reshape(shape),
            instances.reshape(shape),
        )

    def radiance(
        self,
        triangles: NDArray[np.int64],
        weights: NDArray[np.float32],
        depth: NDArray[np.float32],
    ) -> NDArray[np.float32]:
        """Return the light that comes from points of triangles.

        Args:
            triangles: Their numbers, (N,).
            weights: Of the second and third corner, (N, 2).
            depth: From where they are seen, for the size of the texture, metres, (N,).

        Returns:
            Red, green and blue, linear, (N, 3).
        """
        corners = self._corners[triangles]
        u, v = weights[:, :1], weights[:, 1:]
        mixed = corners[:, 0] * (1 - u - v) + corners[:, 1] * u + corners[:, 2] * v
        materials = self.home.mesh.materials[triangles]
        # Far away, pixels are larger than those of the textures: take a smaller texture.
        blur = np.log2(np.maximum(depth * self._pixel * self._texels[materials], 1.0))
        level = np.minimum(blur.astype(np.int32), LEVELS - 1)
        side = SIZE >> level
        place = np.floor(mixed[:, 3:]).astype(np.int32) & (SIZE - 1)
        place >>= level[:, None]
        index = _STARTS[level] + materials * _TEXELS + place[:, 1] * side + place[:, 0]
        light: NDArray[np.float32] = self._linear[self._atlas[index]] * mixed[:, :3]
        return light

    def _add_mirrored(
        self,
        light: NDArray[np.float32],
        triangles: NDArray[np.int64],
        rays: NDArray[np.float32],
        hit: dict[str, NDArray[Any]],
    ) -> None:
        """Add what glossy surfaces mirror."""
        gloss = self._gloss[self.home.mesh.materials[triangles]]
        glossy = np.flatnonzero(gloss >= LEAST_GLOSS)
        if not len(glossy):
            return
        # As if the surface were flat: round things mirror light in facets.
        normals = hit['primitive_normals'][glossy]
        way = rays[glossy, 3:]
        along = way / np.sqrt((way**2).sum(1, keepdims=True))
        slope = (along * normals).sum(1, keepdims=True)
        mirrored = along - 2 * slope * normals
        start = rays[glossy, :3] + hit['t_hit'][glossy, None] * way + normals * np.float32(0.002)
        second = self.caster.cast(np.concatenate([start, mirrored], 1, dtype=np.float32))
        found = second['primitive_ids'] != NOTHING
        other = np.where(found, second['primitive_ids'], 0).astype(np.int64)
        far = np.where(found, second['t_hit'] + hit['t_hit'][glossy], np.float32(0.0))
        # Flat views mirror more (Schlick).
        share = gloss[glossy, None] + (1 - gloss[glossy, None]) * (1 + slope).clip(0, 1) ** 5
        share *= found[:, None]
        mirror = self.radiance(other, second['primitive_uvs'], far)
        light[glossy] = (1 - share) * light[glossy] + share * mirror

    def expose(self, light: NDArray[np.float32]) -> NDArray[np.uint8]:
        """Turn the light of a picture into its colours, uint8 (N, 3)."""
        mean = float(light.mean())
        # As in a camera, exposure makes up for most of what is too dark or too bright.
        light = light * (np.float32(BRIGHTNESS / max(mean, 1e-4)) ** np.float32(0.8))
        light = light / (1.0 + 0.35 * light) * np.float32(1.25)
        return self._screen[(light.clip(0.0, 1.0) * np.float32(4095.0)).astype(np.int32)]


_SIZES = SIZE >> np.arange(LEVELS)
_STARTS = np.concatenate([[0], np.cumsum(_SIZES**2)[:-1]]).astype(np.int32)
_TEXELS = int((_SIZES**2).sum())


def _atlas(materials: Sequence[Material]) -> NDArray[np.uint8]:
    """Return the textures at all sizes one after the other, (pixels, 3)."""
    parts = []
    for material in materials:
        picture = material.texture.astype(np.float32)
        for _ in range(LEVELS):
            parts.append((picture + 0.5).astype(np.uint8).reshape(-1, 3))
            picture = 0.25 * (
                picture[::2, ::2] + picture[1::2, ::2] + picture[::2, 1::2] + picture[1::2, 1::2]
            )
    return np.concatenate(parts)

"""Casting rays with open3d, which is loaded when it is first needed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from avd_player.homes.mesh import Mesh

NOTHING = np.uint32(0xFFFFFFFF)
"""The triangle that a ray meets that meets none."""


class Caster:
    """Triangles that rays are cast at, by one thread."""

    def __init__(self, mesh: Mesh) -> None:
        """Take the triangles.

        Raises:
            ValueError: If open3d is missing or can't be loaded.
        """
        try:
            import open3d.core  # noqa: PLC0415 - it takes a second and many megabytes
            from open3d.t.geometry import RaycastingScene  # noqa: PLC0415
        except (ImportError, OSError) as error:
            msg = (
                'Synthetic homes need open3d (the package open3d-cpu, and of the system '
                f'libusb-1.0-0 and libgl1): {error}.'
            )
            raise ValueError(msg) from None
        library: Any = open3d.core
        self._tensor = library.Tensor
        self._scene: Any = RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(mesh.vertices)),
            self._tensor(np.ascontiguousarray(mesh.faces).astype(np.uint32)),
        )

    def cast(self, rays: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Return what rays meet: open3d's arrays t_hit, primitive_ids, primitive_uvs, ...

        Args:
            rays: Start and direction, (..., 6).
        """
        found = self._scene.cast_rays(self._tensor(np.ascontiguousarray(rays)), nthreads=1)
        return {name: value.numpy() for name, value in found.items()}

    def blocked(
        self, start: NDArray[np.float32], end: NDArray[np.float32], margin: float = 0.02
    ) -> NDArray[np.bool_]:
        """Tell whether something is between pairs of points, but for a margin at the end.

        Args:
            start: Metres, (..., 3).
            end: Metres, (..., 3).
            margin: Metres.
        """
        along = end - start
        length = np.sqrt((along**2).sum(-1, keepdims=True))
        rays = np.concatenate([start, along / np.maximum(length, 1e-6)], -1, dtype=np.float32)
        reach = np.maximum(length[..., 0] - margin, 0.0)
        # The far end differs from ray to ray, which open3d's own test for occlusion can't have.
        hidden: NDArray[np.bool_] = self.cast(rays)['t_hit'] < reach
        return hidden

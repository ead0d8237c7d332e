"""Colour and depth images with where they were taken: what players make and mappers read.

Frames follow REP-103. A robot's pose has x forward, y left, z up and z = 0 on the floor; the
camera's optical frame has x right, y down, z forward, and integer pixel coordinates (u, v) lie in
the middle of their pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

CLASSES = (
    'ceiling',
    'floor',
    'wall',
    'beam',
    'column',
    'window',
    'door',
    'table',
    'chair',
    'sofa',
    'bookcase',
    'board',
    'clutter',
)
"""Semantic classes of S3DIS; a label is an index into them."""

UNLABELLED = 255
"""Label of what has none."""

VIEW_SUFFIX = '_view'
"""What is added to the name of the robot's frame in an odom of a view that is not the last of its
step: the robot stands where it stood, and looks elsewhere."""

MILLIMETRE = np.float32(0.001)
"""Depth as uint16 counts these, in metres."""

_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns optical axes into body axes."""


class Camera(NamedTuple):
    """A pinhole camera without distortion; lengths in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def resized(self, width: int, height: int) -> Camera:
        """Return the camera of the same pictures at another size."""
        across, down = width / self.width, height / self.height
        return Camera(
            width,
            height,
            self.fx * across,
            self.fy * down,
            (self.cx + 0.5) * across - 0.5,
            (self.cy + 0.5) * down - 0.5,
        )


class Pose3D(NamedTuple):
    """A pose in space: metres, and a unit quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    qx: float = 0.0
    qy: float = 0.0
    qz: float = 0.0
    qw: float = 1.0

    def matrix(self) -> NDArray[np.float64]:
        """Return what takes points of this pose's frame into its parent's, (4, 4)."""
        x, y, z, w = self.qx, self.qy, self.qz, self.qw
        matrix = np.eye(4)
        matrix[:3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
        matrix[:3, 3] = self.x, self.y, self.z
        return matrix

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> Pose3D:
        """Return the pose of a rigid transform (4, 4), its rotation made exact.

        Raises:
            ValueError: If it is not finite, or not a rotation and a translation.
        """
        # Loaded late: a robot's planner needs no rotations in space.
        from scipy.spatial.transform import Rotation  # noqa: PLC0415

        rotation = matrix[:3, :3]
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            msg = f'A pose is a finite 4 x 4 matrix, not {matrix.tolist()}.'
            raise ValueError(msg)
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE or (
            np.linalg.det(rotation) < 0
        ):
            msg = f'The rotation of the pose is none: {rotation.tolist()}.'
            raise ValueError(msg)
        return cls(*matrix[:3, 3].tolist(), *Rotation.from_matrix(rotation).as_quat().tolist())


ROTATION_TOLERANCE = 1e-2
"""How far a rotation times its transpose may be from the unit matrix."""


class CameraMount(NamedTuple):
    """Where the camera sits on the robot: metres and radians in the robot's frame.

    Roll, pitch and yaw turn about the fixed axes x, y, z in this order; all 0 looks ahead, and a
    positive pitch looks down.
    """

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def matrix(self) -> NDArray[np.float64]:
        """Return what takes points of the optical frame into the robot's, (4, 4)."""
        cosines, sines = np.cos(self[3:]), np.sin(self[3:])
        (cr, cp, cy), (sr, sp, sy) = cosines.tolist(), sines.tolist()
        matrix = np.eye(4)
        matrix[:3, :3] = (
            np.array(
                [
                    [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                    [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                    [-sp, cp * sr, cp * cr],
                ]
            )
            @ _OPTICAL
        )
        matrix[:3, 3] = self[:3]
        return matrix

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> CameraMount:
        """Return the mount of a rigid transform (4, 4) from the optical frame into the robot's."""
        from scipy.spatial.transform import Rotation  # noqa: PLC0415 - as in Pose3D

        turn = Rotation.from_matrix(matrix[:3, :3] @ _OPTICAL.T)
        return cls(*matrix[:3, 3].tolist(), *turn.as_euler('xyz').tolist())


@dataclass(frozen=True)
class RgbdFrame:
    """One look.

    Attributes:
        name: Of the image in its source, for messages to people.
        stamp: Nanoseconds.
        color: RGB, uint8 (H, W, 3).
        depth: Along the optical axis; uint16 in millimetres with 0 where nothing was measured, or
            float32 in metres with 0 or NaN there; (H, W).
        camera: Of both images.
        pose: Of the robot in the frame of the map.
        mount: Of the camera on the robot.
        labels: True classes of the pixels where a source has them, uint8 (H, W).
    """

    name: str
    stamp: int
    color: NDArray[np.uint8]
    depth: NDArray[np.uint16] | NDArray[np.float32]
    camera: Camera
    pose: Pose3D
    mount: CameraMount
    labels: NDArray[np.uint8] | None = None

    def camera_to_map(self) -> NDArray[np.float64]:
        """Return what takes points of the optical frame into the frame of the map, (4, 4)."""
        return self.pose.matrix() @ self.mount.matrix()


class FrameSource(Protocol):
    """Frames in the order in which they were taken, read when they are asked for."""

    @property
    def name(self) -> str:
        """What people call it."""

    @property
    def frame_names(self) -> Sequence[str]:
        """The frames that can be read, as far as is known without reading them."""

    def read(self, name: str) -> RgbdFrame:
        """Read a frame.

        Raises:
            FrameError: If it can't be read, with one sentence that says why.
        """


class FrameError(ValueError):
    """A frame, or a whole source, can't be read; its text is one sentence that names it."""


def readable_frames(source: FrameSource, skipped: list[str]) -> Iterator[RgbdFrame]:
    """Yield the frames that can be read, and note why the others can't be."""
    for name in source.frame_names:
        try:
            frame = source.read(name)
        except FrameError as error:
            skipped.append(str(error))
            continue
        yield frame

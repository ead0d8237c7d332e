"""Map a bag, a scene or a sequence of RGB-D images offline, as the node does it online."""

from __future__ import annotations

import json
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from rich.console import Console
from rich.progress import Progress

from bev_mapper.evidence_grid import Crop
from bev_mapper.frame_sync import SyncConfig
from bev_mapper.map_files import save_cloud, save_map
from bev_mapper.rgbd_fusion import RgbdFusion
from bev_mapper.rgbd_mapper import MapperConfig, RgbdMapper
from bev_mapper.segmentation import make_segmenter
from gridnav.grid import GridGeometry
from gridnav.images import (
    COLOR_ENCODINGS,
    DEPTH_ENCODINGS,
    check_camera,
    check_image,
    decode_camera,
    decode_image,
)
from gridnav.metrics import Outcome
from gridnav.partial_map import FREE_VALUE, OCCUPIED_VALUE, UNKNOWN_VALUE
from gridnav.rgbd import CLASSES, CameraMount, Pose3D, readable_frames
from vgdp_bringup.bags import (
    NANOSECONDS,
    BagError,
    only_namespace,
    open_bag,
    stamp_of,
    start_of,
)

if TYPE_CHECKING:
    from pathlib import Path

    from gridnav.rgbd import FrameSource

Mode = Literal['evidence', 'majority']

TOPICS = {
    'color': 'camera/color/image_raw',
    'depth': 'camera/depth/image_raw',
    'camera': 'camera/camera_info',
    'pose': 'odom',
    'episode': 'episode',
}
STATIC_TRANSFORMS = '/tf_static'

UNIT_NORM_TOLERANCE = 1e-3
"""How far the norm of a quaternion may be from 1, as for the node."""

AFTER_ALL = 2**63
"""A time, in nanoseconds, at which nothing waits any more."""

BASE_FRAME = 'base_link'
"""Frame of the robot."""


@dataclass(frozen=True)
class MapOptions:
    """What to map and how.

    Attributes:
        source: Folder of a bag, of a scene or of a sequence.
        out: Folder for what comes of it; it is made if there is none.
        segmenter: One of `bev_mapper.segmentation.SEGMENTERS`.
        weights: File of the segmenter's weights.
        resolution: Side of a cell in metres.
        mode: 'evidence' or 'majority'.
        max_range: Depth beyond this is not mapped, in metres.
        voxel: Side of the cloud's voxels in metres.
        width: Frames of scenes and sequences are made so many pixels wide; 0 leaves them.
        namespace: Where the robot has its topics in a bag; found if empty.
        mount: Of the camera, for bags: x, y, z, roll, pitch, yaw; from the bag if None.
        image_slop: Seconds that images of a bag may be apart.
        pose_slop: Seconds to the poses between which that of an image lies.
    """

    source: Path
    out: Path
    segmenter: str = 'geometric'
    weights: Path | None = None
    resolution: float = 0.1
    mode: Mode = 'evidence'
    max_range: float = MapperConfig.max_range
    voxel: float = MapperConfig.voxel
    width: int = 0
    namespace: str = ''
    mount: CameraMount | None = None
    image_slop: float = 0.0
    pose_slop: float = 0.1


@dataclass
class Mapping:
    """What came of it.

    Attributes:
        mapper: The map and the cloud.
        name: Of the source.
        way: Where the robot, or the camera, was: x and y in metres.
        skipped: A sentence for each frame that could not be used.
        counts: How many messages of a bag were dropped, by reason.
        seconds: What mapping took, without reading.
    """

    mapper: RgbdMapper
    name: str
    way: list[tuple[float, float]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    seconds: float = 0.0


def run(options: MapOptions) -> int:
    """Map, write the files and say what came of it; returns the exit status."""
    from vgdp_bringup.map_picture import save_picture  # noqa: PLC0415 - loads matplotlib

    mapping = map_source(options)
    mapper = mapping.mapper
    for sentence in mapping.skipped:
        sys.stderr.write(f'left out: {sentence}\n')
    if not mapper.frames:
        msg = f'{options.source} has no frame that could be mapped.'
        raise ValueError(msg)
    options.out.mkdir(parents=True, exist_ok=True)
    save_map(options.out, mapper.grid.occupancy, mapper.grid.geometry)
    save_cloud(options.out, mapper.cloud.points())
    save_picture(mapping, options.out / 'map.png')
    found = summary(mapping)
    text = json.dumps(found, indent=2) + '\n'
    (options.out / 'summary.json').write_text(text, encoding='utf-8')
    cells = found['cells']
    sys.stdout.write(
        f'{mapper.frames} frames in {mapping.seconds:.1f} s with the {mapper.segmenter} '
        f'segmenter: {cells["free"]} cells free, {cells["occupied"]} occupied, '
        f'{len(mapper.cloud)} voxels\n'
        f'{options.out}: map.pgm, map.yaml, cloud.ply, map.png, summary.json\n'
    )
    return 0


def map_source(options: MapOptions) -> Mapping:
    """Map a bag, a scene or a sequence.

    Raises:
        ValueError: If it can't be read or the options can't be used, with one sentence.
    """
    segmenter = make_segmenter(options.segmenter, options.weights)
    config = MapperConfig(
        geometry=GridGeometry(15, 15, options.resolution),
        mode=options.mode,
        crop=Crop(),
        max_range=options.max_range,
        voxel=options.voxel,
    )
    mapping = Mapping(RgbdMapper(config, segmenter), options.source.resolve().name)
    with _progress() as progress:
        if hasattr(segmenter, 'progress'):
            segmenter.progress = partial(progress.track, description='labelling the cloud')
        if is_bag(options.source):
            _map_bag(mapping, options, progress)
        else:
            _map_frames(mapping, _open_source(options), progress)
        began = time.perf_counter()
        mapping.mapper.finish()
        mapping.seconds += time.perf_counter() - began
    return mapping


def is_bag(path: Path) -> bool:
    """Tell whether a folder holds a bag."""
    return any(file.suffix in {'.mcap', '.db3'} for file in path.glob('*'))


def summary(mapping: Mapping) -> dict[str, Any]:
    """Return what came of it, for JSON."""
    mapper = mapping.mapper
    grid, geometry = mapper.grid, mapper.grid.geometry
    labels = mapper.cloud.points().labels
    values = {'free': FREE_VALUE, 'occupied': OCCUPIED_VALUE, 'unknown': UNKNOWN_VALUE}
    return {
        'source': mapping.name,
        'segmenter': mapper.segmenter,
        'frames': mapper.frames,
        'skipped': mapping.skipped,
        'dropped': dict(mapping.counts),
        'seconds': round(mapping.seconds, 3),
        'cells': {name: int((grid.occupancy == value).sum()) for name, value in values.items()},
        'resolution_m': geometry.resolution,
        'origin_m': [geometry.origin_x, geometry.origin_y],
        'shape': list(geometry.shape),
        'voxels': len(mapper.cloud),
        'dropped_voxels': mapper.cloud.dropped,
        'classes': {
            name: int((labels == index).sum())
            for index, name in enumerate(CLASSES)
            if (labels == index).any()
        },
    }


def _progress() -> Progress:
    console = Console(stderr=True)
    return Progress(console=console, transient=True, disable=not console.is_terminal)


# Scenes and sequences


def _open_source(options: MapOptions) -> FrameSource:
    from avd_player.sources import open_source  # noqa: PLC0415 - bags do without

    source: FrameSource = open_source(options.source, options.width)
    return source


def _map_frames(mapping: Mapping, source: FrameSource, progress: Progress) -> None:
    """Map the frames of a source."""
    mapping.name = source.name
    task = progress.add_task('mapping', total=len(source.frame_names))
    for frame in readable_frames(source, mapping.skipped):
        began = time.perf_counter()
        try:
            mapping.mapper.add(frame)
        except ValueError as error:
            mapping.skipped.append(str(error))
        else:
            _note_position(mapping)
        mapping.seconds += time.perf_counter() - began
        progress.update(task, completed=mapping.mapper.frames + len(mapping.skipped))


def _note_position(mapping: Mapping) -> None:
    position = mapping.mapper.position
    if position is not None and mapping.way[-1:] != [position]:
        mapping.way.append(position)


# Bags


def _map_bag(mapping: Mapping, options: MapOptions, progress: Progress) -> None:
    """Hand the messages of a bag to the fusion in the order in which they came."""
    prefix = f'{(options.namespace or only_namespace(options.source)).rstrip("/")}/'
    names = {prefix + topic: kind for kind, topic in TOPICS.items()}
    slops = (options.image_slop, options.pose_slop)
    image_slop, pose_slop = (round(slop * NANOSECONDS) for slop in slops)
    sync = SyncConfig(image_slop=image_slop, pose_slop=pose_slop)
    fusion = RgbdFusion(mapping.mapper, sync, options.mount)
    transforms = _Transforms()
    with open_bag(options.source) as reader:
        wanted = [c for c in reader.connections if c.topic in {*names, STATIC_TRANSFORMS}]
        if not wanted:
            msg = f'{options.source} has none of the topics of RGB-D images below {prefix}.'
            raise BagError(msg)
        task = progress.add_task('mapping', total=sum(c.msgcount for c in wanted))
        for connection, received, data in reader.messages(wanted):
            message: Any = reader.deserialize(data, connection.msgtype)
            kind = names.get(connection.topic, '')
            began = time.perf_counter()
            if not kind:
                transforms.add(message)
            elif kind == 'depth' and fusion.sync.mount is None:
                fusion.sync.mount = transforms.mount(message.header.frame_id)
            fusion.expire(received)
            if kind and _hand_over(fusion, kind, message, received, mapping.skipped):
                _note_position(mapping)
            mapping.seconds += time.perf_counter() - began
            progress.advance(task)
    fusion.expire(AFTER_ALL)
    mapping.skipped += fusion.refused
    mapping.counts = fusion.counts
    if not mapping.mapper.frames and fusion.sync.mount is None:
        msg = f'{options.source} does not say where the camera is on the robot, give --mount.'
        raise BagError(msg)


def _hand_over(
    fusion: RgbdFusion,
    kind: str,
    message: Any,  # noqa: ANN401 - of rosbags
    received: int,
    skipped: list[str],
) -> int:
    """Hand a message to the fusion, if the node would; returns how many frames were fused."""
    try:
        if kind == 'episode':
            start = start_of(message)
            is_new = start is not None and message.message == Outcome.RUNNING
            return fusion.begin_episode(start) if start is not None and is_new else 0
        stamp = stamp_of(message)
        if kind == 'color':
            check_image(message, COLOR_ENCODINGS)
            return fusion.add_color(stamp, decode_image(message).astype(np.uint8, copy=False))
        if kind == 'depth':
            check_image(message, DEPTH_ENCODINGS)
            return fusion.add_depth(stamp, decode_image(message), received)
        if kind == 'camera':
            check_camera(message)
            return fusion.add_camera(stamp, decode_camera(message))
        return fusion.add_pose(
            stamp, _to_pose(message.pose.pose.position, message.pose.pose.orientation)
        )
    except ValueError as error:
        skipped.append(f'A message on {TOPICS[kind]}: {error}')
        return 0


def _to_pose(position: Any, turn: Any) -> Pose3D:  # noqa: ANN401 - of rosbags
    """Return a pose.

    Raises:
        ValueError: If it is none.
    """
    xyzw = (turn.x, turn.y, turn.z, turn.w)
    values = np.array([position.x, position.y, position.z, *xyzw])
    norm = float(np.linalg.norm(values[3:]))
    if not (np.isfinite(values).all() and abs(norm - 1.0) <= UNIT_NORM_TOLERANCE):
        msg = f'Its pose {values.tolist()} is not finite, or its orientation no unit quaternion.'
        raise ValueError(msg)
    values[3:] /= norm
    return Pose3D(*values.tolist())


class _Transforms:
    """The transforms of a bag that do not change."""

    def __init__(self) -> None:
        self._edges: dict[str, tuple[str, Pose3D]] = {}

    def add(self, message: Any) -> None:  # noqa: ANN401 - a TFMessage of rosbags
        for edge in message.transforms:
            moved = edge.transform
            pose = _to_pose(moved.translation, moved.rotation)
            self._edges[edge.child_frame_id] = edge.header.frame_id, pose

    def mount(self, optical_frame: str) -> CameraMount | None:
        """Return where a camera is on the robot, None where that is not known."""
        matrix, frame, seen = np.eye(4), optical_frame, set()
        while frame != BASE_FRAME:
            if frame not in self._edges or frame in seen:
                return None
            seen.add(frame)
            frame, pose = self._edges[frame]
            matrix = pose.matrix() @ matrix
        return CameraMount.from_matrix(matrix)

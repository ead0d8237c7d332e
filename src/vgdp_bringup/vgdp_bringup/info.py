"""What is installed here: the environment in one text, for a look and for bug reports."""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import torch

from vgdp_bringup.topics import TOPICS
from vgdp_planner.weights import MODEL_FILE, SHIPPED, WeightsError, read_record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    Rows = list[tuple[str, str]]

PACKAGES = (
    'vgdp_bringup',
    'vgdp_planner',
    'vgdp_experiments',
    'bev_mapper',
    'maze_sim',
    'gridnav',
)
LIBRARIES = ('numpy', 'scipy', 'gymnasium', 'mcap', 'rosbags', 'safetensors', 'matplotlib', 'rich')
VARIABLES = (
    'ROS_DISTRO',
    'ROS_DOMAIN_ID',
    'ROS_AUTOMATIC_DISCOVERY_RANGE',
    'ROS_STATIC_PEERS',
    'RMW_IMPLEMENTATION',
    'PYTHONPATH',
)


def report() -> str:
    """Return the text: sections of names and values."""
    sections: dict[str, Rows] = {
        'packages': [(name, _version(name)) for name in PACKAGES],
        'system': [
            ('python', f'{platform.python_version()} ({sys.executable})'),
            ('os', f'{_os_name()}, {platform.machine()}, {os.cpu_count()} cores'),
        ],
        'ros': _ros(),
        'torch': _torch(),
        'libraries': [(name, _version(name)) for name in LIBRARIES],
        'weights': _weights(),
        'environment': [(name, os.environ.get(name, '-')) for name in VARIABLES],
        'topics': _topics(),
    }
    lines = []
    for title, rows in sections.items():
        width = max(len(name) for name, _ in rows)
        lines += [title, *(f'  {name:{width}}  {value}' for name, value in rows)]
    return '\n'.join(lines)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'not installed'


def _os_name() -> str:
    try:
        return platform.freedesktop_os_release()['PRETTY_NAME']
    except OSError:
        return platform.platform()


def _ros() -> Rows:
    try:
        import rclpy  # noqa: PLC0415 - a machine without ROS gets the rest
    except ImportError as error:
        return [('rclpy', f'can not be imported: {error}')]
    return [
        ('rclpy', f'{_version("rclpy")} ({rclpy.__path__[0]})'),
        ('rmw', rclpy.get_rmw_implementation_identifier()),
    ]


def _torch() -> Rows:
    devices = [f'cpu ({torch.get_num_threads()} threads)']
    if torch.cuda.is_available():
        devices += [torch.cuda.get_device_name(i) for i in range(torch.cuda.device_count())]
    return [('torch', torch.__version__), ('devices', ', '.join(devices))]


def _weights() -> Rows:
    """Describe the shipped weights: where they are, which they are, and how well they do."""
    try:
        record = read_record()
        model = (SHIPPED / MODEL_FILE).read_bytes()
    except (WeightsError, OSError) as error:
        return [('shipped', f'none: {error}')]
    return [
        ('folder', str(SHIPPED)),
        ('size', f'{len(model) / 1e6:.1f} MB'),
        ('sha256', hashlib.sha256(model).hexdigest()),
        *_flatten(record.get('training', {})),
    ]


def _flatten(record: Mapping[str, Any], prefix: str = '') -> Iterator[tuple[str, str]]:
    """Return the plain values in a nested record with the way to them."""
    for key, value in record.items():
        if isinstance(value, dict):
            yield from _flatten(value, f'{prefix}{key}.')
        else:
            yield f'{prefix}{key}', str(value)


def _topics() -> Rows:
    try:
        from vgdp_bringup.node import qos_of  # noqa: PLC0415 - needs ROS
    except ImportError:
        return [(topic.name, topic.type) for topic in TOPICS]
    rows = []
    for topic in TOPICS:
        qos = qos_of(topic)
        words = (qos.reliability.name, qos.durability.name, f'depth {qos.depth}')
        rows.append((topic.name, f'{topic.type}, {", ".join(words).lower().replace("_", " ")}'))
    return rows

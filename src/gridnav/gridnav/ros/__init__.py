"""Everything of the stack that knows ROS 2, shared by the nodes of all packages.

``qos`` (named profiles), ``conversions`` (arrays and numbers to messages and back), ``rgbd``
(images, cameras, poses in space), ``validation`` (refuse what a node can't use), ``episode`` (the
episode topic), ``parameters`` (one table of parameters per node), ``diagnostics`` (once a second),
``tf`` (where it can be imported), ``poses`` (where the robot is, from TF, odometry or AMCL),
``paths`` (on request), ``lockstep`` (worlds that take one action at a time), ``node`` (the base
class) and ``run`` (start and end of a process).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path


def _add_environment_to_ament_path() -> None:
    """Name this Python environment as an ament prefix where ROS 2 was installed into it by pip."""
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    if (Path(sys.prefix) / 'share' / 'ament_index').is_dir() and sys.prefix not in prefixes:
        os.environ['AMENT_PREFIX_PATH'] = os.pathsep.join(filter(None, [*prefixes, sys.prefix]))


_add_environment_to_ament_path()

"""The named quality-of-service profiles; no node builds its own."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data

RELIABLE_QOS = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""Streams of which every message counts: ``odom``, ``local_map``, ``action``, ``waypoint``."""

MAP_QOS = QoSProfile(
    depth=1,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The latest one, kept for late joiners (REP-2003): ``map``, ``goal_pose``, ``plan``."""

EPISODE_QOS = QoSProfile(
    depth=10,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
"""The last ten, kept for late joiners: ``episode``."""

MARKER_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
"""The latest one, for viewers: ``plan_candidates``, ``value_map``."""

SENSOR_QOS = qos_profile_sensor_data
"""Camera streams: best effort, five deep."""

BURST_QOS = QoSProfile(depth=64, reliability=ReliabilityPolicy.RELIABLE)
"""Images and poses of a player that says those of all directions at once: ten deep, some would be
lost. Subscribers with the profiles of sensor data or streams are served too."""

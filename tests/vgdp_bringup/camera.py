"""A camera of 1080p colour and depth, as a process: camera.py FRAMES RATE RELIABLE."""

from __future__ import annotations

import array
import sys
import time

import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, Image

WIDTH, HEIGHT = 1920, 1080
TOPICS = ('camera/color/image_raw', 'camera/depth/image_raw', 'camera/camera_info')


def image(encoding: str, pixel_bytes: int) -> Image:
    """Build an image of one grey."""
    data = array.array('B', bytes([7]) * (WIDTH * HEIGHT * pixel_bytes))
    return Image(
        height=HEIGHT, width=WIDTH, encoding=encoding, step=WIDTH * pixel_bytes, data=data
    )


def main() -> None:
    """Wait for the recorder, send the frames, and wait until it has them."""
    frames, rate, reliable = int(sys.argv[1]), float(sys.argv[2]), sys.argv[3] == 'True'
    rclpy.init(args=sys.argv)
    node = rclpy.create_node('camera')
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    qos = QoSProfile(depth=5, reliability=reliability)
    messages = [image('rgb8', 3), image('16UC1', 2), CameraInfo(height=HEIGHT, width=WIDTH)]
    publishers = [
        node.create_publisher(type(message), topic, qos)
        for message, topic in zip(messages, TOPICS, strict=True)
    ]
    while not all(publisher.get_subscription_count() for publisher in publishers):
        time.sleep(0.01)
    time.sleep(0.5)
    begin = time.monotonic()
    for frame in range(frames):
        time.sleep(max(begin + frame / rate - time.monotonic(), 0.0))
        for message, publisher in zip(messages, publishers, strict=True):
            message.header.stamp.sec = frame
            publisher.publish(message)
    sys.stdout.write(f'sent at {(frames - 1) / (time.monotonic() - begin):.1f} Hz\n')
    sys.stdout.flush()
    time.sleep(2.0)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == '__main__':
    main()

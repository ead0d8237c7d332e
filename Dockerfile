# ROS 2 Jazzy with the stack built into a colcon workspace. The default command is the demo:
#   docker build -t vgdp . && docker run --rm -it -v "$PWD/out:/vgdp/out" vgdp
FROM ros:jazzy

RUN apt-get update \
  && apt-get install -y --no-install-recommends make python3-numpy python3-venv \
  && rm -rf /var/lib/apt/lists/*

WORKDIR /vgdp
COPY . .

# The entry point of the base image sources ROS only at run time.
RUN bash -c 'source /opt/ros/jazzy/setup.bash && make workspace'

CMD ["bash", "-c", "source ros2_ws/install/setup.bash && exec ros2 run vgdp_bringup vgdp demo"]

# ROS 2 Jazzy from apt on Ubuntu 24.04, with this repository built in a workspace. See docs/ubuntu.md.
#   docker build -t heightmap25d .
#   docker run --rm -it --network host heightmap25d ros2 launch heightmap25d_ros bringup.launch.py
FROM ros:jazzy-ros-base

WORKDIR /ws

# Only what the dependencies follow from, so that an edit of the code does not install them again.
COPY package.xml src/heightmap25d_ros/
COPY heightmap25d_msgs/package.xml src/heightmap25d_ros/heightmap25d_msgs/
COPY requirements/pins.txt src/heightmap25d_ros/requirements/
# numba knows Python 3.12 from 0.59 on, so that it comes from pip, as rosbags does, at the version of
# the pins. numpy is Ubuntu's, which ROS is compiled against; the pins name the same one.
RUN apt-get update \
  && apt-get install -y --no-install-recommends python3-pip \
  && rosdep update --rosdistro jazzy \
  && rosdep install -y --rosdistro jazzy --ignore-src --skip-keys python3-numba \
    --from-paths src src/heightmap25d_ros/heightmap25d_msgs \
  && rm -rf /var/lib/apt/lists/* \
  && pip3 install --no-cache-dir --break-system-packages \
    --constraint src/heightmap25d_ros/requirements/pins.txt numba rosbags

COPY . src/heightmap25d_ros/
RUN . /opt/ros/jazzy/setup.sh \
  && colcon build --base-paths src src/heightmap25d_ros/heightmap25d_msgs

# Also sources ROS itself, on which the workspace was built.
ENTRYPOINT ["/bin/bash", "-c", "source /ws/install/setup.bash && exec \"$@\"", "--"]
CMD ["bash"]

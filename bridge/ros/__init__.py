"""A ward's samples as ROS 2 messages, for programs of robotics: Foxglove, PlotJuggler, ROS 2 itself.

`imu_rows` joins what is known of each sample, `messages` encodes it, `rmw_zenoh` names it on zenoh as rmw_zenoh does.
"""

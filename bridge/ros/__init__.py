"""Samples of a ward as ROS 2 messages, for robotics programs: Foxglove, PlotJuggler, ROS 2 itself.

`imu_rows` combines all data of each sample, `messages` encodes it, `rmw_zenoh` names it on zenoh as rmw_zenoh does.
"""

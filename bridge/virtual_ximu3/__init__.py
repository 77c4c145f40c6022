"""Virtual x-IMU3s: a ward's devices shown as x-IMU3s to the programs of x-io Technologies.

Begin at `device`, which has no I/O.
"""

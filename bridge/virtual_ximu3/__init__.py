"""Our streams for x-io's own programs: every device of a ward as an x-IMU3 that is not there."""

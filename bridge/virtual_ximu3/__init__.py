"""Shows the devices of a ward to x-io's own programs, each as a virtual x-IMU3 on the network."""

"""Names of the calibration methods, without loading the mathematics."""

DEFAULT = "closure"
#: by hand, live or from a recording; `methods.METHODS` has them
BY_HAND = (DEFAULT, "turn360", "transitions", "accel_aided")
#: those of them that want movements between poses that differ, and no full turns
BY_MOVEMENTS = ("transitions", "accel_aided")

"""Names of the calibration methods, importable without loading the mathematics."""

DEFAULT = "closure"
#: methods by hand, live or from a recording; `methods.METHODS` has their functions
BY_HAND = (DEFAULT, "turn360", "transitions", "accel_aided")
#: of these, the methods that need movements between different poses, and no full turns
BY_MOVEMENTS = ("transitions", "accel_aided")

"""Simulated days, scenes and recordings for the tests and benchmarks, built on the simulator of `bridge/sim`."""

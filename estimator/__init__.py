"""Estimator: calibrates and tracks every gyroscope of a ward, and publishes corrected rates.

docs/architecture.md lists the packages. The public Python interface is the package `truerate`.
"""

"""Outlets: programs that receive a ward's data and pass it on to software that does not speak zenoh.

Each outlet is one package with `add_arguments(verb)` and `serve(client, devices, given, stop)`. The command `truerate
outlet` lists them in `estimator.cli.outlet`.
"""

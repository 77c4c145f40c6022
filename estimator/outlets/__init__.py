"""Outlets: subscribers that hand a ward's data to programs that do not speak zenoh.

One package or module for each outlet, with `add_arguments(verb)` and `serve(client, devices, given, stop)`. The command
`truerate outlet` lists them in `estimator.cli.outlet`.
"""

"""The ward file: its schema, the list of enrolled devices, and cross-checks of a ward's files.

Begin at `schema.Root`; `cross_checks` compares ward files with each other and with a router's rules.
"""

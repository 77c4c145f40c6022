"""The ward file: its schema, the list of enrolled devices, and checks of files that must fit together.

Begin at `schema.Root`; `cross_checks` compares ward files with each other and with a router's rules.
"""

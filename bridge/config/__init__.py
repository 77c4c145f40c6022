"""Ward file (TOML): its schema, the list of enrolled devices, reloading, and checks of a ward's files against each other.

Begin at `schema.Root`. `cross_checks` compares ward files with each other and with a router's access rules.
"""

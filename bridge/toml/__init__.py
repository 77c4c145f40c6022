"""TOML files as frozen, typed objects: a value that does not fit is refused with its file, table, key and nearest name.

Begin at `loader.load`; `shipped` finds the files that come with truerate.
"""

"""Loader of TOML files as frozen, typed objects; an error names the file, table, key and nearest valid name.

Begin at `loader.load`; `shipped` finds the files shipped with truerate.
"""

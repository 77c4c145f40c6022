"""Messages, keys and their encoding (docs/wire.md). Nothing invalid passes the decoder.

Begin at `messages`; `codec` is the public door to bytes, `keys` the only builder and parser of keys.
"""

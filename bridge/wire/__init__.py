"""Wire format: message types, bus keys and their encoding (docs/wire.md). The decoder rejects every invalid message.

Begin at `messages`. `codec` encodes and decodes; `keys` alone builds and parses keys.
"""

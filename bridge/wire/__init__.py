"""Wire format: messages, keys and their encoding (docs/wire.md). The decoder rejects every invalid message.

Begin at `messages`. `codec` encodes and decodes; `keys` is the only builder and parser of keys.
"""

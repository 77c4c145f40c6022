"""The wire language: messages, keys and their one codec."""

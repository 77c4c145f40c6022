"""The bus: one contract, zenoh behind it, and a twin in memory."""

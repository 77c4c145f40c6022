"""Recordings of a ward: written as MCAP while it runs, recovered after an accident, looked into, exported."""

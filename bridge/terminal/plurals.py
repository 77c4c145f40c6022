"""Counts with a noun in the singular or the plural."""


def count(n: int, noun: str, plural: str = "") -> str:
    """Format a count with its noun: `1 device`, `2 devices`. plural: of an irregular noun."""
    return f"{n} {noun if n == 1 else plural or f'{noun}s'}"

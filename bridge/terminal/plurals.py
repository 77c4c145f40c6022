"""Counts with a noun in the singular or the plural, for text in the terminal."""


def count(n: int, noun: str, plural: str = "") -> str:
    """Format a count n with its noun: `1 device`, `2 devices`. plural: plural of an irregular noun."""
    return f"{n} {noun if n == 1 else plural or f'{noun}s'}"

"""A count with its noun, in the singular or the plural."""


def count(n: int, noun: str, plural: str = "") -> str:
    """`1 device`, `2 devices`; plural where an s does not make it."""
    return f"{n} {noun if n == 1 else plural or f'{noun}s'}"

"""A nemesis: seeded random faults on a running ward, and a checker of what must hold whatever happens. `make nemesis`."""

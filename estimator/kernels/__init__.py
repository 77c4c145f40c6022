"""Numba-compiled loops over samples; each file serves one module of another room, calls no other loop and keeps no state.

The same samples give the same bits in any batching. Begin at `compiled`; the tests compare each loop with NumPy.
"""

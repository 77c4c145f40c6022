"""Loops over samples that Numba compiles, each for one module of another room; a loop calls no other and keeps nothing.

The same samples give the same bits in any batching. Begin at `compiled`; tests hold each loop against NumPy.
"""

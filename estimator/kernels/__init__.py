"""Numba-compiled loops over samples; each file serves one module of another package, and keeps no state.

The same samples give the same results to the last bit, however they are split into calls. The decorator is in
`compiled`. The tests compare each loop with NumPy.
"""

"""Compiled kernels (numba) of what is slow in numpy for a million tangents.

Imported only by the functions that use them, when the input is large; see `loops.compiled`.
"""

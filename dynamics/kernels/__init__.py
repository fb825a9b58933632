"""Compiled kernels on plain arrays, one file an effect."""

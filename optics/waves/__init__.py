"""Directions, diffraction orders, polarisation, momentum, and light in plane layers: what all solvers share."""

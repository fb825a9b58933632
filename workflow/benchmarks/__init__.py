"""Measurements of speed and error, each a program: `python -m workflow.benchmarks.NAME`."""

"""Figures and tables, each a program: `python -m workflow.figures.NAME`."""

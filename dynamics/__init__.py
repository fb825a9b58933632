"""Dynamics: from pressure tables to the motion of a sail. Of optics it uses the table and the file helpers only."""

import optics  # noqa: F401  (sets the cache of compiled code before anything is compiled)

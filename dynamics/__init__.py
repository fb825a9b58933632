"""Dynamics: from pressure tables to the motion of a sail. Of optics it uses the table and the file helpers only."""

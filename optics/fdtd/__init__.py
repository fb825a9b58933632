"""Tables of gratings by FDTD (Meep)."""

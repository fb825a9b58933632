"""Time stepping: explicit, and co-rotating."""

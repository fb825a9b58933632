"""Flight of the sail as a membrane: lit, heated, spinning, tearing."""

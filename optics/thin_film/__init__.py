"""Tables of plane films, by transfer matrices."""

"""The sail of a scene: shape, mesh, regions, masses, its sectors with their tables."""

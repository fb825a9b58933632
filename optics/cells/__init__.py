"""What a sail's surface is made of: the schema of cells, their cross-section and mass."""

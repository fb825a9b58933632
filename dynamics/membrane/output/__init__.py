"""What a flight leaves: rows of numbers, the VTKHDF file, checkpoints."""

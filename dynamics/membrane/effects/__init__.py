"""Effects on a membrane, one file each: compiled functions on plain arrays."""

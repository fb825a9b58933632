"""The laser beam: profile and pulse."""

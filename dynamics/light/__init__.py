"""The light on the sail: profile × pulse × pointing. A profile is one file here and one line in `beam`."""

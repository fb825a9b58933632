"""Files at the edge: strict YAML in, whole files out, errors of one line, progress, what this machine has."""

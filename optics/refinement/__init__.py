"""Which directions a table takes: rows, lines, cut-offs and resonances, until its error is what was asked for."""

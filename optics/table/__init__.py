"""The pressure table: file, memory layout, look-up, narrow resonances, and what it promises."""

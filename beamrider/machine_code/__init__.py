"""Compiled code: where it is kept, that it is today's, and that its making is said."""

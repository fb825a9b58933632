"""What is raised where something that the user gave is wrong."""


class InputError(ValueError):
    """Something the user gave is wrong. The message is one line: what was given, what is allowed, what to do."""

"""The workflow: what its rules run, and what they are decided by. Each program is run as `python -m workflow.NAME`."""

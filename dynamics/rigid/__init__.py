"""Flight of the sail as a rigid body, and the basin of offsets and tilts from which it stays on its beam."""

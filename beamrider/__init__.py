"""Beamrider: laser-driven light sails, from the unit cell of their surface to their flight."""

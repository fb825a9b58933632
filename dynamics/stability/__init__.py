"""Linear stability on the beam axis: Floquet multipliers, screening of many sails, maps of force and torque."""

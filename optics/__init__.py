"""Optics: from the unit cell of a sail's surface to an angle-resolved pressure table. Knows nothing of sails."""

from beamrider.machine_code.cache import use_cache

use_cache()

"""Beamrider: laser-driven light sails, from the unit cell of their surface to their flight.

What a notebook needs is here, imported when it is used (Scientific Python SPEC 1): see `beamrider.api`. Within the
project modules are imported from where they are, so that what made a result is read from the `import` statements.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

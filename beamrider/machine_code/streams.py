"""Compiled loops over arrays that share no memory, which the compiler turns into vector code without testing for that.

Numba knows the promise but offers no option for it; here it is. Such functions are copied into those that call them, as
dozens of arrays would have to be handed over otherwise. Of arrays that a loop writes, no part may be among its others.
"""

from __future__ import annotations

from functools import partial

import numba
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions

CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")

#: Decorator of such loops.
streams = partial(numba.njit, cache=True, error_model="numpy", noalias=True, forceinline=True)
#: Decorator of what calls them row by row: views of arrays that live on anyway are not counted, which would take as
#: long as the row itself.
by_row = partial(numba.njit, cache=True, error_model="numpy", _nrt=False)

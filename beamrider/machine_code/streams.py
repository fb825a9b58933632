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
streams = partial(numba.njit, cache=True, error_model="numpy", noalias=True, forceinline=True, _nrt=False)
#: Decorator of what is handed many arrays that live on anyway, and makes none but views: references to them are not
#: counted. Row by row that would take as long as the row itself, and of hundreds of arrays as long to compile as all
#: that is done with them. What it calls and what returns an array must not count them either.
uncounted = partial(numba.njit, cache=True, error_model="numpy", _nrt=False)

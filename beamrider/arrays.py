"""Names of the kinds of NumPy arrays, for type hints."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
#: Nodes, edges or triangles by number: half the memory of `Integers`.
Indices = NDArray[np.uint32]
#: Where something lies in memory: unsigned, so that compiled loops need not test for counting from the end.
Places = NDArray[np.uint64]

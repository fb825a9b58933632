"""Where machine code is kept: a folder of its own for every state of the compiled sources.

Numba looks at a function's own file when it decides whether its cached machine code is current, not at the files of the
functions it calls. After an edit of a called file it would go on with the old code, and with wrong numbers.
"""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def digest(root: Path = ROOT) -> str:
    """Digest of the names and contents of all compiled sources below `root`."""
    sums = hashlib.sha256()
    for path in sorted([*root.glob("optics/*.py"), *root.glob("dynamics/**/*.py")]):
        content = path.read_bytes()
        if b"njit" in content or b"@intrinsic" in content:
            sums.update(path.relative_to(root).as_posix().encode() + b"\0" + content)
    return sums.hexdigest()[:16]


def use_cache(root: Path = ROOT) -> None:
    """Point Numba at the folder of these sources, unless NUMBA_CACHE_DIR chooses another or `root` can't be written.

    The choice goes by the environment, so that Numba need not be imported; a child process makes it anew.
    """
    ours = str(root / "__pycache__" / "numba-")
    if not os.environ.get("NUMBA_CACHE_DIR", ours).startswith(ours) or not os.access(root, os.W_OK):
        return
    os.environ["NUMBA_CACHE_DIR"] = ours + digest(root)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = ours + digest(root)

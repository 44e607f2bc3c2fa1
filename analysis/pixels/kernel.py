"""How numba compiles the solvers: cached, without Python's lock, division by zero as in numpy.

Threads share the work instead of `prange`, which would compile for seconds more. numba's cache does not
notice edits in functions that a kernel imports: remove `__pycache__/*.nb*` after editing one.
"""

from __future__ import annotations

from analysis.compiling import njit

kernel = njit(cache=True, nogil=True, error_model="numpy")
"""Decorator of a kernel."""

fast_kernel = njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract"})
"""The same where sums may be reordered, so that they vectorise; NaN and infinity keep their meaning."""

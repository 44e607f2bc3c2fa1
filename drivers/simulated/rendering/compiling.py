"""Compiles kernels, with a cache on the disk where there is a place for one."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import numba

Kernel = TypeVar("Kernel", bound=Callable[..., Any])

# Of this name in the analysis too, with which the simulated rig shares no code but the word to the user.
_log = logging.getLogger("halfangle.compiling")


def njit(**options: Any) -> Callable[[Kernel], Kernel]:
    """Compile as `numba.njit` does, without a cache where there is no folder that can be written for one.

    Parameters
    ----------
    **options
        Of `numba.njit`.
    """

    def compiled(kernel: Kernel) -> Kernel:
        try:
            found: Kernel = numba.njit(**options)(kernel)
        except RuntimeError as error:
            # A program that is installed read-only, for a user without a home, still works.
            if "no locator available" not in str(error):
                raise
            _tell()
            found = numba.njit(**options | {"cache": False})(kernel)
        return found

    return compiled


def _tell() -> None:
    _log.warning(
        "There is no folder for compiled code that can be written, so it is compiled anew each time, which takes a "
        "minute or two. Set the environment variable NUMBA_CACHE_DIR to such a folder"
    )
    # Once, however many kernels there are.
    _log.disabled = True

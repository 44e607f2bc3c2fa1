"""12-bit counts in 16-bit words may stand at either end of the word; a session has them at the low end."""

from __future__ import annotations

WORD = 16


def shift_of(any_bits: int, bit_depth: int | None) -> int:
    """Return by how many bits counts must be shifted down to be right-aligned.

    Parameters
    ----------
    any_bits : int
        Bits that are set in at least one pixel of any picture; real counts leave none of theirs unused.
    bit_depth : int or None
        Bits of a count, if that is stated.

    Raises
    ------
    ValueError
        If counts of `bit_depth` bits cannot look like this.
    """
    unused = (any_bits & -any_bits).bit_length() - 1 if any_bits else 0
    if bit_depth is None:
        # Converters have 8, 10, 12 or 14 bits; a single low bit that is never set is chance, not alignment.
        return min(unused - unused % 2, WORD - 8)
    if any_bits < 1 << bit_depth:
        return 0
    if unused < WORD - bit_depth:
        raise ValueError(
            f"bit_depth is {bit_depth}, but the pictures hold counts up to {any_bits.bit_length()} bits and use "
            f"all but the lowest {unused}; are they {max(any_bits.bit_length() - unused, 8)} bits deep?"
        )
    return WORD - bit_depth


def guessed_depth(any_bits: int, shift: int) -> int:
    """Return the smallest usual bit depth that holds counts with `any_bits`, before `shift`."""
    if shift:
        return WORD - shift
    return next(depth for depth in (10, 12, 14, WORD) if any_bits < 1 << depth)

"""Random numbers that Cycles makes of names and whole numbers, by hashing.

The string hash is a base-37 polynomial; the mixing is Bob Jenkins' lookup3 (2006, public domain).
"""

from __future__ import annotations

MASK = 0xFFFFFFFF


def random_of_name(name: str) -> float:
    """Number in 0..1 that the node Object Info gives to an object of this name that is no instance."""
    key = 0
    for byte in name.encode():
        key = (key * 37 + byte) & MASK
    return _mixed(key, 2) / MASK


def random_of_number(number: int, words: int) -> float:
    """Number in 0..1 of a whole number that is the first of one or two words, the second 0."""
    return _mixed(number, words) / MASK


def _mixed(key: int, words: int) -> int:
    a = b = c = (0xDEADBEEF + (words << 2) + 13) & MASK
    a = (a + key) & MASK
    c = ((c ^ b) - _rotated(b, 14)) & MASK
    a = ((a ^ c) - _rotated(c, 11)) & MASK
    b = ((b ^ a) - _rotated(a, 25)) & MASK
    c = ((c ^ b) - _rotated(b, 16)) & MASK
    a = ((a ^ c) - _rotated(c, 4)) & MASK
    b = ((b ^ a) - _rotated(a, 14)) & MASK
    return ((c ^ b) - _rotated(b, 24)) & MASK


def _rotated(value: int, bits: int) -> int:
    return (value << bits | value >> (32 - bits)) & MASK

"""The random number that Cycles' Object Info node gives to an object that is no instance: a hash of its name.

The string hash is a base-37 polynomial; the mixing is Bob Jenkins' lookup3 (2006, public domain).
"""

from __future__ import annotations

MASK = 0xFFFFFFFF


def random_of_name(name: str) -> float:
    """A number in 0..1."""
    key = 0
    for byte in name.encode():
        key = (key * 37 + byte) & MASK
    return _mixed(key) / MASK


def _mixed(key: int) -> int:
    a = b = c = (0xDEADBEEF + (2 << 2) + 13) & MASK
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

"""Damaged copies of a good file, and noise."""

from __future__ import annotations

import re

from .draws import Draws

NUMBERS = (b"0", b"-1", b"3", b"nan", b"inf", b"1e308", b"-1e-320", b"4294967295", b"9" * 20, b"1_0", b"")
BITS = (b"\x00", b"\n", b'"', b",", b"\xef\xbb\xbf", b"\xff" * 8, b"<a>", b"[" * 50, b"#", b"\xed\xa0\x80")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", re.IGNORECASE)


def damaged(draws: Draws, good: bytes) -> bytes:
    """A few changes to a file, or bytes that never were one."""
    if draws.chance(0.1):
        return draws.data(300)
    content = good
    for _ in range(draws.whole(1, 4)):
        content = draws.one_of((_flip, _cut, _repeat, _swap_number, _insert))(draws, content)
    return content


def _place(draws: Draws, content: bytes) -> int:
    """Anywhere, but in the header as often as in all the rest."""
    return draws.whole(0, len(content) if draws.chance(0.5) else min(len(content), 400))


def _flip(draws: Draws, content: bytes) -> bytes:
    at = _place(draws, content)
    return content[:at] + bytes([draws.whole(0, 255)]) + content[at + 1 :]


def _cut(draws: Draws, content: bytes) -> bytes:
    at, count = _place(draws, content), draws.one_of((1, 2, 4, 10, 100, 10**9))
    return content[:at] + content[at + count :]


def _repeat(draws: Draws, content: bytes) -> bytes:
    at, count = _place(draws, content), draws.one_of((1, 4, 30, 200))
    return content[: at + count] + content[at:]


def _swap_number(draws: Draws, content: bytes) -> bytes:
    found = list(_NUMBER.finditer(content, 0, 100_000))
    if not found:
        return content
    one = draws.one_of(found[:12] if draws.chance(0.5) else found)
    return content[: one.start()] + draws.one_of(NUMBERS) + content[one.end() :]


def _insert(draws: Draws, content: bytes) -> bytes:
    at = _place(draws, content)
    return content[:at] + draws.one_of(BITS) + content[at:]

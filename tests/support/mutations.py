"""Damaged copies of a good file, and noise."""

from __future__ import annotations

import re

from hypothesis import strategies as st

NUMBERS = (b"0", b"-1", b"3", b"nan", b"inf", b"1e308", b"-1e-320", b"4294967295", b"9" * 20, b"1_0", b"")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", re.IGNORECASE)


@st.composite
def damaged(draw: st.DrawFn, good: bytes) -> bytes:
    """A few changes to a file, or bytes that never were one."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=300))
    content = good
    for _ in range(draw(st.integers(1, 4))):
        content = draw(st.sampled_from((_flip, _cut, _repeat, _swap_number, _insert)))(draw, content)
    return content


def _place(draw: st.DrawFn, content: bytes) -> int:
    """Anywhere, but in the header as often as in all the rest."""
    end = len(content) if draw(st.booleans()) else min(len(content), 400)
    return draw(st.integers(0, end))


def _flip(draw: st.DrawFn, content: bytes) -> bytes:
    at = _place(draw, content)
    return content[:at] + bytes([draw(st.integers(0, 255))]) + content[at + 1 :]


def _cut(draw: st.DrawFn, content: bytes) -> bytes:
    at, count = _place(draw, content), draw(st.sampled_from((1, 2, 4, 10, 100, 10**9)))
    return content[:at] + content[at + count :]


def _repeat(draw: st.DrawFn, content: bytes) -> bytes:
    at, count = _place(draw, content), draw(st.sampled_from((1, 4, 30, 200)))
    return content[: at + count] + content[at:]


def _swap_number(draw: st.DrawFn, content: bytes) -> bytes:
    found = list(_NUMBER.finditer(content, 0, 100_000))
    if not found:
        return content
    early = found[: 12 if draw(st.booleans()) else None]
    one = draw(st.sampled_from(early))
    return content[: one.start()] + draw(st.sampled_from(NUMBERS)) + content[one.end() :]


def _insert(draw: st.DrawFn, content: bytes) -> bytes:
    at = _place(draw, content)
    bits = (b"\x00", b"\n", b'"', b",", b"\xef\xbb\xbf", b"\xff" * 8, b"<a>", b"[" * 50, b"#", b"\xed\xa0\x80")
    return content[:at] + draw(st.sampled_from(bits)) + content[at:]

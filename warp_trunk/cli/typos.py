"""What is wrong with a command line, in one line that names the option, the value and the cure."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import tyro
from tyro.conf import OmitArgPrefixes

from .commands import nearest

_KINDS = {"INT": "a whole number", "FLOAT": "a number", "PATH": "a path"}
_EXAMPLES = {"INT": "4", "FLOAT": "0.5"}


def explained(command: str, words: Sequence[str], said: str, kind: Any) -> str | None:
    """The sentence for words that do not fit; None where the parser's own serve.

    Args:
        command: the command's name.
        words: what follows it.
        said: what the parser said, in one line.
        kind: the command's class.
    """
    known = _options(kind)
    for word, value in zip(words, [*words[1:], ""], strict=False):
        option, _, given = word.partition("=")
        if word.startswith("--") and len(word) > 2 and option.replace("_", "-") not in known:
            return (
                f"{option}: {command} has no such option{_meant(option, given or value, known)}; "
                f"warp-trunk {command} --help lists all"
            )
    return _of_value(command, said, known)


def _of_value(command: str, said: str, known: Mapping[str, str]) -> str | None:
    """The sentence for an option whose value is missing or wrong, or that is missing itself."""
    if found := re.search(r"Missing value for argument '(?:.*/)?(--[\w-]+)'", said):
        option = found[1]
        kind = known.get(option, "")
        return f"{option}: needs {_KINDS.get(kind, 'a value')} after it; write {option} {kind or 'VALUE'}"
    if found := re.search(r"Error parsing (--[\w-]+): .*?'(.*?)'", said):
        option, value = found[1], found[2]
        kind = known.get(option, "")
        example = _EXAMPLES.get(kind)
        cure = f"write for example {option} {example}" if example else f"warp-trunk {command} --help says which"
        return f"{option}: must be {_KINDS.get(kind, 'a value of another kind')}, not '{value}'; {cure}"
    if found := re.search(
        r"invalid choice '(.*?)' for argument '(?:.*/)?(--[\w-]+)'\. Expected one of \((.*?)\)", said
    ):
        value, option = found[1], found[2]
        choices = [choice for choice in re.findall(r"'(.*?)'", found[3]) if choice != "None"]
        return f"{option}: must be one of {', '.join(choices)}, not '{value}'{nearest(value, choices)}"
    if found := re.search(r"Missing from warp-trunk [\w-]+: (.*)", said):
        missing = re.findall(r"(--[\w-]+ [A-Z]+|^[A-Z]+)\b", found[1])
        if missing:
            return f"{command}: {' and '.join(missing)} must be given too; warp-trunk {command} --help explains"
    if found := re.search(r"Unrecognized options: (.*)", said):
        return f"{command}: '{found[1].strip()}' is too much; warp-trunk {command} --help lists what it takes"
    return None


def _meant(option: str, value: str, known: Mapping[str, str]) -> str:
    """The option that takes this value among a few words, or that is written nearly so."""
    for name, kind in known.items():
        if value and value in re.split(r"[{}|,]", kind):
            return f" (did you mean {name} {value}?)"
    return nearest(option, known)


def _options(command: Any) -> dict[str, str]:
    """Every option of a command, and the kind of its value."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.suppress(SystemExit):
        tyro.cli(OmitArgPrefixes[command], args=["--help"])
    plain = re.sub(r"\x1b\[[0-9;]*m", "", told.getvalue())
    found: dict[str, str] = {}
    for flags, kind in re.findall(r"^[│ ]*(-[-\w, ]*--[-\w]+|--[-\w]+)(?: +([^\s│]+))?", plain, re.MULTILINE):
        for flag in re.findall(r"--[-\w]+", flags):
            found.setdefault(flag, kind.replace("{None}|", ""))
    return found

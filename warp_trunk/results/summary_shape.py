"""What a summary must look like for those who read it."""

from __future__ import annotations

from typing import Any

NUMBER, TEXT, WHOLE = (int, float), (str,), (int,)
OPTIONAL = (int, float, type(None))
_STEP = {"seconds": NUMBER, "estimated_error_mm": OPTIONAL}
SHAPE: dict[str, Any] = {
    "status": TEXT,
    "tets": WHOLE,
    "inverted_tets": WHOLE,
    "parameters": {"case": TEXT},
    "tissues": [{"youngs_modulus": NUMBER}],
    "terms": [TEXT],
    "increments": [{**_STEP, "history": [_STEP]}],
    "bsr_deg": {},
    "cobb_deg": {},
    "seconds": {},
    "versions": {},
}
"""Types by key; an object may have further keys, a list any number of such items."""


def fault(value: Any, shape: Any = SHAPE, name: str = "it") -> str:
    """What is wrong with a value of JSON, or an empty text."""
    if isinstance(shape, tuple):
        if not isinstance(value, shape) or isinstance(value, bool):
            return f"'{name}' must be {' or '.join(kind.__name__ for kind in shape)}, not {type(value).__name__}"
        return ""
    if not isinstance(value, type(shape)):
        return f"'{name}' must be {'an object' if isinstance(shape, dict) else 'a list'}"
    if isinstance(shape, list):
        parts = ((item, shape[0], f"{name}[{place}]") for place, item in enumerate(value))
    else:
        missing = [key for key in shape if key not in value]
        if missing:
            return f"'{missing[0]}' is missing in {name}"
        parts = ((value[key], kind, key) for key, kind in shape.items())
    return next((found for part in parts if (found := fault(*part))), "")

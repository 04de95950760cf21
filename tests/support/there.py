"""Values that a test knows to exist."""

from typing import TypeVar

T = TypeVar("T")


def there(value: T | None) -> T:
    """The value, which is not missing."""
    assert value is not None
    return value

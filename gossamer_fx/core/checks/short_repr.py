"""What `print` shows of results with arrays: their shapes and ranges in place of their numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

# Arrays with more numbers than this are described.
MAX_NUMBERS = 6


def short_repr(result: Any) -> str:
    """The fields of a dataclass in one line each, as its `__repr__`; callables and empty fields are
    left out.

    Example:
        >>> from dataclasses import dataclass
        >>> @dataclass
        ... class Curve:
        ...     t: np.ndarray
        ...     __repr__ = short_repr
        >>> Curve(np.linspace(0.0, 2.0, 50))
        <Curve
          t: 50 numbers from 0 to 2>
    """
    lines = [f"<{type(result).__name__}"]
    for field in fields(result):
        value = getattr(result, field.name)
        is_empty = value is None or (np.ndim(value) == 0 and value in ("", {}))
        if not (callable(value) or is_empty):
            lines.append(f"  {field.name}: {_words(value)}")
    return "\n".join(lines) + ">"


def _words(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name!r}: {_words(one)}" for name, one in value.items()) or "none"
    if isinstance(value, float | np.floating):
        return f"{float(value):.6g}"
    if isinstance(value, list | np.ndarray) and np.asarray(value).dtype.kind in "biufc":
        return _of_array(np.asarray(value))
    return repr(value)


def _of_array(numbers: np.ndarray) -> str:
    if numbers.size <= MAX_NUMBERS and numbers.ndim == 1:
        return ", ".join(f"{number:.6g}" for number in numbers.tolist()) or "none"
    shape = " × ".join(map(str, numbers.shape))
    if numbers.size == 0:
        return f"{shape} numbers"
    if np.iscomplexobj(numbers):
        return f"{shape} complex numbers of up to {np.abs(numbers).max():.4g}"
    return f"{shape} numbers from {numbers.min():.4g} to {numbers.max():.4g}"

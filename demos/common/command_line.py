"""Words after the name of a demo on the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from gossamer_fx.extend import InputError, check


def number(word: str) -> float:
    """The finite number that a word is.

    Raises:
        InputError: it is not one.
    """
    try:
        found = float(word)
    except ValueError:
        found = math.nan
    if not math.isfinite(found):
        raise InputError(f"'{word}' is not a number; give one, e.g. 0.8.")
    return found


def named_values(words: Sequence[str], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Values by name, of words NAME=VALUE: numbers and words, of the types of the defaults.

    Raises:
        InputError: a word has another form, a name is not one of the defaults, or a value is not of
            its type.
    """
    found: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        check(bool(equals), f"'{word}' has no value; give NAME=VALUE.")
        check(
            name in defaults, f"There is no argument '{name}'; give one of {', '.join(defaults)}."
        )
        default = defaults[name]
        if isinstance(default, str):
            found[name] = text
            continue
        value = number(text)
        if isinstance(default, int):
            check(value == int(value), f"{name} is {text}; give a whole number.")
            value = int(value)
        found[name] = value
    return found


def check_words(words: Sequence[str], known: Sequence[str]) -> None:
    """Refuse words other than those that a demo knows.

    Raises:
        InputError: names the words that it knows.
    """
    for word in words:
        check(word in known, f"The demo has no '{word}'; give nothing, or {', '.join(known)}.")

"""Words after the name of a demo on the command line."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

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


def named_numbers(words: Sequence[str], names: Collection[str]) -> dict[str, float]:
    """Numbers by name, of words NAME=NUMBER.

    Raises:
        InputError: a word has another form, or a name is not one of `names`.
    """
    found = {}
    for word in words:
        name, equals, text = word.partition("=")
        check(
            bool(equals), f"'{word}' has no value; give NAME=NUMBER, e.g. {next(iter(names))}=0.8."
        )
        check(name in names, f"There is no argument '{name}'; give one of {', '.join(names)}.")
        found[name] = number(text)
    return found


def check_words(words: Sequence[str], known: Sequence[str]) -> None:
    """Refuse words other than those that a demo knows.

    Raises:
        InputError: names the words that it knows.
    """
    for word in words:
        check(word in known, f"The demo has no '{word}'; give nothing, or {', '.join(known)}.")

"""Texts of strangers in messages."""

from __future__ import annotations


def shown(text: str) -> str:
    r"""A text as one line, also if it has line breaks or characters that would control a terminal:
    their escape sequences, such as \n, stand for them.

    >>> print(shown("two\nlines"))
    two\nlines
    """
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else ascii(character)[1:-1] for character in text
    )

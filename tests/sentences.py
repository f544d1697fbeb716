"""What a message of an error is: one sentence that names the culprit."""

from __future__ import annotations


def is_sentence(words: str, longest: int = 300) -> bool:
    """Whether a message is one sentence, and no longer than a number of characters."""
    return "\n" not in words and words.endswith(".") and 20 < len(words) < longest


def assert_sentence(error: BaseException, culprit: str, longest: int = 300) -> None:
    """The message of an error is one sentence with some words."""
    words = str(error)
    assert is_sentence(words, longest), words
    assert culprit in words, words


def is_line_of_command(words: str) -> bool:
    """Whether the command says one sentence on the standard error."""
    return words.startswith("gossamer: ") and words.count("\n") == 1 and words.endswith(".\n")

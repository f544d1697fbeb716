"""The search of the site: what users type finds the page that is about it first."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
FIRST = {
    "units": "units",
    "damping": "howto/damping",
    "balloon": "howto/balloon",
    "boundary condition": "howto/hold",
    "solar sail": "howto/spin",
    "anchor": "howto/forces",
    "resultant": "howto/forces",
    "superpressure": "howto/balloon",
    "parachute": "howto/wind",
    "loss factor": "howto/damping",
    "von Mises": "howto/results",
    "imperfection": "howto/vibration",
}


def pages_by_words() -> dict[str, str]:
    """The page that the scorer puts first, by each of its words."""
    text = (DOCS / "scorer.js").read_text(encoding="utf-8")
    table = text.split("const ABOUT = {")[1].split("};")[0]
    found: dict[str, str] = {}
    for page, words in re.findall(r'"([\w/]+)": \[(.*?)\]', table):
        for word in re.findall(r'"([^"]+)"', words):
            assert word not in found, f"{word} has two pages"
            found[word] = page
    return found


def reduced(words: str) -> str:
    """Words as the scorer compares them: lower case, without the s of a plural."""
    return " ".join(word.removesuffix("s") for word in re.findall(r"\w+", words.lower()))


@pytest.mark.parametrize(("words", "page"), FIRST.items())
def test_words_of_users_lead_to_their_page(words: str, page: str) -> None:
    by_words = {reduced(one): found for one, found in pages_by_words().items()}
    assert by_words[reduced(words)] == page


@pytest.mark.parametrize(("words", "page"), pages_by_words().items())
def test_a_page_that_comes_first_has_the_words(words: str, page: str) -> None:
    """The index finds a page by its words only; the score puts it first."""
    text = reduced((DOCS / f"{page}.md").read_text(encoding="utf-8"))
    for word in reduced(words).split():
        assert word in text

"""Docstrings, comments, messages and pages use the field's words.

Each key of REMEDIES is an expression that an engineer from elsewhere would not understand, or would
understand as something else; its value is the field's term to write instead. The terms are defined
in docs/glossary.md.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# Regular expressions of whole words, case ignored, and the field's term for each.
REMEDIES = {
    r"anew": "again",
    r"likewise": "also; in the same way",
    r"hangs? together": "is connected",
    r"told once": "warned once",
    r"tells? (?:that|how|where|what)": "reports, states, shows",
    # "There is no group" is plain English, and so is a comparison: "is no larger than".
    r"(?<!there )(?:is|are) no (?!longer|more|less|other|\w+er\b)\w+": "is not a, are not",
    r"(?:has|have) none of": "has no, have no",
    r"books?|booked|booking": "ledger; counts as supplied, counts as dissipated",
    r"what (?:is left|searches|stores|remains|it takes)": "the noun: remainder, body, part, loss",
    r"keeps? (?:its|their)": "is constant; retains the",
    r"the same of": "the same for; the noun again",
    r"of (?:its|their) own": "separate; its own",
    r"beside": "in addition to, next to, compared with",
    r"pierc\w*": "penetration, interpenetration, intersects",
    r"halved steps?|steps?,? halved|\d+ halved|none halved": "rejected steps",
    r"careful starts?": "initial iterations without geometric stiffness",
    r"border(?:ed|s)?(?!\s*:|-)": "scalar unknowns (of a matrix); boundary (of a film)",
    # "In place" and "place the nodes" are plain English.
    r"(?:a|its|their|one|each|every|same|which|any|some|of|from|to|for|all|these|have) places?"
    r"|the places?": "point, position, location, index, degrees of freedom",
}
PATTERNS = {re.compile(rf"\b(?:{words})\b", re.IGNORECASE): REMEDIES[words] for words in REMEDIES}

FOLDERS = ("gossamer_fx", "meshes", "tools", "tests", "demos")
PAGES = ("README.md", "CONTRIBUTING.md", "docs")
# This file quotes the words.
EXCEPT = (ROOT / "tests" / "docs" / "test_plain_words.py",)

Line = tuple[int, str]


def texts_of_code(source: str) -> Iterator[Line]:
    """Docstrings, messages and comments of a Python file, by line; what is in backticks is a
    name."""
    for node in ast.walk(ast.parse(source)):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        # A string without a space is a name or a key.
        if is_text and " " in node.value:
            yield from enumerate(node.value.splitlines(), node.lineno)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def texts_of_page(source: str) -> Iterator[Line]:
    """The prose of a Markdown page, by line: without fenced blocks."""
    fenced = False
    for number, line in enumerate(source.splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced:
            yield number, line


def private_words(lines: Iterator[Line]) -> list[str]:
    """Private words in these lines, each with its line number and the term to write instead."""
    found = []
    for number, line in lines:
        prose = re.sub(r"`[^`]*`", "", line)
        for pattern, remedy in PATTERNS.items():
            for match in pattern.finditer(prose):
                found.append(f"line {number}: '{match.group()}'; write: {remedy}")
    return found


def newest_section(changelog: str) -> str:
    """The first section of the changelog; older ones say what was true in their time."""
    return changelog.split("\n## ")[1]


def files(names: tuple[str, ...], suffix: str) -> list[Path]:
    """Files with this suffix among the named files and folders, but for generated ones and
    EXCEPT."""
    found: list[Path] = []
    for path in (ROOT / name for name in names):
        found += [path] if path.is_file() else sorted(path.rglob(f"*{suffix}"))
    skipped = (*EXCEPT, ROOT / "docs" / "generated")
    return [path for path in found if not any(path.is_relative_to(folder) for folder in skipped)]


@pytest.mark.parametrize("folder", FOLDERS)
def test_code(folder: str) -> None:
    found = [
        f"{path.relative_to(ROOT)}, {word}"
        for path in files((folder,), ".py")
        for word in private_words(texts_of_code(path.read_text(encoding="utf-8")))
    ]
    assert not found, "\n".join(found)


def test_pages() -> None:
    found = [
        f"{path.relative_to(ROOT)}, {word}"
        for path in files(PAGES, ".md")
        for word in private_words(texts_of_page(path.read_text(encoding="utf-8")))
    ]
    assert not found, "\n".join(found)


def test_changelog() -> None:
    section = newest_section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert not private_words(texts_of_page(section))


@pytest.mark.parametrize(
    ("text", "is_private"),
    [
        ("The matrix is made anew.", True),
        ("3 steps, 2 halved", True),
        ("The group is no surface.", True),
        ("There is no group of this name, and the gap is no larger than d.", False),
        ("It changes in place.", False),
        ("`keeps_its_place` and `beside` are names", False),
    ],
)
def test_the_words_that_are_found(text: str, is_private: bool) -> None:
    assert bool(private_words(texts_of_page(text))) == is_private


def test_modules_in_the_glossary_exist() -> None:
    glossary = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    modules = set(re.findall(r"`(gossamer_fx/[^`]+)`", glossary))
    # Far fewer would mean that the expression above no longer finds them.
    assert len(modules) > 40
    assert [module for module in sorted(modules) if not (ROOT / module).exists()] == []

"""Check the words of docstrings, comments, messages and pages, and links: part of ./gossamer lint.

Each key of REMEDIES is an expression that an engineer from elsewhere would not understand, or would
understand as something else; its value is the field's term to write instead. The terms are defined
in docs/glossary.md. A message that goes on in another line fills the first one, or ends it with a
clause: nobody finds a broken one by its words.
"""

from __future__ import annotations

import ast
import io
import itertools
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

from packages import ROOT

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
# This file and its test quote the words; generated pages are made from checked ones.
EXCEPT = [ROOT / name for name in ("tools/words.py", "tests/unit/test_tools.py", "docs/generated")]
# A message's line that could have ended before this column with its next word was broken too early.
SHORT_LINE = 90

Line = tuple[int, str]


def texts_of_code(source: str) -> Iterator[Line]:
    """Docstrings, messages and comments of a Python file, by line; what is in backticks is a
    name."""
    for node in ast.walk(ast.parse(source)):
        # A string without a space is a name or a key.
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
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
                found.append(f"{number}: '{match.group()}'; write: {remedy}")
    return found


def string_literals(source: str) -> Iterator[list[tokenize.TokenInfo]]:
    """First and last token of each string of a file, in lists of strings that follow each other."""
    joined: list[tokenize.TokenInfo] = []
    depth = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.FSTRING_START:
            depth += 1
            if depth == 1:
                joined.append(token)
        elif token.type == tokenize.FSTRING_END:
            depth -= 1
            if depth == 0:
                joined.append(token)
        elif depth == 0 and token.type == tokenize.STRING:
            joined += [token, token]
        elif depth == 0 and token.type not in (tokenize.NL, tokenize.COMMENT):
            yield joined
            joined = []


def broken_messages(source: str) -> list[str]:
    """Messages whose next word has room in the line where they break off, within a clause."""
    lines = source.splitlines()
    found = []
    for joined in string_literals(source):
        for end, start in itertools.pairwise(joined[1:-1]):
            number, column = end.end
            before = lines[number - 1][: column - 1]
            following = lines[start.start[0] - 1][start.start[1] :].lstrip("fFrR").strip("\"'")
            word = re.split(r"[ \"']", following)[0]
            is_within_clause = re.search(r"\w $", before) is not None
            has_room = column + len(word) < SHORT_LINE
            if start.start[0] > number and is_within_clause and has_room and word:
                found.append(f"{number}: '{word}' has room in this line; wrap the message again")
    return found


def newest_section(changelog: str) -> str:
    """The first section of the changelog; older ones say what was true in their time."""
    return changelog.split("\n## ")[1]


def files(names: tuple[str, ...], suffix: str) -> list[Path]:
    """Files with this suffix among the named files and folders, but for EXCEPT."""
    found: list[Path] = []
    for path in (ROOT / name for name in names):
        found += [path] if path.is_file() else sorted(path.rglob(f"*{suffix}"))
    return [path for path in found if not any(path.is_relative_to(folder) for folder in EXCEPT)]


def dead_links(page: Path) -> list[str]:
    """Relative links of a page that lead to no file; generated pages are not there yet."""
    found = []
    for number, line in texts_of_page(page.read_text(encoding="utf-8")):
        for target in re.findall(r"\]\(([^)\s]+)\)", line):
            is_file = not re.match(r"[a-z]+:|#", target) and "generated/" not in target
            if is_file and not (page.parent / target.split("#")[0]).exists():
                found.append(f"{number}: the link leads nowhere: {target}")
    return found


def templates() -> Iterator[str]:
    """Strings of the package; a formatted value in them is "{}"."""
    for path in files(("gossamer_fx",), ".py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
            elif isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else "{}" for p in node.values]
                yield "".join(map(str, parts))


def unknown_messages() -> list[str]:
    """Messages that their page quotes, "..." being any words, and that no module has."""
    page = (ROOT / "docs" / "messages.md").read_text(encoding="utf-8")
    known = "\n".join(templates())
    found = []
    for quoted in re.findall(r'"([^"]+)"', page):
        words = ".*".join(re.escape(part) for part in quoted.split("..."))
        if not re.search(words, known):
            found.append(f" no message is '{quoted}'")
    return found


def unlisted_pages() -> list[str]:
    """Pages of the site that its table of contents leaves out."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    listed = {"index", *re.findall(r"^([\w/]+)$", index, re.MULTILINE)}
    pages = (path.relative_to(ROOT / "docs") for path in files(("docs",), ".md"))
    return [f" {page} is in no table of contents" for page in pages if str(page)[:-3] not in listed]


def remarks() -> Iterator[str]:
    """All that is to be changed, with file and line."""
    for path in files(FOLDERS, ".py"):
        source = path.read_text(encoding="utf-8")
        found = private_words(texts_of_code(source))
        if path.is_relative_to(ROOT / "gossamer_fx") or path.is_relative_to(ROOT / "meshes"):
            found += broken_messages(source)
        yield from (f"{path.relative_to(ROOT)}:{words}" for words in found)
    for path in files(PAGES, ".md"):
        found = private_words(texts_of_page(path.read_text(encoding="utf-8"))) + dead_links(path)
        yield from (f"{path.relative_to(ROOT)}:{words}" for words in found)
    section = newest_section((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    yield from (f"CHANGELOG.md: line {words}" for words in private_words(texts_of_page(section)))
    yield from (f"docs/index.md:{words}" for words in unlisted_pages())
    yield from (f"docs/messages.md:{words}" for words in unknown_messages())


def main() -> int:
    """Print what is found; returns 1 if there is anything."""
    found = list(remarks())
    for remark in found:
        print(remark)
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())

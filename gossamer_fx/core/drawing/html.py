"""Tables in HTML, by which notebooks show objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as HTML; all texts are escaped.

    Args:
        head: names of the columns.
        rows: texts of each row, one for each column (their number is not checked).

    Returns:
        One line of HTML.

    Example:
        >>> table(["kind"], [["a < b"]])
        '<table><tr><th>kind</th></tr><tr><td>a &lt; b</td></tr></table>'
    """
    lines = [_row("th", head)]
    for row in rows:
        lines.append(_row("td", row))
    inside = "".join(lines)
    return f"<table>{inside}</table>"


def _row(kind: str, words: Sequence[str]) -> str:
    cells = ""
    for word in words:
        text = escape(word)
        cells += f"<{kind}>{text}</{kind}>"
    return f"<tr>{cells}</tr>"

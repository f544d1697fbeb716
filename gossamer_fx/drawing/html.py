"""Tables in HTML, by which notebooks show objects."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as HTML; all texts are escaped.

    Args:
        head: names of the columns.
        rows: texts of each row.

    Example:
        >>> table(["kind"], [["a < b"]])
        '<table><tr><th>kind</th></tr><tr><td>a &lt; b</td></tr></table>'
    """
    lines = [_row("th", head)]
    lines += [_row("td", row) for row in rows]
    return f"<table>{''.join(lines)}</table>"


def _row(kind: str, words: Sequence[str]) -> str:
    cells = "".join(f"<{kind}>{escape(word)}</{kind}>" for word in words)
    return f"<tr>{cells}</tr>"

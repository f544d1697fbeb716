"""Names of files: of anything that has a name, one to one, and of the segments of a file that a run goes on in.

A run that goes on, also after a restart, leaves `film.bp`, `film_0001.bp`, `film_0002.bp`, ...
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

_LONGEST = 100  # characters of a name that stay
_SEGMENT = re.compile(r"_(\d{4,})")


def file_name(name: str) -> str:
    """A name that a file may have; other names have other files.

    Letters, digits, blanks and `- _ .` stay, other characters become % and the hexadecimal digits of their UTF-8.  So
    does what would make a segment of another file of it (`_` before four digits at the end), hide it (`.` in front), or
    be lost (a blank at an end).  A long name ends in a hash.
    """

    def escaped(text: str) -> str:
        return "".join(f"%{byte:02X}" for byte in text.encode("utf-8", errors="surrogatepass"))

    safe = "".join(c if (c.isascii() and c.isalnum()) or c in " -_." else escaped(c) for c in name)
    safe = re.sub(r"^[. ]|[. ]$|_(?=\d{4,}$)", lambda found: escaped(found[0]), safe)
    if len(safe) > _LONGEST:
        return f"{safe[:_LONGEST]}%{hashlib.sha256(name.encode(errors='surrogatepass')).hexdigest()[:16]}"
    return safe or "%"


def segment(path: Path, number: int) -> Path:
    """The file that a run begins when it goes on for the `number`-th time; at first it is `path`."""
    return path.with_stem(f"{path.stem}_{number:04d}") if number else path


def segment_number(path: Path, other: Path) -> int | None:
    """Which segment of `path` another file in the same folder is; None: it is another file's."""
    if (
        other.parent != path.parent
        or other.suffix != path.suffix
        or not other.stem.startswith(path.stem)
    ):
        return None
    found = _SEGMENT.fullmatch(other.stem[len(path.stem) :])
    return 0 if other == path else int(found[1]) if found else None


def segments(path: Path) -> list[Path]:
    """The segments of a file that there are, in their order."""
    beside = path.parent.iterdir() if path.parent.is_dir() else ()
    found = [
        (number, other) for other in beside if (number := segment_number(path, other)) is not None
    ]
    return [other for _, other in sorted(found)]

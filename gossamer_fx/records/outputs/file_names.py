"""Names of files for objects with any name, and for the segments of a file.

A run that continues, also after a restart, leaves the segments `film.bp`, `film_0001.bp`, ...
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

# Characters of a name that are kept: file systems allow 255 bytes, and endings are added.
_MAX_CHARACTERS = 100

# Hexadecimal digits of the hash that ends a long name.
_HASH_DIGITS = 16

# The end of the name of a segment.
_SEGMENT = re.compile(r"_(\d{4,})")

# A point in front hides a file, blanks and points at an end are lost on some systems, and `_`
# before four digits at the end would make the name that of a segment of another file.
_MISLEADING = re.compile(r"^[. ]|[. ]$|_(?=\d{4,}$)")


def file_name(name: str) -> str:
    """A file name for an object's name; different names give different file names.

    Letters, digits, blanks and `- _ .` are kept.  Other characters, and those that would mislead,
    become % and the hexadecimal digits of their UTF-8.  A name over 100 characters is cut and ends
    in a hash.

    Args:
        name: any text, e.g. the name of a body; an empty one gives "%".

    Example:
        >>> file_name("film/left")
        'film%2Fleft'
    """
    characters = []
    for character in name:
        is_alphanumeric = character.isascii() and character.isalnum()
        if is_alphanumeric or character in " -_.":
            characters.append(character)
        else:
            characters.append(_escaped(character))
    safe = _MISLEADING.sub(lambda found: _escaped(found[0]), "".join(characters))
    if len(safe) > _MAX_CHARACTERS:
        # Of the full name, as long names may differ at their ends only.
        digest = hashlib.sha256(name.encode(errors="surrogatepass")).hexdigest()
        return f"{safe[:_MAX_CHARACTERS]}%{digest[:_HASH_DIGITS]}"
    return safe or "%"


def _escaped(text: str) -> str:
    """% and two hexadecimal digits for each byte of a text in UTF-8, also of half a surrogate
    pair."""
    encoded = text.encode("utf-8", errors="surrogatepass")
    return "".join(f"%{byte:02X}" for byte in encoded)


def segment(path: Path, number: int) -> Path:
    """The file `film_0002.bp` that a run writes in place of `film.bp` after its second restart."""
    if number == 0:
        return path
    return path.with_stem(f"{path.stem}_{number:04d}")


def segment_number(path: Path, other: Path) -> int | None:
    """2 for `film_0002.bp` as a segment of `film.bp`, 0 for `film.bp` itself; None for other files.

    A run that is continued by a restart writes its later records to such segments.

    Args:
        path: of an output, without the number of a segment.
        other: of the file that may be one of its segments.
    """
    if other == path:
        return 0
    if other.parent != path.parent or other.suffix != path.suffix:
        return None
    if not other.stem.startswith(path.stem):
        return None
    ending = other.stem[len(path.stem) :]
    found = _SEGMENT.fullmatch(ending)
    if found is None:
        return None
    return int(found[1])


def segments(path: Path) -> list[Path]:
    """The existing files of one output, in the order in which a run and its restarts wrote them.

    These are `film.bp`, `film_0001.bp`, and so on; an empty list if there is none.

    Args:
        path: of the output, without the number of a segment.
    """
    if not path.parent.is_dir():
        return []
    found = []
    for other in path.parent.iterdir():
        number = segment_number(path, other)
        if number is not None:
            found.append((number, other))
    return [other for _, other in sorted(found)]

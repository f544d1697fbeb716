"""Names of files for objects with any name."""

from __future__ import annotations

import hashlib
import re

# Characters of a name that are kept: file systems allow 255 bytes, and endings are added.
_MAX_CHARACTERS = 100

# Hexadecimal digits of the hash that ends a long name.
_HASH_DIGITS = 16

# A point in front hides a file; blanks and points at an end are lost on some systems.
_MISLEADING = re.compile(r"^[. ]|[. ]$")


def file_name(name: str) -> str:
    """A file name for an object's name; different names give different file names.

    Letters, digits, blanks and `- _ .` are kept.  Other characters, and those that would mislead,
    become % and the hexadecimal digits of their UTF-8.  A name over 100 characters is cut and ends
    in a hash.

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

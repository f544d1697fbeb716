"""The file `run.json` in a run's folder: its contents, and their check when it is read.

The file may come from a stranger.  It is checked as a whole when it is read, so that its readers
find the keys and types that they expect.  An error names the key, the value and the expected type.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from gossamer_fx.core.checks.errors import InputError, check

# Number of the format of run.json and of the other files in the folder.
FORMAT = 2

_REMEDY = "write the run again, or put back a copy of the file."

# Larger integers do not fit into the arrays of NumPy.
_MAX_INTEGER = 2**63

# Characters of a value in a message: the file may contain a text of any length.
_MAX_SHOWN = 60

# The kind of a value is a type, where float stands for any number and object for anything; a
# dictionary of kinds by key, or {str: kind} for free keys; [kind] for a list of any length; or a
# tuple of the kinds of a list of fixed length.
_POINT = (float, float, float)

_SOLID = {
    "X": [_POINT],
    "triangles": [(int, int, int)],
    "lines": [(int, int)],
    "moves": bool,
}
_BODY = {
    "kind": str,
    "nodes": int,
    "unknowns": int,
    "mass": float,
    "box": (_POINT, _POINT),
    "cells?": int,
    "order?": int,
    "groups?": [str],
    "area?": float,
    "length?": float,
    "law?": (str, {str: object}),
}
_PRESTRESS = {
    "unit": str,
    "asked": float,
    "mean": float,
    "least": float,
    "largest": float,
}
_CHAMBER = dict.fromkeys(("pressure", "temperature", "volume", "mass"), float)
# Kinds by key; a key that ends in a question mark may be missing, e.g. in the files of older
# versions.
_RUN = {
    "format": int,
    "title": str,
    "status": str,
    "ranks": int,
    "scene": {
        "unknowns": int,
        "ranks": int,
        "bodies": {str: _BODY},
        "section frames?": [str],
        "roles": {str: int},
        "items": {str: str},
        "chambers": {str: _CHAMBER},
        "energies": {str: float},
        "momentum": _POINT,
        "angular momentum": _POINT,
    },
    "arguments?": {str: {str: object}},
    "kind": str,
    "axis": {"name": str, "unit": str, "at": float, "until": float},
    "method": {str: object},
    "fields": {str: [str]},
    "groups?": [str],
    "solids?": [_SOLID],
    "versions": {str: str},
    "captions": [str],
    "result?": {str: object},
    "prestress?": {str: _PRESTRESS},
    "statistics": {
        "steps": int,
        "rejected": int,
        "iterations": int,
        "iterations a step": float,
        "seconds": float,
        "seconds of compilation": float,
        "at rest?": bool,
        "energy error?": float,
        "energy defect?": float,
        "largest energy?": float,
        "mass error?": float,
    },
}

# What a value of a kind is called in messages.
_WORDS = {bool: "true or false", str: "a text", int: "an integer", float: "a number"}


def read_run_file(folder: Path) -> dict[str, Any]:
    """The contents of a run's `run.json`, checked."""
    path = folder / "run.json"
    check(
        path.is_file(),
        f"There is no run in '{folder}'; give a folder with a run.json, as `Recording` writes.",
    )
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"'{path}' cannot be read ({error}); {_REMEDY}") from error
    version = None
    if isinstance(about, dict):
        version = about.get("format")
    # The format comes before all else: in another one, other keys are right.
    check(
        not isinstance(version, int) or version == FORMAT,
        f"'{path}' is of format {version}, not {FORMAT}; read it with the program that wrote it.",
    )
    _check_kind(path, "the file", about, _RUN)
    for solid in about.get("solids", []):
        point_count = len(solid["X"])
        indices = []
        for face in (*solid["triangles"], *solid["lines"]):
            indices += face
        check(
            all(0 <= index < point_count for index in indices),
            f"'{path}': a solid has {point_count} points, but its faces use others; {_REMEDY}",
        )
    return dict(about)


def _check_kind(path: Path, where: str, value: Any, kind: Any) -> None:
    """Raise `InputError` unless a value of a JSON file has the expected structure."""
    if isinstance(kind, dict):
        _refuse_unless(isinstance(value, dict), path, where, value, "an object")
        if str in kind:
            for name, inner in value.items():
                _check_kind(path, f"{where} of {name!r}", inner, kind[str])
            return
        for key, inner in kind.items():
            name = key.removesuffix("?")
            check(name in value or key != name, f"'{path}': {where} has no '{name}'; {_REMEDY}")
            if name in value:
                _check_kind(path, f"'{name}'", value[name], inner)
    elif isinstance(kind, list | tuple):
        _refuse_unless(isinstance(value, list), path, where, value, "a list")
        kinds = kind
        if isinstance(kind, list):
            kinds = kind * len(value)
        _refuse_unless(len(value) == len(kinds), path, where, value, f"a list of {len(kinds)}")
        for inner, inner_kind in zip(value, kinds, strict=True):
            _check_kind(path, where, inner, inner_kind)
    elif kind in _WORDS:
        types = (int, float) if kind is float else kind
        fits = isinstance(value, types)
        if kind is int or kind is float:
            # In Python, bool is a subclass of int.
            is_large = isinstance(value, int) and abs(value) >= _MAX_INTEGER
            fits = fits and not isinstance(value, bool) and not is_large
        _refuse_unless(fits, path, where, value, _WORDS[kind])


def _refuse_unless(right: bool, path: Path, where: str, value: Any, expected: str) -> None:
    """Raise `InputError` unless a value of a run.json is right."""
    shown = repr(value)
    if len(shown) > _MAX_SHOWN:
        shown = f"{shown[:_MAX_SHOWN]}..."
    check(right, f"'{path}': {where} is {shown}, but must be {expected}; {_REMEDY}")


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

"""Lengths and checksums of the files of a field output, step by step: damage is told, and later steps can be cut off.

ADIOS2 only ever adds to the files in the folder of a BP5 output, and a step is on the disk when its writing returns.
`checksums.jsonl` beside them has a line for every step: where each file ended, and the CRC-32 of what the step added.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path

from gossamer_fx.checks.errors import InputError, check

Ends = dict[str, tuple[int, int]]  # by file: its length, and the checksum of what was added last

_NAME = "checksums.jsonl"
_PARTS = ("data.", "md.", "mmd.")
_BLOCK = 1 << 20  # bytes
_ACTIVE = 39  # the byte of md.idx that says whether the file is still open, the only one that ever changes


class Checksums:
    """The checksums of a field output that is being written; on the rank that keeps them.

    Args:
        folder: `.bp`; checksums of an earlier file of this name are removed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._ends: Ends = {}
        (folder / _NAME).unlink(missing_ok=True)
        for old in folder.glob("data.*"):  # as many as the earlier file had writers
            old.unlink()

    def add(self) -> None:
        """Note the step that was written last.

        Raises:
            OSError: the disk is full, ...; the lines before are whole.
        """
        for path in self.folder.iterdir():
            if path.name.startswith(_PARTS):
                before = self._ends.get(path.name, (0, 0))[0]
                end = path.stat().st_size
                self._ends[path.name] = end, _crc(path, before, end)
        with (self.folder / _NAME).open("ab", buffering=0) as file:
            line = json.dumps(self._ends).encode() + b"\n"
            if file.write(line) != len(line):
                raise OSError(28, "No space left on device")


class Verified:
    """The steps of a field output as its checksums tell them; none for a file that has none.

    Args:
        folder: `.bp`.

    Raises:
        InputError: a file is missing or shorter than it was, or what describes the data was changed.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.steps = self._read()
        for name, (end, _) in (self.steps[-1] if self.steps else {}).items():
            path = folder / name
            size = path.stat().st_size if path.is_file() else -1
            check(
                size >= end,
                f"'{path}' is {'shorter than it was' if size >= 0 else 'missing'}; {_REMEDY}",
            )
        for k in range(len(self.steps)):
            self._compare(k, ("md.", "mmd."))

    def _read(self) -> list[Ends]:
        path, steps = self.folder / _NAME, list[Ends]()
        if not path.is_file():
            return steps
        *lines, _ = path.read_bytes().split(b"\n")  # a last line without end was not written wholly
        try:
            for line in lines:
                steps.append(
                    {
                        str(name): (int(end), int(crc))
                        for name, (end, crc) in json.loads(line).items()
                    }
                )
        except (ValueError, TypeError, AttributeError) as error:
            raise InputError(f"'{path}' is damaged ({error}); {_REMEDY}") from error
        return steps

    def check_step(self, k: int) -> None:
        """Raise `InputError` if the data of a step are not those that were written."""
        if k < len(self.steps):
            self._compare(k, ("data.",))

    def _compare(self, k: int, kinds: tuple[str, ...]) -> None:
        for name, (end, crc) in self.steps[k].items():
            if name.startswith(kinds):
                start = self.steps[k - 1].get(name, (0, 0))[0] if k else 0
                path = self.folder / name
                check(
                    _crc(path, start, end) == crc,
                    f"'{path}' was changed since it was written; {_REMEDY}",
                )

    def cut(self, count: int) -> None:
        """Cut off all but the first `count` steps.

        Raises:
            InputError: there are not so many.
        """
        check(
            0 < count <= len(self.steps),
            f"'{self.folder}' has {len(self.steps)} steps, and had {count} when the checkpoint was written; {_REMEDY}",
        )
        ends: Mapping[str, tuple[int, int]] = self.steps[count - 1]
        for name, (end, _) in ends.items():
            os.truncate(self.folder / name, end)
        with (self.folder / _NAME).open("r+b") as file:
            for _ in range(count):
                file.readline()
            file.truncate(file.tell())


_REMEDY = "put back a copy of it, or start anew."


def _crc(path: Path, start: int, end: int) -> int:
    """CRC-32 of the bytes from start to end of a file."""
    crc, left = 0, end - start
    with path.open("rb") as file:
        file.seek(start)
        while left > 0 and (block := file.read(min(left, _BLOCK))):
            if path.name == "md.idx" and file.tell() == len(block):
                block = block[:_ACTIVE] + block[_ACTIVE + 1 :]
                left -= 1
            crc, left = zlib.crc32(block, crc), left - len(block)
    return crc

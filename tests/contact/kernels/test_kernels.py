"""The C files of the package: each compiles by itself without a warning, and constants agree with
Python."""

from __future__ import annotations

import shlex
import subprocess
import sysconfig
from enum import IntEnum
from pathlib import Path

import pytest

import gossamer_fx
from gossamer_fx.core.forms.c_source import declarations_of
from gossamer_fx.mechanics.contact.cone import EdgeCone, PointInCone
from gossamer_fx.mechanics.contact.contact_step import ContactLaw, PairState
from gossamer_fx.mechanics.contact.kernels.library import library
from gossamer_fx.mechanics.contact.narrow_phase import intersections
from gossamer_fx.mechanics.contact.pairs import NUMBERS_OF_LAWS, STENCILS

PACKAGE = Path(gossamer_fx.__file__).parent
C_FILES = sorted(path for path in PACKAGE.rglob("*.[ch]"))

# A function longer than this does not fit on a screen with its comment.
LONGEST_FUNCTION = 60


@pytest.mark.parametrize("enumeration", [ContactLaw, PairState])
def test_numbers_of_python_are_those_of_the_header(enumeration: type[IntEnum]) -> None:
    c = library()
    for member in enumeration:
        assert getattr(c.lib, member.name) == member.value


def test_each_stencil_has_the_row_of_its_name() -> None:
    """The table in C and the classes of Python name the same kinds, in the same order."""
    c = library()
    # Those of cones are known once their module is loaded.
    assert {EdgeCone.number, PointInCone.number} <= STENCILS.keys()
    names = [
        c.ffi.string(c.lib.kind_name(number)).decode().replace("_", "")
        for number in range(c.lib.kind_count())
    ]
    # Boundaries with a law have numbers beyond the table.
    known = [number for number in sorted(STENCILS) if number not in NUMBERS_OF_LAWS]
    assert names == [type(STENCILS[number]).__name__.upper() for number in known]


def test_answers_of_intersections_are_those_of_the_header() -> None:
    c = library()
    assert c.lib.INTERSECTS == intersections.INTERSECTS
    assert c.lib.UNSURE == intersections.UNSURE


@pytest.mark.parametrize("path", C_FILES, ids=lambda path: path.name)
def test_each_file_compiles_by_itself_without_a_warning(path: Path, tmp_path: Path) -> None:
    """A header compiles as a file that includes it, and nothing else."""
    compiler = shlex.split(sysconfig.get_config_var("CC"))[0]
    alone = tmp_path / "alone.c"
    alone.write_text(f'#include "{path}"\n')
    for definitions in ([], ["-DKERNELS_TAKE_DATA"]):
        command = [compiler, "-std=c11", "-O1", "-Wall", "-Wextra", "-Wshadow", "-Werror"]
        # The warnings of -Wall, -Wextra and -Wshadow are errors here.
        command += [*definitions, "-I", str(path.parent), "-c", str(alone), "-o", "/dev/null"]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("path", C_FILES, ids=lambda path: path.name)
def test_functions_fit_on_a_screen_and_names_are_ascii(path: Path) -> None:
    start = 0
    in_comment = False
    for number, line in enumerate(path.read_text().splitlines(), 1):
        if line.startswith("/*"):
            in_comment = True
        if line == "{":
            start = number
        if line == "}" and start:
            assert number - start < LONGEST_FUNCTION, f"{path.name}:{start}"
            start = 0
        code = "" if in_comment else line.split("/*")[0]
        assert code.isascii(), f"{path.name}:{number}"
        if line.endswith("*/"):
            in_comment = False


def test_declarations_are_all_lines_but_the_preprocessors(tmp_path: Path) -> None:
    header = tmp_path / "some.h"
    header.write_text("#ifndef A\n#include <math.h>\nint f(int);\n#endif\n")
    assert declarations_of(header).strip() == "int f(int);"

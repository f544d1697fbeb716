"""C functions: arrays are checked before C sees them, and a missing compiler is one sentence."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gossamer_fx.core.forms.c_source import CLibrary, c_library, check_indices

HEADER = """
#ifndef SUM_H
#define SUM_H
#include <stddef.h>
typedef struct {
    ptrdiff_t count;
    const double *values;
} list;
double sum(const list *of);
#endif
"""

SOURCE = """
#include "sum.h"
#define FACTOR 2
double sum(const list *of)
{
    double total = 0;
    for (ptrdiff_t i = 0; i < of->count; ++i) total += of->values[i] * FACTOR;
    return total;
}
"""


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> CLibrary:
    folder = tmp_path_factory.mktemp("sum")
    (folder / "sum.h").write_text(HEADER)
    (folder / "sum.c").write_text(SOURCE)
    return c_library(folder / "sum.h")


def test_a_function_reads_an_array_of_a_structure(library: CLibrary) -> None:
    values = np.arange(4.0)
    fields = {"count": 4, "values": library.array("values", values, "float64", (4,))}
    assert library.lib.sum(library.struct("list", fields).pointer) == 12


@pytest.mark.parametrize(
    "values, message",
    [
        (np.zeros(3, np.float32), "values is of type float32; give a contiguous array of float64"),
        (np.zeros(4), r"values has the shape \(4,\); give .* with the shape \(3,\)"),
        (np.zeros(6)[::2], "values is not contiguous"),
    ],
)
def test_an_array_that_c_would_misread_is_refused(library, values, message) -> None:
    with pytest.raises(ValueError, match=message):
        library.array("values", values, "float64", (3,))


def test_a_read_only_array_is_not_written(library: CLibrary) -> None:
    values = np.zeros(3)
    values.flags.writeable = False
    library.array("values", values, "float64", (3,))
    with pytest.raises(ValueError, match="values is read-only"):
        library.array("values", values, "float64", (3,), writable=True)


def test_no_array_is_a_null_pointer(library: CLibrary) -> None:
    assert library.array("values", None, "float64", (3,)) == library.ffi.NULL


def test_all_fields_of_a_structure_are_given(library: CLibrary) -> None:
    with pytest.raises(ValueError, match=r"fields of list are \['count', 'values'\], given"):
        library.struct("list", {"count": 1})


def test_indices_out_of_range_are_refused() -> None:
    check_indices("indices", np.zeros(0, np.int32), 0)
    check_indices("indices", np.array([0, 2], np.int32), 3)
    with pytest.raises(ValueError, match="indices are from -1 to 3; give 0 to 2"):
        check_indices("indices", np.array([3, -1], np.int32), 3)


CONTACT = """
from gossamer_fx.mechanics.contact.kernels.library import library
library()
"""

FILM = """
from mpi4py import MPI
import gossamer_fx as gx
from gossamer_fx.meshes.sheet import sheet

law = gx.Miyazaki(E=1e9, nu=0.3, density=1400.0, thickness=1e-4)
film = gx.Membrane(sheet(MPI.COMM_WORLD, 1, 1), law)
gx.Simulation(gx.Scene(film), gx.Midpoint(dt=1e-3))
"""


@pytest.mark.parametrize("program", [CONTACT, FILM], ids=["contact", "film"])
def test_a_missing_compiler_is_one_sentence(tmp_path: Path, program: str) -> None:
    """In an empty cache, with a compiler that does not exist; forms need one as C functions do."""
    variables = {"XDG_CACHE_HOME": str(tmp_path), "CC": "no-such-compiler -O2"}
    result = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | variables,
        capture_output=True,
        text=True,
        check=False,
    )
    last = result.stderr.strip().splitlines()[-1]
    assert result.returncode != 0
    assert "InputError: The C compiler 'no-such-compiler' is not there; install one" in last
    assert not list(tmp_path.rglob("*.so"))

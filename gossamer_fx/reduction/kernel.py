"""The C functions of reduced films, compiled once a machine and kept beside the kernels of the forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

from gossamer_fx.forms.backend import KERNELS_TAKE_DATA
from gossamer_fx.forms.c_source import compile_c

DECLARATIONS = """
typedef struct {
    uintptr_t function;
    const double *constants;
    int n;
    const int32_t *from;
} expression;
typedef struct {
    int cells, points, others, geometry;
    const expression *sort, *law, *energy;
    const double *x, *other, *dA;
    double *start, *strain, *response, *missed;
    int32_t *idle;
} film;
void set_strains(const film *f, const double *F, const double *dF, int way);
int choose_strains(const film *f, const double *F, const double *dF, double surroundings, double far, double falls,
                   int most);
double energy(const film *f);
void forces(const film *f, const double *F0, const double *F, double alpha, double *N);
void stiffness_times(const film *f, const double *F0, const double *F, double alpha, double share, int r,
                     const double *G, double *TG);
"""


_loaded: list[Any] = []


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> Any:
    """The functions (`.lib`) and types (`.ffi`) of points.c; rank 0 of `comm` compiles them for all."""
    if not _loaded:
        types = DECLARATIONS[: DECLARATIONS.index("void set")]
        more, nothing = (", void *", ", NULL") if KERNELS_TAKE_DATA else ("", "")
        source = (Path(__file__).parent / "points.c").read_text(encoding="utf-8")
        source = f"#include <stdint.h>\n#define MORE {more}\n#define NOTHING_MORE {nothing}\n{types}{source}"
        _loaded.append(compile_c(comm, "reduction", DECLARATIONS, source))
    return _loaded[0]

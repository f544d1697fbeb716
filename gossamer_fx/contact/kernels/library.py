"""The C kernels of contact, compiled once a machine and kept beside those of the forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

import gossamer_fx.forms.c_source as c_source

DECLARATIONS = """
void squared_distances(int n, const int32_t *pairs, const uint8_t *kind, const double *x, double *s, double *uv);
void starts(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *S, double eps,
            double *start);
void approaches(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1,
                const double *margin, double *way);
int act(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1, const double *k,
        const double *S, const double *offset, const double *start, double eps, int law, double alpha,
        double geometric, double push, int again, uint8_t *active, double *force, const int32_t *slots, double *values,
        double *forces, double *tangents);
double energy(int n, const int32_t *pairs, const uint8_t *kind, const double *x, const double *k, const double *S,
              const double *offset, double eps, int law, double *X);
int lay_out(int n, int vectors, const int32_t *width, const int32_t *members, int32_t *slots, int32_t *rows,
            int32_t *columns, int32_t *of_vectors, int32_t *of_members);
void which_count(int n, const int32_t *block, const double *values, uint8_t *kept);
void build_tree(int n, int size, const double *boxes, const int32_t *order, double *tree);
int64_t overlaps(int n, int size, const double *tree, const int32_t *order, int queries, const int32_t *query,
                 const double *boxes, int self, int ka, const int32_t *a, int kb, const int32_t *b,
                 const uint8_t *fixed_a, const uint8_t *fixed_b, int64_t room, int32_t *pairs);
void pierced(int n, const int32_t *pairs, const int32_t *edges, const int32_t *triangles, const double *x,
             uint8_t *found);
int motion(int n, const int32_t *pairs, const uint8_t *kind, const double *x0, const double *x1, const double *radius,
           const double *gap, const double *least, int most, uint8_t *free);
"""

SOURCES = "pair_forces.c", "broad_phase.c", "intersections.c", "block_pattern.c"

Integers = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]
Array = npt.NDArray[np.floating]


_loaded: list[Any] = []


def library(comm: MPI.Intracomm = MPI.COMM_SELF) -> Any:
    """The functions (`.lib`) and types (`.ffi`) of the C files; rank 0 of `comm` compiles them for all."""
    if not _loaded:
        folder = Path(__file__).parent
        source = "\n".join((folder / name).read_text(encoding="utf-8") for name in SOURCES)
        _loaded.append(c_source.compile_c(comm, "contact", DECLARATIONS, source))
    return _loaded[0]


def pointers(*arrays: npt.NDArray[Any] | None) -> list[Any]:
    """Arrays as arguments of a C function; None is a null pointer."""
    return c_source.pointers(library().ffi, *arrays)

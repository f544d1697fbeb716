/* Patch kernel: volumes of chambers, their gradients and the tangent of their pressures, from the
   patches of the surfaces that bound them; see gas/patches.py, (1) to (4).

   The C compiler reads this file, and so does cffi, without the preprocessor's lines
   (forms/c_source.py).  Python checks lengths, types and writability of all arrays, and the range
   of all indices, before it calls a function. Shapes stand in brackets; arrays are stored row by
   row.

   n patches of one kind with k nodes and g quadrature points each; c chambers; u unknowns of this
   rank, first those that it owns, then ghosts; b blocks of the tangent.  Lengths in metres. */
#ifndef GOSSAMER_PATCHES_H
#define GOSSAMER_PATCHES_H

#include <stddef.h>
#include <stdint.h>

/* Patches of one kind that bound one chamber. */
typedef struct {
    ptrdiff_t count;        /* n */
    ptrdiff_t node_count;   /* k */
    ptrdiff_t point_count;  /* g */
    ptrdiff_t table_stride; /* g k if each patch has its own tables, 0 if all have the same */
    ptrdiff_t chamber;      /* number of the chamber, below c */
    double sign;            /* 1, or -1 if the normals of other patches point to the other side */
    const int32_t *nodes;   /* (n, k) number of the first of the three coordinates of a node */
    const double *along;    /* (g, k) or (n, g, k) slopes of the nodes' functions by s */
    const double *across;   /* slopes by r */
    const double *test;     /* values of the functions times the weight of the point */
    const int32_t *blocks;  /* (n, k, k) block of the tangent of each pair of nodes */
} gas_patches;

/* All patches that this rank evaluates, and what follows from them. */
typedef struct {
    ptrdiff_t kind_count;
    ptrdiff_t chamber_count;   /* c */
    ptrdiff_t unknown_count;   /* u */
    ptrdiff_t owned_count;     /* at most u */
    ptrdiff_t block_count;     /* b */
    double alpha;              /* weight of the end of a step in the positions where forces act */
    gas_patches **kinds;       /* (kind_count) */
    const double *orientation; /* (c) 1, or -1 if all normals of a chamber point inwards */
    const double *pressure;    /* (c) [Pa] */
    const double *start;       /* (u) coordinates at the start of the step */
    const double *end;         /* (u) and at its end */
    double *mid;               /* (u) and where forces act */
    double *at_mid;            /* (c, u) gradients of the volumes there [m^2] */
    double *at_end;            /* (c, u) and at the end */
    double *sums;              /* (3, c) volume, sizes of the terms of three volumes, swept volume */
    double *blocks;            /* (b, 3, 3) of the tangent [N/m], each column by column */
} gas_surfaces;

/* Set mid, and at_mid and at_end to the shares of this rank's patches. */
void patches_gradients(const gas_surfaces *all);

/* Set sums to the shares of this rank's own unknowns in (2) and (3). */
void patches_sums(const gas_surfaces *all);

/* Set blocks to the derivative of the pressures' forces by the end of the step, with the sign of a
   residual, as after `patches_gradients`. */
void patches_tangent(const gas_surfaces *all);

#endif

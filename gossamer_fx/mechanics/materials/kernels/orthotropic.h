/* Relaxed energy of an orthotropic film, and its average along straight paths of strain: the
   functions that Python uses.  The C compiler reads this file, and so does cffi, without the
   preprocessor's lines (forms/c_source.py). */
#ifndef GOSSAMER_ORTHOTROPIC_H
#define GOSSAMER_ORTHOTROPIC_H

#include <stdint.h>

/* What a function computes at each point: the stress averaged along the path from e0 to e1 and its
   derivative by e1; the stress at e1 and its derivative; the energy density at e0. */
enum orthotropic_quantity { PATH_AVERAGE, END_POINT, DENSITY };

/* The address of a function with the signature that FFCx gives to expressions:

       values     (p, 12) stress (S11, S22, S12) and derivative, row by row; of DENSITY (p)
       arguments  e0 (p, 3), e1 (p, 3), law (p, 7)
       constants  p, the number of points

   Strains are (E11, E22, 2 E12).  The seven numbers of a law are cosine and sine of the angle of
   the first axis in the frame of the film, the stiffnesses A11, A12, A22, A66 [N/m], and the
   residual stiffness. */
uintptr_t orthotropic_function(int quantity);

#endif

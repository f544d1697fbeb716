/* Iterates that have passed through something: how they are found, and pushed back.

   Newton's iteration may try points beyond a contact, where the energy is not defined.  There the
   energy goes on as a parabola of the signed distance, steeper than the contact itself, so that the
   next iterates come back. */
#ifndef GOSSAMER_PASS_THROUGH_H
#define GOSSAMER_PASS_THROUGH_H

#include "stencil.h"

/* Force (12) and tangent (144, or NULL) of a pair. */
typedef struct {
    double *force;
    double *tangent;
} pair_output;

/* Signed distances [m] on the two sides of what a pair shall not pass. */
typedef struct {
    double at_start;
    double activation; /* where contact begins */
    int has_passed;    /* whether the sign has changed */
} signed_distances;

/* Whether the four points of a triangle pair or an edge pair pass through each other on straight
   lines. */
int has_passed_through(const pair_frame *frame, const pair_vectors *start, const pair_vectors *end);

/* Force and tangent of a parabola with the given stiffness [N/m] over the signed distance at the
   end, as the mean of the step. */
void push_back(const pair_frame *frame, const pair_vectors *end, const signed_distances *distances,
               double stiffness, const pair_output *output);

#endif

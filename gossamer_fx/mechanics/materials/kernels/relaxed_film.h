/* Film that bears no compression, in the axes of its stiffness.

   Strain e = (E11, E22, 2 E12), stress S = C e of taut film, F the inverse of C.  The relaxed
   energy

       W(e) = min over A >= 0 of (e + A):C:(e + A)/2 = max over S >= 0 of S:e - S:F:S/2

   is convex and has a continuous stress:

       taut      S = C e                      where C e >= 0 (as a matrix)
       slack     S = 0                        where e <= 0 (as a matrix)
       wrinkled  S = e_tt/F_tt (t x t)        elsewhere, t the direction that maximises e_tt^2/F_tt
       where e_tt > 0

   Directions are written as t = m + tau n, in a basis of a unit vector m and n across it.  The
   length of t drops out of the stress.  Then e_tt is a quadratic polynomial of tau, F_tt a quartic
   one, and the maximum a root of the quartic

       P(tau) = 2 e_tt' F_tt - e_tt F_tt'

   which is linear in the strain. */
#ifndef GOSSAMER_RELAXED_FILM_H
#define GOSSAMER_RELAXED_FILM_H

enum film_state { SLACK, WRINKLED, TAUT };

typedef struct {
    double C11, C12, C22, C66;
    double F11, F12, F22, F66;
    double margin; /* stress below which compression is round-off, and the film is taut */
} film_stiffness;

/* A unit vector. */
typedef struct {
    double cosine, sine;
} direction;

/* The compliance F_tt along t = m + tau n, as a polynomial of tau. */
typedef struct {
    direction m;
    double F[5];
} direction_basis;

/* Stress and its derivative by the strain, or averages of them.  The derivative is symmetric: D11,
   D12, D13, D22, D23, D33. */
typedef struct {
    double S[3];
    double D[6];
} film_response;

/* An average along a path of strain. */
typedef struct {
    film_response response;
    double missing; /* energy that the average stress misses */
    /* energies of which `missing` is the difference; zero if the average is exact */
    double energy;
    double end_stress[3]; /* stress at the end of the path */
} averaged_film;

film_stiffness film_stiffness_of(double C11, double C12, double C22, double C66);

/* The stress C e of taut film. */
void taut_stress(const film_stiffness *C, const double *e, double *S);

/* Add `weight` C to a symmetric derivative (6). */
void add_stiffness(const film_stiffness *C, double weight, double *D);

/* ---- wrinkled film ---- */

direction_basis basis_along(const film_stiffness *C, direction m);

/* e_tt as a polynomial of tau: a (3). */
void strain_polynomial(const direction_basis *basis, const double *e, double *a);

/* P of a strain, whose polynomial is a (3): P (5). */
void slope_polynomial(const direction_basis *basis, const double *a, double *P);

direction direction_of_largest_strain(const double *e);

/* The direction of the tension of wrinkled film. */
direction tension_direction(const film_stiffness *C, const double *e);

/* The same, found faster where it is near a known direction. */
direction tension_direction_near(const film_stiffness *C, const double *e, direction near);

/* Energy of wrinkled film with the tension in the direction t. */
double wrinkled_density(const film_stiffness *C, const double *e, direction t);

/* The stress of it, S (3). */
void wrinkled_stress(const film_stiffness *C, const double *e, direction t, double *S);

/* Add stress and derivative of wrinkled film, times weights, in the basis; a (3) is the polynomial
   of its strain. */
void add_wrinkled(const direction_basis *basis, const double *a, double tau, double weight,
                  double derivative_weight,
                  film_response *sum);

/* Add a response in a basis to one in the axes of the film. */
void add_from_basis(direction m, const film_response *in_basis, film_response *sum);

/* ---- film in any state ---- */

/* W at e. */
double relaxed_density(const film_stiffness *C, const double *e);

/* Stress and derivative at e. */
void relaxed_response(const film_stiffness *C, const double *e, film_response *response);

/* Stress averaged along the path from e0 to e1, and its derivative by e1. */
void averaged_response(const film_stiffness *C, const double *e0, const double *e1,
                       averaged_film *average);

#endif

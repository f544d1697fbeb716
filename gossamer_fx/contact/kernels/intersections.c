/* Edges that pierce triangles, as far as double precision tells: see piercing.py. */

enum { NO, YES, UNSURE };

static double product(const double *u, const double *v, const double *w, int i, int j, int k, double *size)
{
    const double a = v[j] * w[k], b = v[k] * w[j];
    *size += fabs(u[i]) * (fabs(a) + fabs(b));
    return u[i] * (a - b);
}

/* Sign of the volume (b - a) × (c - a) · (d - a); UNSURE where round-off may hide it.  The volume of rounded differences
   is off by less than 8 ε of the sum of its terms' sizes: Shewchuk, "Adaptive precision floating-point arithmetic"
   (1997), section 4.2. */
static int side(const double *a, const double *b, const double *c, const double *d)
{
    double u[3], v[3], w[3], size = 0;
    for (int k = 0; k < 3; ++k) u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = d[k] - a[k];
    double volume = 0;
    for (int k = 0; k < 3; ++k) volume += product(u, v, w, k, (k + 1) % 3, (k + 2) % 3, &size);
    if (size == 0) return 0;
    if (fabs(volume) <= 8 * DBL_EPSILON * size) return UNSURE;
    return volume > 0 ? 1 : -1;
}

static int pierces(const double *p, const double *q, const double *a, const double *b, const double *c)
{
    const int below = side(a, b, c, p), above = side(a, b, c, q);
    int found = below == UNSURE || above == UNSURE ? UNSURE : YES;
    if (found == YES && below * above >= 0) return NO;
    const double *corners[4] = {a, b, c, a};
    int turn = UNSURE;
    for (int k = 0; k < 3; ++k) {
        const int one = side(p, q, corners[k], corners[k + 1]);
        if (one == UNSURE) found = UNSURE;
        else if (one == 0 || (turn != UNSURE && one != turn)) return NO;
        else turn = one;
    }
    return found;
}

/* Whether edges (., 2) pierce triangles (., 3), for the pairs (n, 2) of them. */
void pierced(int n, const int32_t *pairs, const int32_t *edges, const int32_t *triangles, const double *x,
             uint8_t *found)
{
    for (int i = 0; i < n; ++i) {
        const int32_t *e = edges + 2 * (int64_t)pairs[2 * i], *t = triangles + 3 * (int64_t)pairs[2 * i + 1];
        found[i] = (uint8_t)pierces(x + 3 * (int64_t)e[0], x + 3 * (int64_t)e[1], x + 3 * (int64_t)t[0],
                                    x + 3 * (int64_t)t[1], x + 3 * (int64_t)t[2]);
    }
}

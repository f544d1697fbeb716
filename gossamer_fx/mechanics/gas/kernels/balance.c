/* Flows through isentropic openings with their derivatives, and the balance of all chambers.  See
   balance.h. */
#include "balance.h"

#include <math.h>
#include <string.h>

/* Pressure [Pa] and temperature [K] at one end of an opening. */
typedef struct {
    double p, T;
} gas_state;

/* Mass flow [kg/s] and enthalpy flow [W] through an opening from its first to its second end, and
   their derivatives by pressure and temperature at both ends. */
typedef struct {
    double mass, energy;
    double mass_by_p[2], mass_by_T[2];
    double energy_by_p[2], energy_by_T[2];
} gas_flow;

/* Psi of the subsonic flow at the ratio x of pressures, and its slope by x. */
static double subsonic(double x, double gamma, double *slope)
{
    const double factor = 2 * gamma / (gamma - 1);
    const double rising = pow(x, 2 / gamma);
    const double falling = pow(x, (gamma + 1) / gamma);
    const double value = sqrt(factor * (rising - falling));
    const double slope_of_terms = 2 / gamma * rising / x - (gamma + 1) / gamma * falling / x;
    *slope = factor * slope_of_terms / (2 * value);
    return value;
}

/* Psi of `isentropic_flow` at the ratio x of pressures, and its slope by x. */
static double psi(double x, double gamma, double laminar, double *slope)
{
    const double exponent = (gamma + 1) / (2 * (gamma - 1));
    if (x <= pow(2 / (gamma + 1), gamma / (gamma - 1))) {
        *slope = 0;
        return sqrt(gamma) * pow(2 / (gamma + 1), exponent);
    }
    if (1 - x >= laminar) return subsonic(x, gamma, slope);
    /* The odd cubic in 1 - x with the value and the slope of the subsonic flow at its limit. */
    double limit_slope;
    const double value = subsonic(1 - laminar, gamma, &limit_slope);
    const double cubic = (-limit_slope * laminar / value - 1) / 2;
    const double xi = (1 - x) / laminar;
    *slope = -value / laminar * (1 - cubic + 3 * cubic * xi * xi);
    return value * ((1 - cubic) * xi + cubic * xi * xi * xi);
}

/* State at one end of an opening, by (3) at chambers. */
static gas_state state_at(const gas_network *net, ptrdiff_t opening, int side, const double *y,
                          const double *V)
{
    const ptrdiff_t n = net->chamber_count;
    const int32_t k = net->ends[2 * opening + side];
    gas_state state;
    if (k < 0) {
        const double *given = net->boundary + 2 * (2 * opening + side);
        state.p = given[0];
        state.T = given[1];
        return state;
    }
    const double p0 = net->start[k];
    const double m0 = net->start[n + k];
    const double pV0 = net->start[3 * n + k];
    const double weight = net->start[4 * n + k];
    state.p = p0 + weight * (y[k] - p0);
    state.T = (pV0 + y[k] * V[k]) / ((m0 + y[n + k]) * net->R);
    return state;
}

/* The flow through an opening, for the states at its ends, which are set. */
static gas_flow flow_of(const gas_network *net, ptrdiff_t opening, const double *y, const double *V,
                        gas_state ends[2])
{
    gas_flow flow = {0};
    for (int side = 0; side < 2; ++side) ends[side] = state_at(net, opening, side, y, V);
    const int up = ends[0].p >= ends[1].p ? 0 : 1;
    const int down = 1 - up;
    const gas_state gas = ends[up];
    if (gas.p <= 0) return flow;
    const double x = ends[down].p / gas.p;
    double slope;
    const double value = psi(x, net->gamma, net->laminar[opening], &slope);
    const double sign = up == 0 ? 1 : -1;
    const double factor = sign * net->area[opening] / sqrt(net->R * gas.T);
    const double heat_capacity = net->gamma * net->R / (net->gamma - 1);
    flow.mass = factor * gas.p * value;
    flow.mass_by_p[up] = factor * (value - x * slope);
    flow.mass_by_p[down] = factor * slope;
    flow.mass_by_T[up] = -flow.mass / (2 * gas.T);
    flow.energy = heat_capacity * gas.T * flow.mass;
    for (int side = 0; side < 2; ++side) {
        flow.energy_by_p[side] = heat_capacity * gas.T * flow.mass_by_p[side];
        flow.energy_by_T[side] = heat_capacity * gas.T * flow.mass_by_T[side];
    }
    flow.energy_by_T[up] += heat_capacity * flow.mass;
    return flow;
}

/* The residual without the flows: `gas_residual` of a network with closed openings. */
static void closed_residual(const gas_network *net, const double *y, const double *V,
                            const double *W, double *residual)
{
    const ptrdiff_t n = net->chamber_count;
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double p0 = net->start[k];
        const double m0 = net->start[n + k];
        const double U0 = net->start[2 * n + k];
        const double end_energy = y[k] * V[k] / (net->gamma - 1);
        residual[k] = end_energy - U0 + (p0 + y[k]) / 2 * W[k];
        residual[n + k] = y[n + k] - m0;
    }
}

void gas_residual(const gas_network *net, const double *y, const double *V, const double *W,
                  double *residual)
{
    const ptrdiff_t n = net->chamber_count;
    const double h = *net->h;
    closed_residual(net, y, V, W, residual);
    for (ptrdiff_t i = 0; i < net->opening_count; ++i) {
        gas_state ends[2];
        const gas_flow flow = flow_of(net, i, y, V, ends);
        for (int side = 0; side < 2; ++side) {
            const int32_t k = net->ends[2 * i + side];
            const double gained = side == 0 ? -h : h;
            if (k < 0) continue;
            residual[k] -= gained * flow.energy;
            residual[n + k] -= gained * flow.mass;
        }
    }
}

/* Add the derivatives of the flow through one opening by the state of the chamber at one side. */
static void add_flow_slopes(const gas_network *net, ptrdiff_t opening, int side,
                            const gas_flow *flow, const gas_state *state, const double *y,
                            const double *V, double *by_y, double *by_V)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t size = 2 * n;
    const int32_t k = net->ends[2 * opening + side];
    const double weight = net->start[4 * n + k];
    const double total_mass = net->start[n + k] + y[n + k];
    /* Derivative of the temperature by p1 V, and by the mass m1. */
    const double T_by_pV = 1 / (total_mass * net->R);
    const double T_by_mass = -state->T * net->R * T_by_pV;
    const double p_slopes[2] = {flow->energy_by_p[side], flow->mass_by_p[side]};
    const double T_slopes[2] = {flow->energy_by_T[side], flow->mass_by_T[side]};
    for (int end = 0; end < 2; ++end) {
        const int32_t target = net->ends[2 * opening + end];
        const double gained = end == 0 ? -*net->h : *net->h;
        if (target < 0) continue;
        for (int quantity = 0; quantity < 2; ++quantity) {
            const ptrdiff_t row = target + quantity * n;
            const double T_slope = T_slopes[quantity];
            const double by_p1 = p_slopes[quantity] * weight + T_slope * V[k] * T_by_pV;
            by_y[row * size + k] -= gained * by_p1;
            by_y[row * size + n + k] -= gained * T_slope * T_by_mass;
            by_V[row * n + k] -= gained * T_slope * y[k] * T_by_pV;
        }
    }
}

void gas_derivatives(const gas_network *net, const double *y, const double *V, const double *W,
                     double *by_y, double *by_V)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t size = 2 * n;
    memset(by_y, 0, (size_t)(size * size) * sizeof *by_y);
    memset(by_V, 0, (size_t)(size * n) * sizeof *by_V);
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double heat_factor = 1 / (net->gamma - 1);
        by_y[k * size + k] = V[k] * heat_factor + W[k] / 2;
        by_y[(n + k) * size + n + k] = 1;
        by_V[k * n + k] = y[k] * heat_factor;
    }
    for (ptrdiff_t i = 0; i < net->opening_count; ++i) {
        gas_state ends[2];
        const gas_flow flow = flow_of(net, i, y, V, ends);
        for (int side = 0; side < 2; ++side)
            if (net->ends[2 * i + side] >= 0)
                add_flow_slopes(net, i, side, &flow, &ends[side], y, V, by_y, by_V);
    }
}

/* Whether all values are at most `bound` in size; not if one is NaN. */
static int all_within(const double *values, ptrdiff_t count, double bound)
{
    for (ptrdiff_t i = 0; i < count; ++i)
        if (!(fabs(values[i]) <= bound)) return 0;
    return 1;
}

/* Replace b (size) by the solution of A x = b, and A by its factors: elimination with partial
   pivoting.  Returns whether A has an inverse. */
static int solve_linear(double *A, double *b, ptrdiff_t size)
{
    for (ptrdiff_t column = 0; column < size; ++column) {
        ptrdiff_t pivot = column;
        for (ptrdiff_t row = column + 1; row < size; ++row)
            if (fabs(A[row * size + column]) > fabs(A[pivot * size + column])) pivot = row;
        if (A[pivot * size + column] == 0) return 0;
        if (pivot != column) {
            for (ptrdiff_t j = 0; j < size; ++j) {
                const double upper = A[column * size + j];
                A[column * size + j] = A[pivot * size + j];
                A[pivot * size + j] = upper;
            }
            const double upper = b[column];
            b[column] = b[pivot];
            b[pivot] = upper;
        }
        for (ptrdiff_t row = column + 1; row < size; ++row) {
            const double factor = A[row * size + column] / A[column * size + column];
            if (factor == 0) continue;
            for (ptrdiff_t j = column + 1; j < size; ++j)
                A[row * size + j] -= factor * A[column * size + j];
            b[row] -= factor * b[column];
        }
    }
    for (ptrdiff_t row = size - 1; row >= 0; --row) {
        for (ptrdiff_t j = row + 1; j < size; ++j) b[row] -= A[row * size + j] * b[j];
        b[row] /= A[row * size + row];
    }
    return 1;
}

/* Set error (2 n) to the residual over the scale; returns its square. */
static double scaled_residual(const gas_network *net, const double *y, const double *V,
                              const double *W, const double *scale, double *error)
{
    double square = 0;
    gas_residual(net, y, V, W, error);
    for (ptrdiff_t i = 0; i < 2 * net->chamber_count; ++i) {
        error[i] /= scale[i];
        square += error[i] * error[i];
    }
    return square;
}

void gas_scales(const gas_network *net, const double *y, const double *V, const double *magnitude,
                double *scale)
{
    const ptrdiff_t n = net->chamber_count;
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double m0 = net->start[n + k];
        const double U0 = net->start[2 * n + k];
        const double flows = 1 + net->round_off * net->start[5 * n + k];
        const double volume = fabs(V[k]) * flows + net->round_off * magnitude[k];
        scale[k] = fabs(y[k]) * volume / (net->gamma - 1) + U0;
        scale[n + k] = fabs(y[n + k]) * flows + m0;
    }
}

int gas_solve(const gas_network *net, double *y, const double *V, const double *W,
              const double *magnitude)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t size = 2 * n;
    double *scale = net->work;
    double *error = scale + size;
    double *trial = error + size;
    double *update = trial + size;
    double *closed = update + size;
    double *matrix = closed + size;
    double *by_V = matrix + size * size;
    /* What flows in the step is the difference of the residuals with open and closed openings. */
    gas_residual(net, y, V, W, error);
    closed_residual(net, y, V, W, closed);
    gas_scales(net, y, V, magnitude, scale);
    for (ptrdiff_t i = 0; i < size; ++i) scale[i] += fabs(error[i] - closed[i]);
    double square = scaled_residual(net, y, V, W, scale, error);
    for (ptrdiff_t iteration = 0; iteration < net->max_iterations; ++iteration) {
        if (all_within(error, size, net->tolerance)) return 1;
        gas_derivatives(net, y, V, W, matrix, by_V);
        for (ptrdiff_t row = 0; row < size; ++row) {
            for (ptrdiff_t j = 0; j < size; ++j) matrix[row * size + j] /= scale[row];
            update[row] = error[row];
        }
        if (!solve_linear(matrix, update, size)) return 0;
        const double square_before = square;
        double length = 1;
        for (ptrdiff_t halving = 0; halving < net->max_halvings; ++halving, length /= 2) {
            for (ptrdiff_t i = 0; i < size; ++i)
                trial[i] = fmax(y[i] - length * update[i], net->remaining * y[i]);
            square = scaled_residual(net, trial, V, W, scale, error);
            if (square < square_before) break;
        }
        /* No trial is better: y is the solution to round-off, or the volumes are far off, and from
           nearly the same y the iteration would fail again. */
        if (!(square < square_before))
            return square_before <= net->acceptable * net->acceptable;
        memcpy(y, trial, (size_t)size * sizeof *y);
    }
    return all_within(error, size, net->acceptable);
}

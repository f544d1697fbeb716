/* The balance of all chambers of a network, its derivatives and its solution, with flows, heats and
   properties of gases by compiled laws.  See network.h. */
#include "network.h"

#include <math.h>
#include <string.h>

/* Processes of chambers, see `static_processes` in gas/balance.py */
enum { IN_TIME, ADIABATIC, ISOTHERMAL, HELD };

/* Properties of a state: p, T, R, gamma, then mass fractions. */
enum { PRESSURE, TEMPERATURE, GAS_CONSTANT, HEAT_RATIO, FRACTIONS };

/* The state of a gas at which flows are taken.  Its variables are those of a chamber, p1, V1, m1,
   then p0, V0, m0 and theta if all derivatives are wanted, or p and T of a boundary. */
typedef struct {
    ptrdiff_t species_count;
    const int32_t *species;
    double *values;   /* (4 + species) */
    double *enthalpy; /* (species) [J/kg] */
    double *by_T;     /* (species) their slopes by the temperature */
    ptrdiff_t variable_count;
    int32_t *columns; /* (variables) */
    double *slopes;   /* (variables, 4 + species) */
} gas_state;

static ptrdiff_t state_size(const gas_network *net)
{
    const ptrdiff_t g = net->species_count;
    return 4 + 3 * g + (2 * g + 5) * (4 + g);
}

/* Where groups of columns of derivatives begin */
typedef struct {
    ptrdiff_t x1, V1, p0, m0, V0, theta, walls, boundary, area, wall_state, W, x0, numbers, all;
} gas_columns;

static gas_columns columns_of(const gas_network *net)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t s = net->mass_count;
    gas_columns at;
    at.x1 = n + s;
    at.V1 = at.x1 + net->variable_count;
    at.p0 = at.V1 + n;
    at.m0 = at.p0 + n;
    at.V0 = at.m0 + s;
    at.theta = at.V0 + n;
    at.walls = at.theta + n;
    at.boundary = at.walls + net->wall_count;
    at.area = at.boundary + 2 * net->boundary_count;
    at.wall_state = at.area + net->opening_count;
    at.W = at.wall_state + 2 * net->wall_count;
    at.x0 = at.W + n;
    at.numbers = at.x0 + net->variable_count;
    at.all = at.numbers + net->number_count;
    return at;
}

ptrdiff_t gas_column_count(const gas_network *net) { return columns_of(net).all; }

/* Length of the outputs of a law, their derivatives, and fractions of what flows with their slopes;
   `set_rest_rows` needs two numbers for each species. */
static ptrdiff_t law_length(const gas_network *net)
{
    return net->max_outputs * (1 + net->max_by) + 2 * net->species_count;
}

/* Number of unknowns and equations */
static ptrdiff_t size_of(const gas_network *net) { return columns_of(net).V1; }

ptrdiff_t gas_work_length(const gas_network *net)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t s = net->mass_count;
    const ptrdiff_t size = size_of(net);
    const ptrdiff_t states = (n + net->boundary_count) * state_size(net);
    const ptrdiff_t solution = 7 * size + size * size + size * (size + n);
    return states + solution + law_length(net) + 2 * n + 2 * s + net->opening_count + 2;
}

static gas_state state_in(const gas_network *net, ptrdiff_t k)
{
    const ptrdiff_t g = net->species_count;
    gas_state state;
    state.species_count = net->state_first[k + 1] - net->state_first[k];
    state.species = net->state_species + net->state_first[k];
    state.values = net->work + k * state_size(net);
    state.enthalpy = state.values + 4 + g;
    state.by_T = state.enthalpy + g;
    state.slopes = state.by_T + g;
    state.columns = net->columns + k * (4 * g + 8);
    state.variable_count = 0;
    if (k >= net->chamber_count) state.variable_count = 2;
    return state;
}

/* Memory behind that of the states */
static double *scratch(const gas_network *net)
{
    return net->work + (net->chamber_count + net->boundary_count) * state_size(net);
}

/* Energy u, c_v, and the slope of c_v of a species at a temperature. */
static void heat_of(const gas_network *net, int32_t species, double T, double *u, double *cv,
                    double *cv_by_T)
{
    double f[2];
    double df[2];
    double *x = net->heat_inputs + net->heat_first[species];
    x[0] = T;
    net->heat[species](x, f, cv_by_T ? df : NULL, NULL);
    *u = f[0];
    *cv = f[1];
    if (cv_by_T) *cv_by_T = df[1];
}

/* Set R, gamma and enthalpies of a state from its temperature and fractions, and those of their
   slopes that follow from the slopes of both. */
static void set_properties(const gas_network *net, gas_state *state)
{
    const ptrdiff_t count = state->species_count;
    const ptrdiff_t width = FRACTIONS + count;
    const double T = state->values[TEMPERATURE];
    const double *Y = state->values + FRACTIONS;
    double R = 0;
    double cv = 0;
    double cv_by_T = 0;
    for (ptrdiff_t j = 0; j < count; ++j) {
        double u;
        double own;
        double slope;
        heat_of(net, state->species[j], T, &u, &own, &slope);
        const double own_R = net->R[state->species[j]];
        state->enthalpy[j] = u + own_R * T;
        state->by_T[j] = own + own_R;
        R += Y[j] * own_R;
        cv += Y[j] * own;
        cv_by_T += Y[j] * slope;
    }
    state->values[GAS_CONSTANT] = R;
    state->values[HEAT_RATIO] = 1 + R / cv;
    for (ptrdiff_t i = 0; i < state->variable_count; ++i) {
        double *slope = state->slopes + i * width;
        double R_slope = 0;
        double cv_slope = cv_by_T * slope[TEMPERATURE];
        for (ptrdiff_t j = 0; j < count; ++j) {
            const double own_R = net->R[state->species[j]];
            R_slope += slope[FRACTIONS + j] * own_R;
            cv_slope += slope[FRACTIONS + j] * (state->by_T[j] - own_R);
        }
        slope[GAS_CONSTANT] = R_slope;
        slope[HEAT_RATIO] = R_slope / cv - R / (cv * cv) * cv_slope;
    }
}

/* Enter the variables of a chamber into its state: p, V and the masses of one end of the step, with
   the share of that end in the pressure and in the masses that are mixed. */
static ptrdiff_t add_end(const gas_network *net, ptrdiff_t k, gas_state *state, ptrdiff_t i,
                         double share, double p, double V, double mass_times_R, double mixed,
                         const ptrdiff_t at[3])
{
    const ptrdiff_t count = state->species_count;
    const ptrdiff_t width = FRACTIONS + count;
    double *slope = state->slopes + i * width;
    memset(slope, 0, (size_t)((2 + count) * width) * sizeof *slope);
    state->columns[i] = (int32_t)(at[0] + k);
    slope[PRESSURE] = share;
    slope[TEMPERATURE] = V / mass_times_R;
    slope += width;
    state->columns[i + 1] = (int32_t)(at[2] + k);
    slope[TEMPERATURE] = p / mass_times_R;
    for (ptrdiff_t j = 0; j < count; ++j) {
        slope += width;
        state->columns[i + 2 + j] = (int32_t)(at[1] + net->state_first[k] + j);
        slope[TEMPERATURE] =
            -state->values[TEMPERATURE] * net->R[state->species[j]] / mass_times_R;
        for (ptrdiff_t other = 0; other < count; ++other)
            slope[FRACTIONS + other] =
                share / mixed * ((other == j) - state->values[FRACTIONS + other]);
    }
    return i + 2 + count;
}

/* The state (3) of a chamber at which its flows are taken. */
static void set_chamber(const gas_network *net, ptrdiff_t k, const double *y, const double *V,
                        int order)
{
    const ptrdiff_t n = net->chamber_count;
    gas_state state = state_in(net, k);
    const gas_columns at = columns_of(net);
    const double *m0 = net->m0 + net->state_first[k];
    const double *m1 = y + n + net->state_first[k];
    const double theta = net->theta[k];
    double mass_times_R = 0;
    double mixed = 0;
    for (ptrdiff_t j = 0; j < state.species_count; ++j) {
        mass_times_R += (m0[j] + m1[j]) * net->R[state.species[j]];
        state.values[FRACTIONS + j] = m0[j] + theta * (m1[j] - m0[j]);
        mixed += state.values[FRACTIONS + j];
    }
    for (ptrdiff_t j = 0; j < state.species_count; ++j) state.values[FRACTIONS + j] /= mixed;
    state.values[PRESSURE] = net->p0[k] + theta * (y[k] - net->p0[k]);
    state.values[TEMPERATURE] = (net->pV0[k] + y[k] * V[k]) / mass_times_R;
    ptrdiff_t count = 0;
    if (order > 0) {
        const ptrdiff_t columns[3] = {0, n, at.V1};
        count = add_end(net, k, &state, count, theta, y[k], V[k], mass_times_R, mixed, columns);
    }
    if (order > 1) {
        const ptrdiff_t columns[3] = {at.p0, at.m0, at.V0};
        count = add_end(net, k, &state, count, 1 - theta, net->p0[k], net->V0[k], mass_times_R,
                        mixed, columns);
        double *slope = state.slopes + count * (FRACTIONS + state.species_count);
        memset(slope, 0, (size_t)(FRACTIONS + state.species_count) * sizeof *slope);
        state.columns[count] = (int32_t)(at.theta + k);
        slope[PRESSURE] = y[k] - net->p0[k];
        double sum = 0;
        for (ptrdiff_t j = 0; j < state.species_count; ++j) sum += m1[j] - m0[j];
        for (ptrdiff_t j = 0; j < state.species_count; ++j)
            slope[FRACTIONS + j] =
                (m1[j] - m0[j] - state.values[FRACTIONS + j] * sum) / mixed;
        ++count;
    }
    state.variable_count = count;
    set_properties(net, &state);
}

/* The state of a chamber at the start of the step. */
static void set_start(const gas_network *net, ptrdiff_t k, int order)
{
    gas_state state = state_in(net, k);
    const gas_columns at = columns_of(net);
    const double *m0 = net->m0 + net->state_first[k];
    double mass_times_R = 0;
    double mixed = 0;
    for (ptrdiff_t j = 0; j < state.species_count; ++j) {
        mass_times_R += m0[j] * net->R[state.species[j]];
        mixed += m0[j];
    }
    for (ptrdiff_t j = 0; j < state.species_count; ++j)
        state.values[FRACTIONS + j] = m0[j] / mixed;
    state.values[PRESSURE] = net->p0[k];
    state.values[TEMPERATURE] = net->pV0[k] / mass_times_R;
    if (order > 0) {
        const ptrdiff_t columns[3] = {at.p0, at.m0, at.V0};
        state.variable_count = add_end(net, k, &state, 0, 1.0, net->p0[k], net->V0[k],
                                       mass_times_R, mixed, columns);
    }
    set_properties(net, &state);
}

/* The state of a boundary. */
static void set_boundary(const gas_network *net, ptrdiff_t b, int order)
{
    gas_state state = state_in(net, net->chamber_count + b);
    const ptrdiff_t width = FRACTIONS + state.species_count;
    const double *fractions = net->fractions + (state.species - net->state_species);
    memcpy(state.values + FRACTIONS, fractions, (size_t)state.species_count * sizeof *fractions);
    state.values[PRESSURE] = net->boundary[2 * b];
    state.values[TEMPERATURE] = net->boundary[2 * b + 1];
    state.variable_count = order > 1 ? 2 : 0;
    if (order > 1) {
        memset(state.slopes, 0, (size_t)(2 * width) * sizeof *state.slopes);
        state.slopes[PRESSURE] = 1;
        state.slopes[width + TEMPERATURE] = 1;
        for (int32_t i = 0; i < 2; ++i)
            state.columns[i] = (int32_t)columns_of(net).boundary + 2 * (int32_t)b + i;
    }
    set_properties(net, &state);
}

/* Number of variables of a state with derivatives of an order. */
static gas_state ready_state(const gas_network *net, ptrdiff_t k, int order, int is_start)
{
    gas_state state = state_in(net, k);
    if (k >= net->chamber_count)
        state.variable_count = order > 1 ? 2 : 0;
    else if (is_start)
        state.variable_count = order > 0 ? 2 + state.species_count : 0;
    else if (order > 0)
        state.variable_count = order > 1 ? 2 * (2 + state.species_count) + 1
                                         : 2 + state.species_count;
    return state;
}

static void set_states(const gas_network *net, const double *y, const double *V, int order)
{
    for (ptrdiff_t k = 0; k < net->chamber_count; ++k) set_chamber(net, k, y, V, order);
    if (order > 1)
        for (ptrdiff_t b = 0; b < net->boundary_count; ++b) set_boundary(net, b, order);
}

static ptrdiff_t species_of(const gas_network *net, ptrdiff_t i)
{
    return net->carried_first[i + 1] - net->carried_first[i];
}

static ptrdiff_t variables_of(const gas_network *net, ptrdiff_t i)
{
    return net->variable_first[i + 1] - net->variable_first[i];
}

static ptrdiff_t numbers_of(const gas_network *net, ptrdiff_t i)
{
    return net->number_first[i + 1] - net->number_first[i];
}

/* Enter the states at both ends into the arguments of the law of an opening, and its state
   variables: those at the start of the step if y is null. */
static double *set_inputs(const gas_network *net, ptrdiff_t i, const gas_state ends[2],
                          const double *y)
{
    double *x = net->inputs + net->input_first[i];
    const ptrdiff_t count = species_of(net, i);
    const int32_t *local = net->local + 2 * net->carried_first[i];
    for (int side = 0; side < 2; ++side) {
        double *own = x + side * (FRACTIONS + count);
        memcpy(own, ends[side].values, FRACTIONS * sizeof *own);
        for (ptrdiff_t j = 0; j < count; ++j) {
            const int32_t number = local[2 * j + side];
            own[FRACTIONS + j] = number < 0 ? 0 : ends[side].values[FRACTIONS + number];
        }
    }
    x[2 * (FRACTIONS + count)] = net->area[i];
    for (int32_t v = net->variable_first[i]; v < net->variable_first[i + 1]; ++v) {
        double *own = x + net->variable_input[v];
        *own = net->x0[v];
        if (y) *own += *net->end_share * (y[columns_of(net).x1 + v] - net->x0[v]);
    }
    return x;
}

/* Sum of the slopes of a law by the properties of an end times those of the properties by one
   variable of its state. */
static double chain(const gas_network *net, ptrdiff_t i, int side, const gas_state *state,
                    ptrdiff_t variable, const double *by, ptrdiff_t by_count)
{
    const double *slope = state->slopes + variable * (FRACTIONS + state->species_count);
    const int32_t *local = net->local + 2 * net->carried_first[i];
    double sum = 0;
    for (ptrdiff_t j = 0; j < by_count && j < FRACTIONS; ++j) sum += by[j] * slope[j];
    for (ptrdiff_t j = FRACTIONS; j < by_count; ++j) {
        const int32_t number = local[2 * (j - FRACTIONS) + side];
        if (number >= 0) sum += by[j] * slope[FRACTIONS + number];
    }
    return sum;
}

/* Mass fraction of a species in what flows from a state, and that state's number of it. */
static double fraction_of(const gas_network *net, ptrdiff_t i, ptrdiff_t j, int up,
                          const gas_state *state, int32_t *number)
{
    const ptrdiff_t at = net->carried_first[i] + j;
    *number = net->local[2 * at + up];
    if (net->carried[at] >= 0) return net->carried[at];
    return *number < 0 ? 0 : state->values[FRACTIONS + *number];
}

/* Enthalpy [J/kg] of a species at the temperature of a state, and its slope. */
static double enthalpy_of(const gas_network *net, ptrdiff_t i, ptrdiff_t j, int32_t number,
                          const gas_state *state, double *by_T)
{
    if (number >= 0) {
        *by_T = state->by_T[number];
        return state->enthalpy[number];
    }
    const int32_t species = net->carried_species[net->carried_first[i] + j];
    double u;
    double cv;
    heat_of(net, species, state->values[TEMPERATURE], &u, &cv, NULL);
    *by_T = cv + net->R[species];
    return u + net->R[species] * state->values[TEMPERATURE];
}

/* Add the product of a column of slopes of an opening's flow with the signs at both ends to the
   rows of the chambers; `by_energy` is the slope of its energy flow, `by_mass` of its mass flow,
   which has the fractions Y with the slopes Y_slopes, null for none, at the mass flow `mass`. */
static void add_column(const gas_network *net, ptrdiff_t i, double by_energy, double by_mass,
                       double mass, const double *fractions, const double *fraction_slopes,
                       ptrdiff_t column, ptrdiff_t stride, double *by)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t count = species_of(net, i);
    const int32_t *local = net->local + 2 * net->carried_first[i];
    for (int side = 0; side < 2; ++side) {
        const int32_t k = net->ends[2 * i + side];
        const double gained = side == 0 ? -*net->h : *net->h;
        if (k >= n) continue;
        by[k * stride + column] -= gained * by_energy;
        for (ptrdiff_t j = 0; j < count; ++j) {
            const int32_t number = local[2 * j + side];
            if (number < 0) continue;
            double slope = fractions[j] * by_mass;
            if (fraction_slopes) slope += fraction_slopes[j] * mass;
            by[(n + net->state_first[k] + number) * stride + column] -= gained * slope;
        }
    }
}

/* The flow through an opening: the end `up` from which it comes, its mass flow [kg/s], its enthalpy
   [J/kg] with the slope by the temperature of that end, and the fractions of what it carries, with
   space for their slopes. */
typedef struct {
    int up;
    double mass;
    double enthalpy;
    double enthalpy_by_T;
    double *fractions;
    double *fraction_slopes;
} gas_flow;

/* Add a flow to the sums of `gas_rates`. */
static void add_to_sums(const gas_network *net, ptrdiff_t i, const gas_flow *flow, double *mass,
                        double *energy, double *supplied)
{
    const int32_t *local = net->local + 2 * net->carried_first[i];
    for (int side = 0; side < 2; ++side) {
        const int32_t k = net->ends[2 * i + side];
        const double sign = side == 0 ? -1 : 1;
        if (k >= net->chamber_count) {
            supplied[0] -= sign * flow->mass;
            supplied[1] -= sign * flow->enthalpy * flow->mass;
            continue;
        }
        energy[k] += sign * flow->enthalpy * flow->mass;
        for (ptrdiff_t j = 0; j < species_of(net, i); ++j) {
            const int32_t number = local[2 * j + side];
            if (number >= 0)
                mass[net->state_first[k] + number] += sign * flow->fractions[j] * flow->mass;
        }
    }
}

/* Slope of the enthalpy of a flow [J/kg] by one variable of the end from which it comes; sets those
   of its fractions. */
static double slopes_of_carried(const gas_network *net, ptrdiff_t i, const gas_flow *flow,
                                const gas_state *state, ptrdiff_t variable)
{
    const double *own = state->slopes + variable * (FRACTIONS + state->species_count);
    double slope = flow->enthalpy_by_T * own[TEMPERATURE];
    for (ptrdiff_t j = 0; j < species_of(net, i); ++j) {
        const ptrdiff_t at = net->carried_first[i] + j;
        const int32_t number = net->local[2 * at + flow->up];
        flow->fraction_slopes[j] = 0;
        if (net->carried[at] >= 0 || number < 0) continue;
        flow->fraction_slopes[j] = own[FRACTIONS + number];
        slope += own[FRACTIONS + number] * state->enthalpy[number];
    }
    return slope;
}

/* Add the derivatives of a flow by the variables of both ends to those of the residual; df are the
   slopes of its law, by `by_count` inputs. */
static void add_flow_slopes(const gas_network *net, ptrdiff_t i, const gas_flow *flow,
                            const gas_state *ends, const double *df, ptrdiff_t by_count, double *by,
                            ptrdiff_t stride)
{
    for (int side = 0; side < 2; ++side) {
        const gas_state *state = &ends[side];
        for (ptrdiff_t variable = 0; variable < state->variable_count; ++variable) {
            const double by_mass =
                chain(net, i, side, state, variable, df + side * by_count, by_count);
            double by_energy = flow->enthalpy * by_mass;
            const double *slopes = NULL;
            if (side == flow->up) {
                by_energy += slopes_of_carried(net, i, flow, state, variable) * flow->mass;
                slopes = flow->fraction_slopes;
            }
            add_column(net, i, by_energy, by_mass, flow->mass, flow->fractions, slopes,
                       state->columns[variable], stride, by);
        }
    }
}

/* Add the derivatives of a flow by the state variables of its opening to those of the residual, and
   for all derivatives by its area and numbers; df are the slopes of its law by these. */
static void add_own_slopes(const gas_network *net, ptrdiff_t i, int order, const gas_flow *flow,
                           const double *df, double *by, ptrdiff_t stride)
{
    const gas_columns at = columns_of(net);
    const double share = *net->end_share;
    if (order > 1) {
        add_column(net, i, flow->enthalpy * *df, *df, flow->mass, flow->fractions, NULL,
                   at.area + i, stride, by);
        ++df;
    }
    for (int32_t v = net->variable_first[i]; v < net->variable_first[i + 1]; ++v, ++df) {
        add_column(net, i, flow->enthalpy * share * *df, share * *df, flow->mass, flow->fractions,
                   NULL, at.x1 + v, stride, by);
        if (order > 1)
            add_column(net, i, flow->enthalpy * (1 - share) * *df, (1 - share) * *df, flow->mass,
                       flow->fractions, NULL, at.x0 + v, stride, by);
    }
    if (order < 2) return;
    for (int32_t number = net->number_first[i]; number < net->number_first[i + 1]; ++number, ++df)
        add_column(net, i, flow->enthalpy * *df, *df, flow->mass, flow->fractions, NULL,
                   at.numbers + number, stride, by);
}

/* Add the flow through an opening at y: to the sums of `gas_rates` if `openings` is given, and its
   derivatives to those of the residual if `by` is given. */
static void add_flow(const gas_network *net, ptrdiff_t i, int order, const double *y,
                     double *openings, double *mass, double *energy, double *supplied, double *by,
                     ptrdiff_t stride)
{
    const ptrdiff_t count = species_of(net, i);
    const ptrdiff_t width = FRACTIONS + count;
    gas_state ends[2];
    for (int side = 0; side < 2; ++side)
        ends[side] = ready_state(net, net->ends[2 * i + side], order, 0);
    double *f = scratch(net);
    double *df = f + net->max_outputs;
    double *fractions = df + net->max_outputs * net->max_by;
    const double *x = set_inputs(net, i, ends, y);
    const ptrdiff_t by_count = order > 1 ? width : net->by_count[i];
    if (order > 1)
        net->slopes[i](x, f, df, NULL);
    else
        net->flow[i](x, f, by ? df : NULL, NULL);
    gas_flow flow = {f[0] >= 0 ? 0 : 1, f[0], 0, 0, fractions, fractions + count};
    const gas_state *gas = &ends[flow.up];
    for (ptrdiff_t j = 0; j < count; ++j) {
        int32_t number;
        double slope;
        fractions[j] = fraction_of(net, i, j, flow.up, gas, &number);
        if (fractions[j] == 0 && number < 0) continue;
        flow.enthalpy += fractions[j] * enthalpy_of(net, i, j, number, gas, &slope);
        flow.enthalpy_by_T += fractions[j] * slope;
    }
    if (openings) {
        openings[i] = flow.mass;
        add_to_sums(net, i, &flow, mass, energy, supplied);
    }
    if (!by) return;
    add_flow_slopes(net, i, &flow, ends, df, by_count, by, stride);
    add_own_slopes(net, i, order, &flow, df + 2 * by_count, by, stride);
}

/* Of the state variables of an opening at y, where states are set with derivatives of an order: add
   their excess to the residual, its derivatives to `by`, and to `sizes` what it is compared to;
   null for none. */
static void add_variables(const gas_network *net, ptrdiff_t i, int order, const double *y,
                          double *residual, double *by, ptrdiff_t stride, double *sizes)
{
    const gas_columns at = columns_of(net);
    const double h = *net->h;
    const double share = *net->end_share;
    const ptrdiff_t variables = variables_of(net, i);
    const ptrdiff_t numbers = numbers_of(net, i);
    const int32_t first = net->variable_first[i];
    gas_state ends[2];
    for (int side = 0; side < 2; ++side)
        ends[side] = ready_state(net, net->ends[2 * i + side], order, 0);
    const double *x = set_inputs(net, i, ends, y);
    double *f = scratch(net);
    double *df = f + net->max_outputs;
    const ptrdiff_t by_count = order > 1 ? FRACTIONS + species_of(net, i) : net->by_count[i];
    const ptrdiff_t width = 2 * by_count + variables + (order > 1 ? 1 + numbers : 0);
    if (order > 1)
        net->slopes[i](x, f, df, NULL);
    else
        net->flow[i](x, f, by || sizes ? df : NULL, NULL);
    for (ptrdiff_t j = 0; j < variables; ++j) {
        const ptrdiff_t row = at.x1 + first + j;
        const double change = h * f[1 + j];
        const double *slopes = df + (1 + j) * width;
        const double *own = slopes + 2 * by_count + (order > 1);
        if (residual) residual[row] = y[row] - net->x0[first + j] - change;
        if (sizes) {
            /* A rate is a sum of terms that may cancel, each with its round-off. */
            double terms = 0;
            for (int side = 0; side < 2; ++side)
                terms += fabs(slopes[side * by_count + PRESSURE] * ends[side].values[PRESSURE]);
            for (ptrdiff_t v = 0; v < variables; ++v)
                terms += fabs(own[v] * x[net->variable_input[first + v]]);
            sizes[row] = fabs(y[row]) + fabs(net->x0[first + j]) + fabs(change) +
                         net->round_off * h * terms;
            /* It is zero only if all of the residual is. */
            if (sizes[row] == 0) sizes[row] = 1;
        }
        if (!by) continue;
        double *to = by + row * stride;
        to[row] += 1;
        for (int side = 0; side < 2; ++side)
            for (ptrdiff_t v = 0; v < ends[side].variable_count; ++v)
                to[ends[side].columns[v]] -=
                    h * chain(net, i, side, &ends[side], v, slopes + side * by_count, by_count);
        for (ptrdiff_t v = 0; v < variables; ++v) to[at.x1 + first + v] -= h * share * own[v];
        if (order < 2) continue;
        to[at.x0 + first + j] -= 1;
        for (ptrdiff_t v = 0; v < variables; ++v) to[at.x0 + first + v] -= h * (1 - share) * own[v];
        to[at.area + i] -= h * own[-1];
        for (ptrdiff_t v = 0; v < numbers; ++v)
            to[at.numbers + net->number_first[i] + v] -= h * own[variables + v];
    }
}

/* The same of all openings that have some. */
static void add_all_variables(const gas_network *net, int order, const double *y, double *residual,
                              double *by, ptrdiff_t stride, double *sizes)
{
    if (net->variable_count == 0) return;
    for (ptrdiff_t i = 0; i < net->opening_count; ++i)
        if (variables_of(net, i) > 0)
            add_variables(net, i, order, y, residual, by, stride, sizes);
}

/* Internal energy [J] of a chamber from p V [J] and masses, with its slopes by p V and by masses,
   and its temperature; null for none. */
static double energy_of(const gas_network *net, ptrdiff_t k, double pV, const double *m,
                        double *by_pV, double *by_m, double *temperature)
{
    const ptrdiff_t count = net->state_first[k + 1] - net->state_first[k];
    const int32_t *species = net->state_species + net->state_first[k];
    double mass_times_R = 0;
    for (ptrdiff_t j = 0; j < count; ++j) mass_times_R += m[j] * net->R[species[j]];
    const double T = pV / mass_times_R;
    double energy = 0;
    double capacity = 0;
    for (ptrdiff_t j = 0; j < count; ++j) {
        double u;
        double cv;
        heat_of(net, species[j], T, &u, &cv, NULL);
        energy += m[j] * u;
        capacity += m[j] * cv;
        if (by_m) by_m[j] = u;
    }
    const double factor = capacity / mass_times_R;
    if (by_pV) *by_pV = factor;
    if (by_m)
        for (ptrdiff_t j = 0; j < count; ++j) by_m[j] -= factor * T * net->R[species[j]];
    if (temperature) *temperature = T;
    return energy;
}

/* Internal energy [J] of masses m of a chamber at the temperature of the start. */
static double energy_at_start(const gas_network *net, ptrdiff_t k, const double *m, double *by_m)
{
    double energy = 0;
    for (int32_t row = net->state_first[k]; row < net->state_first[k + 1]; ++row) {
        double u;
        double cv;
        heat_of(net, net->state_species[row], net->T0[k], &u, &cv, NULL);
        energy += m[row - net->state_first[k]] * u;
        if (by_m) by_m[row - net->state_first[k]] = u;
    }
    return energy;
}

/* The temperature of a chamber at which a wall exchanges heat, and that at the end of the step. */
static double wall_temperature(const gas_network *net, ptrdiff_t i, const double *y,
                               const double *V, double *mass_times_R)
{
    const int32_t k = net->wall_chamber[i];
    const double weight = net->wall_theta[i];
    *mass_times_R = 0;
    for (int32_t row = net->state_first[k]; row < net->state_first[k + 1]; ++row)
        *mass_times_R += y[net->chamber_count + row] * net->R[net->state_species[row]];
    return (1 - weight) * net->T0[k] + weight * y[k] * V[k] / *mass_times_R;
}

/* Add the heat of a wall to sums, or its derivatives to those of the residual, as `add_flow`. */
static void add_heat(const gas_network *net, ptrdiff_t i, int order, const double *y,
                     const double *V, double *energy, double *supplied, double *by,
                     ptrdiff_t stride)
{
    const ptrdiff_t n = net->chamber_count;
    const int32_t k = net->wall_chamber[i];
    double mass_times_R;
    const double T = wall_temperature(net, i, y, V, &mass_times_R);
    const double x[3] = {T, net->wall_state[2 * i], net->wall_state[2 * i + 1]};
    double f[2];
    double df[6];
    net->heat_flow[i](x, f, by ? df : NULL, NULL);
    if (energy) {
        energy[k] += f[0];
        supplied[1] += f[0];
    }
    if (!by) return;
    const double end = y[k] * V[k] / mass_times_R;
    const double factor = *net->h * df[0] * net->wall_theta[i] / mass_times_R;
    double *row = by + k * stride;
    row[k] -= factor * V[k];
    row[columns_of(net).V1 + k] -= factor * y[k];
    for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass)
        row[n + mass] += factor * end * net->R[net->state_species[mass]];
    if (order < 2) return;
    const gas_columns at = columns_of(net);
    double start_mass_times_R = 0;
    for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass)
        start_mass_times_R += net->m0[mass] * net->R[net->state_species[mass]];
    const double start = *net->h * df[0] * (1 - net->wall_theta[i]) / start_mass_times_R;
    row[at.p0 + k] -= start * net->V0[k];
    row[at.V0 + k] -= start * net->p0[k];
    for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass)
        row[at.m0 + mass] += start * net->T0[k] * net->R[net->state_species[mass]];
    row[at.walls + i] -= *net->h * df[0] * (end - net->T0[k]);
    row[at.wall_state + 2 * i] -= *net->h * df[1];
    row[at.wall_state + 2 * i + 1] -= *net->h * df[2];
}

void gas_rates(const gas_network *net, const double *y, const double *V, double *openings,
               double *mass, double *energy, double *supplied)
{
    memset(mass, 0, (size_t)net->mass_count * sizeof *mass);
    memset(energy, 0, (size_t)net->chamber_count * sizeof *energy);
    supplied[0] = 0;
    supplied[1] = 0;
    set_states(net, y, V, 0);
    memset(openings, 0, (size_t)net->opening_count * sizeof *openings);
    /* Pressures that are held do not equalise. */
    for (ptrdiff_t i = 0; *net->process != HELD && i < net->opening_count; ++i)
        add_flow(net, i, 0, y, openings, mass, energy, supplied, NULL, 0);
    for (ptrdiff_t i = 0; i < net->wall_count; ++i)
        add_heat(net, i, 0, y, V, energy, supplied, NULL, 0);
}

/* V0/V of a chamber. */
static double expansion(const gas_network *net, ptrdiff_t k, const double *V)
{
    return net->V0[k] / fmax(V[k], net->smallest_volume * net->V0[k]);
}

void gas_work(const gas_network *net, const double *y, const double *V, const double *W,
              double *work)
{
    for (ptrdiff_t k = 0; k < net->chamber_count; ++k) {
        if (*net->process == ADIABATIC)
            work[k] = net->U0[k] * (1 - pow(expansion(net, k, V), net->exponent[k]));
        else
            work[k] = (net->p0[k] + y[k]) / 2 * W[k];
    }
}

/* Set the residual for the sums of flows, null for closed openings without walls. */
static void residual_of(const gas_network *net, const double *y, const double *V, const double *W,
                        const double *mass, const double *energy, double *residual)
{
    const ptrdiff_t n = net->chamber_count;
    const double h = *net->h;
    gas_work(net, y, V, W, residual);
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double *m = y + n + net->state_first[k];
        const double end = energy_of(net, k, y[k] * V[k], m, NULL, NULL, NULL);
        if (*net->process == HELD) {
            residual[k] = (y[k] - net->p0[k]) * V[k];
        } else if (*net->process == ISOTHERMAL) {
            residual[k] = end - energy_at_start(net, k, m, NULL);
        } else {
            residual[k] += end - net->U0[k];
            if (energy) residual[k] -= h * energy[k];
        }
        for (int32_t row = net->state_first[k]; row < net->state_first[k + 1]; ++row) {
            double held = net->m0[row];
            if (*net->process == HELD) held *= net->p0[k] * V[k] / net->pV0[k];
            residual[n + row] = y[n + row] - held;
            if (mass && *net->process != HELD) residual[n + row] -= h * mass[row];
        }
    }
}

/* Memory for the sums of flows, behind that of a law */
static double *sums_in(const gas_network *net)
{
    return scratch(net) + law_length(net);
}

void gas_residual(const gas_network *net, const double *y, const double *V, const double *W,
                  double *residual)
{
    double *mass = sums_in(net);
    double *energy = mass + net->mass_count;
    double *supplied = energy + net->chamber_count;
    double *openings = supplied + 2;
    gas_rates(net, y, V, openings, mass, energy, supplied);
    residual_of(net, y, V, W, mass, energy, residual);
    add_all_variables(net, 0, y, residual, NULL, 0, NULL);
}

/* Derivatives of the energy rows of an equilibrium's process, which take the place of the others. */
static void set_rest_rows(const gas_network *net, const double *y, const double *V,
                          ptrdiff_t stride, double *by)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t V1 = columns_of(net).V1;
    double *by_m = scratch(net);
    double *of_start = by_m + net->species_count;
    for (ptrdiff_t k = 0; k < n; ++k) {
        double *row = by + k * stride;
        memset(row, 0, (size_t)stride * sizeof *row);
        if (*net->process == HELD) {
            row[k] = V[k];
            row[V1 + k] = y[k] - net->p0[k];
            for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass)
                by[(n + mass) * stride + V1 + k] =
                    -net->m0[mass] * net->p0[k] / net->pV0[k];
            continue;
        }
        const double *m = y + n + net->state_first[k];
        double factor;
        energy_of(net, k, y[k] * V[k], m, &factor, by_m, NULL);
        energy_at_start(net, k, m, of_start);
        row[k] = V[k] * factor;
        row[V1 + k] = y[k] * factor;
        for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass)
            row[n + mass] =
                by_m[mass - net->state_first[k]] - of_start[mass - net->state_first[k]];
    }
}

void gas_derivatives(const gas_network *net, const double *y, const double *V, const double *W,
                     int32_t all, double *by)
{
    const ptrdiff_t n = net->chamber_count;
    const gas_columns at = columns_of(net);
    const ptrdiff_t stride = all ? at.all : at.V1 + n;
    const int order = all ? 2 : 1;
    double *by_m = scratch(net);
    memset(by, 0, (size_t)(at.V1 * stride) * sizeof *by);
    for (ptrdiff_t k = 0; k < n; ++k) {
        double *row = by + k * stride;
        const double *m = y + n + net->state_first[k];
        double factor;
        energy_of(net, k, y[k] * V[k], m, &factor, by_m, NULL);
        row[k] = V[k] * factor;
        row[at.V1 + k] = y[k] * factor;
        if (*net->process == IN_TIME)
            row[k] += W[k] / 2;
        else if (*net->process == ADIABATIC)
            row[at.V1 + k] += net->p0[k] * pow(expansion(net, k, V), 1 + net->exponent[k]);
        for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass) {
            row[n + mass] = by_m[mass - net->state_first[k]];
            by[(n + mass) * stride + n + mass] = 1;
        }
        if (!all) continue;
        energy_of(net, k, net->pV0[k], net->m0 + net->state_first[k], &factor, by_m, NULL);
        row[at.p0 + k] = W[k] / 2 - net->V0[k] * factor;
        row[at.V0 + k] = -net->p0[k] * factor;
        row[at.W + k] = (net->p0[k] + y[k]) / 2;
        for (int32_t mass = net->state_first[k]; mass < net->state_first[k + 1]; ++mass) {
            row[at.m0 + mass] = -by_m[mass - net->state_first[k]];
            by[(n + mass) * stride + at.m0 + mass] = -1;
        }
    }
    set_states(net, y, V, order);
    add_all_variables(net, order, y, NULL, by, stride, NULL);
    if (*net->process != HELD) {
        for (ptrdiff_t i = 0; i < net->opening_count; ++i)
            add_flow(net, i, order, y, NULL, NULL, NULL, NULL, by, stride);
        for (ptrdiff_t i = 0; i < net->wall_count; ++i)
            add_heat(net, i, order, y, V, NULL, NULL, by, stride);
    }
    if (*net->process == HELD || *net->process == ISOTHERMAL)
        set_rest_rows(net, y, V, stride, by);
}

/* ---- weights ----------------------------------------------------------------------------------- */

/* Sums over the openings of a chamber: zeta of (4), z of (5) and z of openings at rest, and the
   derivatives (2 n, stride) of the first two, null for none. */
typedef struct {
    double *relaxation, *equalisation, *at_rest;
    double *by;
    ptrdiff_t stride;
} gas_weights;

/* R and c_v of the carried gas at a temperature, with the slope of c_v by it; null for none. */
static void heat_of_carried(const gas_network *net, ptrdiff_t i, double T, double *R, double *cv,
                            double *cv_by_T)
{
    *R = 0;
    *cv = 0;
    if (cv_by_T) *cv_by_T = 0;
    for (ptrdiff_t j = 0; j < species_of(net, i); ++j) {
        const ptrdiff_t at = net->carried_first[i] + j;
        const int32_t species = net->carried_species[at];
        double u;
        double one;
        double slope;
        heat_of(net, species, T, &u, &one, cv_by_T ? &slope : NULL);
        *R += net->carried[at] * net->R[species];
        *cv += net->carried[at] * one;
        if (cv_by_T) *cv_by_T += net->carried[at] * slope;
    }
}

/* Where the state of an end is replaced: what flows is of the carried gas alone. */
static void carry_alone(const gas_network *net, ptrdiff_t i, const gas_state *state, double *own)
{
    double R;
    double cv;
    heat_of_carried(net, i, state->values[TEMPERATURE], &R, &cv, NULL);
    for (ptrdiff_t j = 0; j < species_of(net, i); ++j)
        own[FRACTIONS + j] = net->carried[net->carried_first[i] + j];
    own[GAS_CONSTANT] = R;
    own[HEAT_RATIO] = 1 + R / cv;
}

/* Slope of a law's output by one variable of an end, as `chain`; of a carried gas alone, R, gamma
   and fractions depend on the temperature at most. */
static double chain_at(const gas_network *net, ptrdiff_t i, int side, const gas_state *state,
                       ptrdiff_t variable, const double *by, double gamma_by_T)
{
    const ptrdiff_t width = FRACTIONS + species_of(net, i);
    if (net->carried[net->carried_first[i]] < 0)
        return chain(net, i, side, state, variable, by, width);
    const double *slope = state->slopes + variable * (FRACTIONS + state->species_count);
    return by[PRESSURE] * slope[PRESSURE] +
           (by[TEMPERATURE] + by[HEAT_RATIO] * gamma_by_T) * slope[TEMPERATURE];
}

/* Slope of gamma of the carried gas by the temperature. */
static double carried_ratio_slope(const gas_network *net, ptrdiff_t i, const gas_state *state)
{
    double R;
    double cv;
    double cv_by_T;
    heat_of_carried(net, i, state->values[TEMPERATURE], &R, &cv, &cv_by_T);
    return -R / (cv * cv) * cv_by_T;
}

/* An opening as a conductance between its ends, of which `up` is upstream: inputs x, outputs f and
   slopes df of its law, `by_count` of each output, the first by `width` properties of each end;
   h gamma R T upstream; and slopes of gamma of a carried gas by T. */
typedef struct {
    ptrdiff_t opening;
    ptrdiff_t width;
    ptrdiff_t by_count;
    int up;
    int is_carried;
    gas_state ends[2];
    double *x;
    double *f;
    double *df;
    double factor;
    double ratio_by_T[2];
} gas_conductor;

/* Slope of the logarithm of h gamma R T upstream by a variable of that end. */
static double log_slope_of_factor(const gas_conductor *c, ptrdiff_t v)
{
    const gas_state *state = &c->ends[c->up];
    const double *gas = c->x + c->up * c->width;
    const double *slope = state->slopes + v * (FRACTIONS + state->species_count);
    const double of_T = slope[TEMPERATURE] / gas[TEMPERATURE];
    if (c->is_carried)
        return of_T + c->ratio_by_T[c->up] * slope[TEMPERATURE] / gas[HEAT_RATIO];
    return of_T + slope[GAS_CONSTANT] / gas[GAS_CONSTANT] + slope[HEAT_RATIO] / gas[HEAT_RATIO];
}

/* Add `factor` times the slopes of the law, or of its slopes, by what belongs to the opening itself:
   its area, state variables at the start and numbers. */
static void add_own_weight_slopes(const gas_network *net, const gas_conductor *c, double factor,
                                  const double *slopes, double *row)
{
    const ptrdiff_t i = c->opening;
    const gas_columns at = columns_of(net);
    const double *own = slopes + 2 * c->width;
    row[at.area + i] += factor * *own++;
    for (int32_t v = net->variable_first[i]; v < net->variable_first[i + 1]; ++v)
        row[at.x0 + v] += factor * *own++;
    for (int32_t number = net->number_first[i]; number < net->number_first[i + 1]; ++number)
        row[at.numbers + number] += factor * *own++;
}

/* Add the slopes of the conductance to the pressure of one chamber, k at the end `side`: those of
   the relaxation, the slope of the flow by p times that of the pressure by what flowed. */
static void add_relaxation_slopes(const gas_network *net, const gas_conductor *c, int side,
                                  int32_t k, const double by_p[2], const gas_weights *sums)
{
    const double stiffness = c->factor / net->V0[k];
    const double sign = side == 0 ? -1 : 1;
    double *row = sums->by + k * sums->stride;
    const ptrdiff_t variables = variables_of(net, c->opening);
    const double *second = c->df + (1 + variables + side) * c->by_count;
    for (int end = 0; end < 2; ++end)
        for (ptrdiff_t v = 0; v < c->ends[end].variable_count; ++v)
            row[c->ends[end].columns[v]] -=
                stiffness * sign *
                chain_at(net, c->opening, end, &c->ends[end], v, second + end * c->width,
                         c->ratio_by_T[end]);
    add_own_weight_slopes(net, c, -stiffness * sign, second, row);
    for (ptrdiff_t v = 0; v < c->ends[c->up].variable_count; ++v)
        row[c->ends[c->up].columns[v]] -=
            stiffness * sign * by_p[side] * log_slope_of_factor(c, v);
    row[columns_of(net).V0 + k] += stiffness * sign * by_p[side] / net->V0[k];
}

/* Add the slopes of the conductance flow/(p_up - low) at the chamber k; `is_almost`: low follows
   p_up, as the pressures are almost equal. */
static void add_equalisation_slopes(const gas_network *net, gas_conductor *c, int32_t k, double low,
                                    int is_almost, const gas_weights *sums)
{
    const int up = c->up;
    const int down = 1 - up;
    const gas_state *ends = c->ends;
    const double difference = c->x[up * c->width + PRESSURE] - low;
    const double sign = up == 0 ? 1 : -1;
    const double scale = c->factor / net->V0[k] * sign / difference;
    const double *by_down = c->df + down * c->width;
    double *row = sums->by + (net->chamber_count + k) * sums->stride;
    for (ptrdiff_t v = 0; v < ends[up].variable_count; ++v) {
        const double *slope = ends[up].slopes + v * (FRACTIONS + ends[up].species_count);
        double sum = chain_at(net, c->opening, up, &ends[up], v, c->df + up * c->width,
                              c->ratio_by_T[up]);
        sum += by_down[TEMPERATURE] * slope[TEMPERATURE];
        double gap = slope[PRESSURE];
        if (is_almost) {
            sum += by_down[PRESSURE] * slope[PRESSURE] * (1 - net->rest_difference);
            gap *= net->rest_difference;
        }
        sum -= c->f[0] / difference * gap;
        row[ends[up].columns[v]] += scale * (sum + c->f[0] * log_slope_of_factor(c, v));
    }
    /* Of the end downstream only its pressure counts, and the kind of its gas: it has the
       temperature upstream. */
    double *by_end = c->df + down * c->width;
    double own[FRACTIONS] = {0};
    memcpy(own, by_end, sizeof own);
    by_end[PRESSURE] = is_almost ? 0 : own[PRESSURE] + c->f[0] / difference;
    by_end[TEMPERATURE] = 0;
    for (ptrdiff_t v = 0; v < ends[down].variable_count; ++v)
        row[ends[down].columns[v]] +=
            scale * chain_at(net, c->opening, down, &ends[down], v, by_end, c->ratio_by_T[down]);
    memcpy(by_end, own, sizeof own);
    add_own_weight_slopes(net, c, scale, c->df, row);
    row[columns_of(net).V0 + k] -= scale * c->f[0] / net->V0[k];
}

/* Evaluate the law of the opening, with slopes by all its inputs if `by`, else those that `df`
   takes. */
static void evaluate(const gas_network *net, const gas_conductor *c, int by, double *df)
{
    if (by)
        net->slopes[c->opening](c->x, c->f, c->df, NULL);
    else
        net->flow[c->opening](c->x, c->f, df, NULL);
}

/* Make an opening ready as a conductance; returns whether it is one: two vacuums exchange
   nothing. */
static int set_conductor(const gas_network *net, ptrdiff_t i, int by, gas_conductor *c)
{
    c->opening = i;
    c->width = FRACTIONS + species_of(net, i);
    c->by_count = 2 * c->width + 1 + variables_of(net, i) + numbers_of(net, i);
    c->is_carried = net->carried[net->carried_first[i]] >= 0;
    for (int side = 0; side < 2; ++side)
        c->ends[side] = ready_state(net, net->ends[2 * i + side], by ? 2 : 0, 1);
    c->x = set_inputs(net, i, c->ends, NULL);
    if (c->is_carried)
        for (int side = 0; side < 2; ++side)
            carry_alone(net, i, &c->ends[side], c->x + side * c->width);
    const double *first = c->x;
    const double *second = c->x + c->width;
    /* Of equal pressures the hotter end counts as upstream. */
    c->up = first[PRESSURE] >= second[PRESSURE] ? 0 : 1;
    if (first[PRESSURE] == second[PRESSURE])
        c->up = first[TEMPERATURE] >= second[TEMPERATURE] ? 0 : 1;
    const double *gas = c->x + c->up * c->width;
    c->f = scratch(net);
    c->df = c->f + net->max_outputs;
    c->factor = *net->h * gas[HEAT_RATIO] * gas[GAS_CONSTANT] * gas[TEMPERATURE];
    for (int side = 0; side < 2; ++side)
        c->ratio_by_T[side] =
            by && c->is_carried ? carried_ratio_slope(net, i, &c->ends[side]) : 0;
    return gas[PRESSURE] > 0;
}

/* Add the conductances of an opening to the sums of its chambers. */
static void add_conductance(const gas_network *net, ptrdiff_t i, const gas_weights *sums)
{
    const int by = sums->by != NULL;
    gas_conductor c;
    if (!set_conductor(net, i, by, &c)) return;
    const ptrdiff_t by_count = by ? c.width : net->by_count[i];
    evaluate(net, &c, by, c.df);
    const double *slopes = c.f + 1 + variables_of(net, i);
    const double by_p[2] = {by ? slopes[0] : c.df[PRESSURE],
                            by ? slopes[1] : c.df[by_count + PRESSURE]};
    for (int side = 0; side < 2; ++side) {
        const int32_t k = net->ends[2 * i + side];
        if (k >= net->chamber_count) continue;
        sums->relaxation[k] -= c.factor / net->V0[k] * (side == 0 ? -1 : 1) * by_p[side];
        if (by) add_relaxation_slopes(net, &c, side, k, by_p, sums);
    }
    /* A driven flow does not fall to zero with the difference of pressures. */
    if (net->driven[i]) return;
    const double *gas = c.x + c.up * c.width;
    double *below = c.x + (1 - c.up) * c.width;
    const double p_down = below[PRESSURE];
    /* z of (5) has the difference in its denominator: it is taken at no smaller one than this. */
    const double almost_equal = gas[PRESSURE] * (1 - net->rest_difference);
    below[TEMPERATURE] = gas[TEMPERATURE];
    for (int rest = 0; rest < 2; ++rest) {
        const int is_almost = rest || almost_equal < p_down;
        const double low = is_almost ? almost_equal : p_down;
        below[PRESSURE] = low;
        evaluate(net, &c, by, NULL);
        const double conductance = (c.up == 0 ? 1 : -1) * c.f[0] / (gas[PRESSURE] - low);
        double *sum = rest ? sums->at_rest : sums->equalisation;
        for (int side = 0; side < 2; ++side) {
            const int32_t k = net->ends[2 * i + side];
            if (k >= net->chamber_count) continue;
            sum[k] += c.factor / net->V0[k] * conductance;
            if (by && !rest) add_equalisation_slopes(net, &c, k, low, is_almost, sums);
        }
    }
}

/* Set the weight of a wall, and its derivatives if `by` is given. */
static void choose_wall_weight(const gas_network *net, ptrdiff_t i, double *by)
{
    const gas_columns at = columns_of(net);
    const int32_t k = net->wall_chamber[i];
    const double T = net->T0[k];
    const double wall[3] = {T, net->wall_state[2 * i], net->wall_state[2 * i + 1]};
    double f[2];
    double df[6];
    net->heat_flow[i](wall, f, by ? df : NULL, NULL);
    /* Relaxations of the temperature in a step; m c_v = c_v/R p V/T */
    const double capacity = net->pV0[k] / (net->exponent[k] * T);
    const double rate = *net->h * f[1] / capacity;
    const double x[2] = {rate, 0};
    double weight;
    double slopes[2];
    net->weight(x, &weight, slopes, NULL);
    net->wall_theta[i] = weight;
    net->amplification[k] += rate;
    if (!by) return;
    double *row = by + (net->chamber_count + i) * at.all;
    const gas_state state = ready_state(net, k, 1, 1);
    /* The capacity is the sum of m c_v(T). */
    for (ptrdiff_t v = 0; v < state.variable_count; ++v) {
        const double *slope = state.slopes + v * (FRACTIONS + state.species_count);
        double capacity_slope = 0;
        for (ptrdiff_t j = 0; j < state.species_count; ++j) {
            double u;
            double cv;
            double cv_by_T;
            heat_of(net, state.species[j], T, &u, &cv, &cv_by_T);
            capacity_slope += net->m0[net->state_first[k] + j] * cv_by_T * slope[TEMPERATURE];
            if (v == 2 + j) capacity_slope += cv;
        }
        row[state.columns[v]] =
            slopes[0] * (*net->h * df[3] * slope[TEMPERATURE] / capacity -
                         rate * capacity_slope / capacity);
    }
    row[at.wall_state + 2 * i] = slopes[0] * *net->h * df[4] / capacity;
    row[at.wall_state + 2 * i + 1] = slopes[0] * *net->h * df[5] / capacity;
}

/* Set the weights, and their derivatives (n + w, stride) if `by` is given. */
static void choose_weights(const gas_network *net, double *by, double *by_sums)
{
    const ptrdiff_t n = net->chamber_count;
    const gas_columns at = columns_of(net);
    double *relaxation = sums_in(net);
    double *equalisation = relaxation + n;
    memset(relaxation, 0, (size_t)(2 * n) * sizeof *relaxation);
    memset(net->amplification, 0, (size_t)n * sizeof *relaxation);
    const gas_weights sums = {relaxation, equalisation, net->amplification, by_sums, at.all};
    for (ptrdiff_t k = 0; k < n; ++k) set_start(net, k, by ? 1 : 0);
    for (ptrdiff_t b = 0; b < net->boundary_count; ++b) set_boundary(net, b, by ? 2 : 0);
    for (ptrdiff_t i = 0; i < net->opening_count; ++i) add_conductance(net, i, &sums);
    for (ptrdiff_t k = 0; k < n; ++k) {
        /* A chamber whose pressure would not relax, by round-off or a law of the user, has the
           weight of one at rest. */
        const double x[2] = {fmax(relaxation[k], 0), equalisation[k]};
        double f;
        double df[2];
        net->weight(x, &f, df, NULL);
        net->theta[k] = f;
        if (!by) continue;
        if (relaxation[k] < 0) df[0] = 0;
        for (ptrdiff_t column = 0; column < at.all; ++column)
            by[k * at.all + column] = df[0] * by_sums[k * at.all + column] +
                                      df[1] * by_sums[(n + k) * at.all + column];
    }
    for (ptrdiff_t i = 0; i < net->wall_count; ++i) choose_wall_weight(net, i, by);
}

void gas_begin(const gas_network *net)
{
    for (ptrdiff_t k = 0; k < net->chamber_count; ++k) {
        double factor;
        net->pV0[k] = net->p0[k] * net->V0[k];
        energy_of(net, k, net->pV0[k], net->m0 + net->state_first[k], &factor, NULL, &net->T0[k]);
        net->exponent[k] = 1 / factor;
    }
    choose_weights(net, NULL, NULL);
    for (ptrdiff_t b = 0; b < net->boundary_count; ++b) set_boundary(net, b, 0);
}

void gas_weight_derivatives(const gas_network *net, double *by_all)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t stride = columns_of(net).all;
    double *by_sums = by_all + (n + net->wall_count) * stride;
    memset(by_all, 0, (size_t)((3 * n + net->wall_count) * stride) * sizeof *by_all);
    choose_weights(net, by_all, by_sums);
}

/* ---- solution ---------------------------------------------------------------------------------- */

/* Whether all values are at most `bound` in size; not if one is NaN. */
static int all_within(const double *values, ptrdiff_t count, double bound)
{
    for (ptrdiff_t i = 0; i < count; ++i)
        if (!(fabs(values[i]) <= bound)) return 0;
    return 1;
}

/* Replace b (size) by the solution of A x = b, and A, whose rows have the distance `stride`, by its
   factors: elimination with partial pivoting.  Returns whether A has an inverse. */
static int solve_linear(double *A, ptrdiff_t stride, double *b, ptrdiff_t size)
{
    for (ptrdiff_t column = 0; column < size; ++column) {
        ptrdiff_t pivot = column;
        for (ptrdiff_t row = column + 1; row < size; ++row)
            if (fabs(A[row * stride + column]) > fabs(A[pivot * stride + column])) pivot = row;
        if (A[pivot * stride + column] == 0) return 0;
        if (pivot != column) {
            for (ptrdiff_t j = 0; j < size; ++j) {
                const double upper = A[column * stride + j];
                A[column * stride + j] = A[pivot * stride + j];
                A[pivot * stride + j] = upper;
            }
            const double upper = b[column];
            b[column] = b[pivot];
            b[pivot] = upper;
        }
        for (ptrdiff_t row = column + 1; row < size; ++row) {
            const double factor = A[row * stride + column] / A[column * stride + column];
            if (factor == 0) continue;
            for (ptrdiff_t j = column + 1; j < size; ++j)
                A[row * stride + j] -= factor * A[column * stride + j];
            b[row] -= factor * b[column];
        }
    }
    for (ptrdiff_t row = size - 1; row >= 0; --row) {
        for (ptrdiff_t j = row + 1; j < size; ++j) b[row] -= A[row * stride + j] * b[j];
        b[row] /= A[row * stride + row];
    }
    return 1;
}

/* Set error (n + s + r) to the residual over the scale; returns the square of the rows from `first`
   to `last`. */
static double scaled_residual(const gas_network *net, const double *y, const double *V,
                              const double *W, const double *scale, ptrdiff_t first, ptrdiff_t last,
                              double *error)
{
    double square = 0;
    gas_residual(net, y, V, W, error);
    for (ptrdiff_t i = first; i < last; ++i) {
        error[i] /= scale[i];
        square += error[i] * error[i];
    }
    return square;
}

void gas_scales(const gas_network *net, const double *y, const double *V, const double *magnitude,
                double *scale)
{
    const ptrdiff_t n = net->chamber_count;
    double *sizes = scratch(net);
    for (ptrdiff_t k = 0; k < n; ++k) {
        const double flows = 1 + net->round_off * net->amplification[k];
        const double volume = fabs(V[k]) * flows + net->round_off * magnitude[k];
        double mass = 0;
        double start = 0;
        for (int32_t row = net->state_first[k]; row < net->state_first[k + 1]; ++row) {
            sizes[row - net->state_first[k]] = fabs(y[n + row]);
            mass += fabs(y[n + row]);
            start += net->m0[row];
        }
        scale[k] =
            energy_of(net, k, fabs(y[k]) * volume, sizes, NULL, NULL, NULL) + net->U0[k];
        for (int32_t row = net->state_first[k]; row < net->state_first[k + 1]; ++row)
            scale[n + row] = mass * flows + start;
    }
    if (net->variable_count == 0) return;
    set_states(net, y, V, 0);
    add_all_variables(net, 0, y, NULL, NULL, 0, scale);
}

/* `gas_solve` of the equations from `first` to `last` for the same unknowns, the others held. */
static int solve_rows(const gas_network *net, double *y, const double *V, const double *W,
                      const double *magnitude, ptrdiff_t first, ptrdiff_t last)
{
    const ptrdiff_t n = net->chamber_count;
    const ptrdiff_t s = net->mass_count;
    const ptrdiff_t size = size_of(net);
    const ptrdiff_t stride = size + n;
    double *scale = sums_in(net) + 2 * n + 2 * s + net->opening_count + 2;
    double *error = scale + size;
    double *trial = error + size;
    double *update = trial + size;
    double *matrix = update + size;
    /* What flows in the step, at the guess */
    double *mass = sums_in(net);
    double *energy = mass + s;
    gas_scales(net, y, V, magnitude, scale);
    gas_residual(net, y, V, W, error);
    for (ptrdiff_t k = 0; k < n; ++k) scale[k] += *net->h * fabs(energy[k]);
    for (ptrdiff_t row = 0; row < s; ++row) scale[n + row] += *net->h * fabs(mass[row]);
    double square = 0;
    for (ptrdiff_t i = first; i < last; ++i) {
        error[i] /= scale[i];
        square += error[i] * error[i];
    }
    memcpy(trial, y, (size_t)size * sizeof *y);
    for (ptrdiff_t iteration = 0; iteration < net->max_iterations; ++iteration) {
        if (last > n + s) {
            /* The size of a state variable that starts at zero is that of the iterate. */
            set_states(net, y, V, 0);
            add_all_variables(net, 0, y, NULL, NULL, 0, scale);
            square = scaled_residual(net, y, V, W, scale, first, last, error);
        }
        if (all_within(error + first, last - first, net->tolerance)) return 1;
        gas_derivatives(net, y, V, W, 0, matrix);
        for (ptrdiff_t row = first; row < last; ++row) {
            for (ptrdiff_t j = first; j < last; ++j) matrix[row * stride + j] /= scale[row];
            update[row] = error[row];
        }
        if (!solve_linear(matrix + first * (stride + 1), stride, update + first, last - first))
            return 0;
        const double square_before = square;
        double length = 1;
        for (ptrdiff_t halving = 0; halving < net->max_halvings; ++halving, length /= 2) {
            for (ptrdiff_t i = first; i < last; ++i) trial[i] = y[i] - length * update[i];
            for (ptrdiff_t i = first; i < last && i < n + s; ++i)
                trial[i] = fmax(trial[i], net->remaining * y[i]);
            square = scaled_residual(net, trial, V, W, scale, first, last, error);
            if (square < square_before) break;
        }
        /* No trial is better: y is the solution to round-off, or the volumes are far off, and from
           nearly the same y the iteration would fail again. */
        if (!(square < square_before))
            return square_before <= net->acceptable * net->acceptable;
        memcpy(y, trial, (size_t)size * sizeof *y);
    }
    return all_within(error + first, last - first, net->acceptable);
}

int gas_solve(const gas_network *net, double *y, const double *V, const double *W,
              const double *magnitude)
{
    const ptrdiff_t of_gas = net->chamber_count + net->mass_count;
    const ptrdiff_t size = size_of(net);
    if (net->variable_count == 0) return solve_rows(net, y, V, W, magnitude, 0, size);
    double *guess = net->work + gas_work_length(net) - size;
    memcpy(guess, y, (size_t)size * sizeof *y);
    if (solve_rows(net, y, V, W, magnitude, 0, size)) return 1;
    /* A valve that is closed at the guess and opens in the step: nothing flows there, whatever its
       lift, so that the gas cannot be in balance nearby.  It is opened first. */
    memcpy(y, guess, (size_t)size * sizeof *y);
    solve_rows(net, y, V, W, magnitude, of_gas, size);
    solve_rows(net, y, V, W, magnitude, 0, of_gas);
    return solve_rows(net, y, V, W, magnitude, 0, size);
}

/* A linear system as a unit for co-simulation, FMI 2.0: dz/dt = A z + B u, y = y_rest + C z + D u.
   Inputs are held during a step, which is then exact: z1 = exp(A h) z0 + integral of exp(A s) B u.
   state_space.py puts the numbers of a structure before this file; those below are of a mass on a
   spring. */
#ifndef STATES
#define STATES 2
#define INPUTS 1
#define OUTPUTS 1
#define A_VALUES {0, 1, -1, 0}
#define B_VALUES {0, 1}
#define C_VALUES {1, 0}
#define D_VALUES {0}
#define REST_VALUES {0}
#define GUID ""
#endif

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { N = STATES, M = INPUTS, K = OUTPUTS, S = N + M };

static const double A[] = A_VALUES;
static const double B[] = B_VALUES;
static const double C[] = C_VALUES;
static const double D[] = D_VALUES;
static const double rest[] = REST_VALUES;

/* Types of the interface. */
typedef void *component;
typedef unsigned int reference;
typedef int status; /* 0 OK, 3 error */
enum { OK = 0, ERROR = 3 };

typedef struct {
    double z[N + 1], u[M + 1];
    double time;
    double h;                   /* length of the step that `step` is for; 0: none */
    double step[(S ? S : 1) * (S ? S : 1)]; /* exp of h [[A, B], [0, 0]] */
} unit;

static void multiply(const double *a, const double *b, double *c)
{
    for (int i = 0; i < S; i++)
        for (int j = 0; j < S; j++) {
            double sum = 0;
            for (int k = 0; k < S; k++) sum += a[i * S + k] * b[k * S + j];
            c[i * S + j] = sum;
        }
}

/* The exponential by scaling, a Taylor series, and squaring.  Returns 0 without memory. */
static int set_step(unit *self, double h)
{
    if (h == self->h) return 1;
    const size_t size = (size_t)S * S;
    double *x = calloc(3 * size, sizeof *x);
    if (!x) return 0;
    double *term = x + size, *next = term + size, norm = 0;
    for (int i = 0; i < N; i++) {
        double sum = 0;
        for (int j = 0; j < N; j++) x[i * S + j] = h * A[i * N + j];
        for (int j = 0; j < M; j++) x[i * S + N + j] = h * B[i * M + j];
        for (int j = 0; j < S; j++) sum += fabs(x[i * S + j]);
        if (sum > norm) norm = sum;
    }
    int squarings = 0;
    while (norm > 0.125 && squarings < 1000) norm /= 2, squarings++;
    for (size_t i = 0; i < size; i++) x[i] = ldexp(x[i], -squarings);
    memset(self->step, 0, size * sizeof *self->step);
    memset(term, 0, size * sizeof *term);
    for (int i = 0; i < S; i++) self->step[i * S + i] = term[i * S + i] = 1;
    /* 0.125^12/12! is below round-off. */
    for (int k = 1; k <= 14; k++) {
        multiply(term, x, next);
        for (size_t i = 0; i < size; i++) {
            term[i] = next[i] / k;
            self->step[i] += term[i];
        }
    }
    for (int k = 0; k < squarings; k++) {
        multiply(self->step, self->step, next);
        memcpy(self->step, next, size * sizeof *next);
    }
    free(x);
    self->h = h;
    return 1;
}

static double output(const unit *self, int k)
{
    double y = rest[k];
    for (int j = 0; j < N; j++) y += C[k * N + j] * self->z[j];
    for (int j = 0; j < M; j++) y += D[k * M + j] * self->u[j];
    return y;
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

component fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                          const void *functions, int visible, int logging)
{
    (void)name, (void)resources, (void)functions, (void)visible, (void)logging;
    /* 1 is co-simulation. */
    if (type != 1 || !guid || strcmp(guid, GUID)) return NULL;
    return calloc(1, sizeof(unit));
}

void fmi2FreeInstance(component c) { free(c); }

status fmi2SetDebugLogging(component c, int on, size_t count, const char *const categories[])
{
    (void)c, (void)on, (void)count, (void)categories;
    return OK;
}

status fmi2SetupExperiment(component c, int has_tolerance, double tolerance, double start,
                           int has_stop, double stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    ((unit *)c)->time = start;
    return OK;
}

status fmi2EnterInitializationMode(component c) { return c ? OK : ERROR; }
status fmi2ExitInitializationMode(component c) { return c ? OK : ERROR; }
status fmi2Terminate(component c) { return c ? OK : ERROR; }

status fmi2Reset(component c)
{
    memset(c, 0, sizeof(unit));
    return OK;
}

status fmi2GetReal(component c, const reference r[], size_t count, double values[])
{
    const unit *self = c;
    for (size_t i = 0; i < count; i++) {
        if (r[i] >= (reference)(M + K)) return ERROR;
        values[i] = r[i] < (reference)M ? self->u[r[i]] : output(self, (int)r[i] - M);
    }
    return OK;
}

status fmi2SetReal(component c, const reference r[], size_t count, const double values[])
{
    unit *self = c;
    for (size_t i = 0; i < count; i++) {
        if (r[i] >= (reference)M) return ERROR;
        self->u[r[i]] = values[i];
    }
    return OK;
}

status fmi2DoStep(component c, double time, double h, int may_not_go_back)
{
    unit *self = c;
    (void)may_not_go_back;
    if (!(h >= 0) || !set_step(self, h)) return ERROR;
    double z[N + 1];
    for (int i = 0; i < N; i++) {
        z[i] = 0;
        for (int j = 0; j < N; j++) z[i] += self->step[i * S + j] * self->z[j];
        for (int j = 0; j < M; j++) z[i] += self->step[i * S + N + j] * self->u[j];
    }
    memcpy(self->z, z, N * sizeof *z);
    self->time = time + h;
    return OK;
}

status fmi2CancelStep(component c) { return c ? ERROR : ERROR; }

/* The unit has no variables of other types, and its states are not handed out. */
status fmi2GetInteger(component c, const reference r[], size_t count, int values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2GetBoolean(component c, const reference r[], size_t count, int values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2GetString(component c, const reference r[], size_t count, const char *values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2SetInteger(component c, const reference r[], size_t count, const int values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2SetBoolean(component c, const reference r[], size_t count, const int values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2SetString(component c, const reference r[], size_t count, const char *const values[])
{
    (void)c, (void)r, (void)values;
    return count ? ERROR : OK;
}

status fmi2GetFMUstate(component c, void **state)
{
    (void)c, (void)state;
    return ERROR;
}

status fmi2SetFMUstate(component c, void *state)
{
    (void)c, (void)state;
    return ERROR;
}

status fmi2FreeFMUstate(component c, void **state)
{
    (void)c, (void)state;
    return ERROR;
}

status fmi2SerializedFMUstateSize(component c, void *state, size_t *size)
{
    (void)c, (void)state, (void)size;
    return ERROR;
}

status fmi2SerializeFMUstate(component c, void *state, char bytes[], size_t size)
{
    (void)c, (void)state, (void)bytes, (void)size;
    return ERROR;
}

status fmi2DeSerializeFMUstate(component c, const char bytes[], size_t size, void **state)
{
    (void)c, (void)bytes, (void)size, (void)state;
    return ERROR;
}

status fmi2GetDirectionalDerivative(component c, const reference unknown[], size_t unknowns,
                                    const reference known[], size_t knowns, const double seed[],
                                    double values[])
{
    (void)c, (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)values;
    return ERROR;
}

status fmi2SetRealInputDerivatives(component c, const reference r[], size_t count,
                                   const int order[], const double values[])
{
    (void)c, (void)r, (void)order, (void)values;
    return count ? ERROR : OK;
}

status fmi2GetRealOutputDerivatives(component c, const reference r[], size_t count,
                                    const int order[], double values[])
{
    (void)c, (void)r, (void)order, (void)values;
    return count ? ERROR : OK;
}

status fmi2GetStatus(component c, int kind, status *value)
{
    (void)c, (void)kind, (void)value;
    return ERROR;
}

status fmi2GetRealStatus(component c, int kind, double *value)
{
    (void)kind;
    /* 2 is the time of the last step. */
    *value = ((unit *)c)->time;
    return OK;
}

status fmi2GetIntegerStatus(component c, int kind, int *value)
{
    (void)c, (void)kind, (void)value;
    return ERROR;
}

status fmi2GetBooleanStatus(component c, int kind, int *value)
{
    (void)c, (void)kind, (void)value;
    return ERROR;
}

status fmi2GetStringStatus(component c, int kind, const char **value)
{
    (void)c, (void)kind, (void)value;
    return ERROR;
}

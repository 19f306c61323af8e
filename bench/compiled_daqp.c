/* One solver after another on the recorded QPs of one size: read by compiled_daqp.py, which puts CasADi's C before it.

   A tick is (complete parameters, memory, start) -> an answer with its certificate. A chain of ours is asked first; what
   it leaves with a residual above `accept` goes to DAQP, whose workspace is set up once. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "api.h"
#include "utils.h"
#undef malloc
#undef calloc
extern void *malloc(size_t size), *calloc(size_t count, size_t size);

typedef int evaluated(const double **, double **, casadi_int *, double *, int);
static evaluated *const functions[] = {FUNCTIONS};
static const double *arguments[ARGUMENTS];
static double *results[RESULTS], reals[REALS];
static casadi_int integers[INTEGERS];

static double H[VARS * VARS], g[VARS], A[ROWS * VARS + 1], rows_lower[ROWS + 1], rows_upper[ROWS + 1], lower[VARS], upper[VARS], sound[1], by_rows[ROWS * VARS + 1];
static double scaled[VARS * VARS], linear[VARS], low[VARS + ROWS], high[VARS + ROWS], x[VARS], pushes[VARS + ROWS], residual[1];
static int sense[VARS + ROWS];
static DAQPWorkspace work;
static DAQPSettings settings;
static DAQPProblem qp = {.n = VARS, .m = VARS + ROWS, .ms = VARS, .H = scaled, .f = linear, .A = by_rows, .bupper = high, .blower = low, .sense = sense};
static DAQPResult result = {.x = x, .lam = pushes};
static long allocations;

void *counted_malloc(size_t size) { allocations++; return malloc(size); }
void *counted_calloc(size_t count, size_t size) { allocations++; return calloc(count, size); }
long allocated(void) { return allocations; }

static void call(int which, const double **in, int n_in, double **out, int n_out)
{
    memcpy(arguments, in, n_in * sizeof *in);
    memcpy(results, out, n_out * sizeof *out);
    functions[which](arguments, results, integers, reals, 0);
}

/* Everything of DAQP's problem anew, since all of it changes from tick to tick; active are the bounds marked in `sense`. */
static int attempt(double tolerance)
{
    static int ready;
    settings.primal_tol = tolerance;
    if (!ready) {
        work.settings = &settings;
        ready = setup_daqp(&qp, &work, NULL) > 0;
        if (!ready) return 0;
    } else if (daqp_update_ldp(DAQP_UPDATE_Rinv | DAQP_UPDATE_M | DAQP_UPDATE_v | DAQP_UPDATE_d | DAQP_UPDATE_sense, &work, &qp) < 0)
        return 0;
    daqp_solve(&result, &work);
    return result.exitflag == DAQP_EXIT_OPTIMAL;
}

/* Equalities, and with `warm` the bounds that push in `start`. */
static void mark(const double *start, int warm)
{
    for (int i = 0; i < VARS + ROWS; i++) {
        int equal = low[i] == high[i];
        double pushing = warm ? start[VARS + i] : 0.0;
        sense[i] = equal ? DAQP_ACTIVE | DAQP_IMMUTABLE : pushing > 0 ? DAQP_ACTIVE : pushing < 0 ? DAQP_ACTIVE | DAQP_LOWER : 0;
    }
}

static void by_daqp(const double *full, const double *memory, const double *start, int warm, double *answer)
{
    static const double tolerances[] = {1e-10, 3e-9, 1e-7};
    const double *data[] = {H, g, A, rows_lower, rows_upper, lower, upper, sound, x, pushes, pushes + VARS};
    double *built[] = {H, g, A, rows_lower, rows_upper, lower, upper, sound}, *certified[] = {answer, residual};
    call(BUILD, (const double *[]){full, memory}, 2, built, 8);
    /* As optim/backends.py: where curvatures are uneven, in units in which each is 1. */
    double most = 0.0, least = 1.0 / 0.0, units[VARS];
    for (int i = 0; i < VARS; i++) {
        most = fmax(most, H[i * VARS + i]);
        least = fmin(least, H[i * VARS + i]);
    }
    for (int i = 0; i < VARS; i++) units[i] = most > 1e4 * least ? 1.0 / sqrt(fmax(H[i * VARS + i], 1e-14 * most)) : 1.0;
    for (int i = 0; i < VARS; i++) {
        for (int j = 0; j < VARS; j++) scaled[i * VARS + j] = units[i] * H[i * VARS + j] * units[j];
        for (int j = 0; j < ROWS; j++) by_rows[j * VARS + i] = A[i * ROWS + j] * units[i];
        linear[i] = g[i] * units[i];
    }
    for (int i = 0; i < VARS + ROWS; i++) {
        double below = i < VARS ? lower[i] / units[i] : rows_lower[i - VARS], above = i < VARS ? upper[i] / units[i] : rows_upper[i - VARS];
        low[i] = below < -DAQP_INF ? -DAQP_INF : below;
        high[i] = above > DAQP_INF ? DAQP_INF : above;
    }
    daqp_default_settings(&settings);
    settings.dual_tol = 1e-12;
    settings.iter_limit = 1000;
    settings.eq_reduction = DAQP_EQ_REDUCTION_OFF;
    int done = 0;
    for (int i = 0; i < 3 && !done; i++) {
        mark(start, warm && i == 0);
        done = attempt(tolerances[i]);
    }
    for (int i = 0; i < VARS; i++) {
        x[i] *= units[i];
        pushes[i] /= units[i];
    }
    residual[0] = 1.0 / 0.0;
    if (done) call(CERTIFY, data, 11, certified, 2);
    memcpy(answer + VARS, pushes, sizeof pushes);
    answer[2 * VARS + ROWS] = residual[0];
    answer[2 * VARS + ROWS + 1] = 9;
}

/* `which` < 0: DAQP alone; daqp 0: not at all, 1: cold, 2: warm. */
void run(int which, int daqp, double accept, double tolerance, long ticks, const double *full, const double *memory,
         double *answers, double *nanoseconds)
{
    static double start[2 * VARS + ROWS + 2];
    memset(start, 0, sizeof start);
    for (long k = 0; k < ticks; k++, full += FULL, memory += MEMORY, answers += 2 * VARS + ROWS + 2) {
        struct timespec began, ended;
        clock_gettime(CLOCK_MONOTONIC, &began);
        answers[2 * VARS + ROWS] = 0.0 / 0.0;
        if (which >= 0) call(which, (const double *[]){full, memory, start}, 3, (double *[]){answers}, 1);
        if (daqp && !(answers[2 * VARS + ROWS] <= accept)) by_daqp(full, memory, start, daqp == 2, answers);
        clock_gettime(CLOCK_MONOTONIC, &ended);
        nanoseconds[k] = 1e9 * (ended.tv_sec - began.tv_sec) + (ended.tv_nsec - began.tv_nsec);
        if (answers[2 * VARS + ROWS] <= tolerance) memcpy(start, answers, sizeof start);
        else memset(start, 0, sizeof start);
    }
}

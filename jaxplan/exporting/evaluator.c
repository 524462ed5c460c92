/* @TITLE@
 *
 * On a piece from t_k to t_{k+1}, with x = 2 (t - t_k) / (t_{k+1} - t_k) - 1, the attitude is
 *
 *     q = q_a u e u,  u = exp(tau Omega / 2),  e = exp(eta),  eta = b(x) - tau Omega,  tau = t - t_a,
 *
 * of the chart (q_a, t_a, Omega) that the piece is in; b and the joints are polynomials in x.
 */
#include "@PREFIX@.h"

#include <math.h>
#include <stddef.h>

#define PIECES (@PIECES@)
#define POWERS (@POWERS@) /* of b: one more than its degree */
#define SERIES (11)       /* terms: below one the next is smaller than the rounding of the first */
@JOINT_MACROS@
static const double BREAKS[PIECES + 1] = {
@BREAKS@};

static const double B[PIECES][POWERS][3] = {
@COEFFICIENTS@};

static const uint32_t CHART[PIECES] = {
@CHART@};

/* of each chart q_a, t_a and Omega */
static const double CHARTS[@CHARTS@][8] = {
@CHART_ROWS@};
@JOINT_TABLES@
/* The number of the last piece that has begun; within are as many as 2^steps. */
static uint32_t piece_at(const double breaks[], uint32_t pieces, double t)
{
    uint32_t low = 0U;
    uint32_t high = pieces;

    while ((high - low) > 1U)
    {
        const uint32_t middle = low + ((high - low) / 2U);
        if (breaks[middle] <= t)
        {
            low = middle;
        }
        else
        {
            high = middle;
        }
    }
    return low;
}

/* x of a time on a piece, and its derivative by time; a piece without length is held at its beginning. */
static void place(const double breaks[], uint32_t piece, double t, double *x, double *slope)
{
    const double length = breaks[piece + 1U] - breaks[piece];

    *slope = 0.0;
    *x = -1.0;
    if (length > 0.0)
    {
        *slope = 2.0 / length;
        *x = ((t - breaks[piece]) * *slope) - 1.0;
    }
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = (a[1] * b[2]) - (a[2] * b[1]);
    out[1] = (a[2] * b[0]) - (a[0] * b[2]);
    out[2] = (a[0] * b[1]) - (a[1] * b[0]);
}

static double dot(const double a[3], const double b[3])
{
    return (a[0] * b[0]) + (a[1] * b[1]) + (a[2] * b[2]);
}

static void product(const double p[4], const double q[4], double out[4])
{
    out[0] = (p[0] * q[0]) - (p[1] * q[1]) - (p[2] * q[2]) - (p[3] * q[3]);
    out[1] = (p[0] * q[1]) + (p[1] * q[0]) + (p[2] * q[3]) - (p[3] * q[2]);
    out[2] = (p[0] * q[2]) - (p[1] * q[3]) + (p[2] * q[0]) + (p[3] * q[1]);
    out[3] = (p[0] * q[3]) + (p[1] * q[2]) - (p[2] * q[1]) + (p[3] * q[0]);
}

static void matrix(const double q[4], double out[3][3])
{
    const double x = q[1];
    const double y = q[2];
    const double z = q[3];
    const double w = q[0];

    out[0][0] = 1.0 - (2.0 * ((y * y) + (z * z)));
    out[0][1] = 2.0 * ((x * y) - (w * z));
    out[0][2] = 2.0 * ((x * z) + (w * y));
    out[1][0] = 2.0 * ((x * y) + (w * z));
    out[1][1] = 1.0 - (2.0 * ((x * x) + (z * z)));
    out[1][2] = 2.0 * ((y * z) - (w * x));
    out[2][0] = 2.0 * ((x * z) - (w * y));
    out[2][1] = 2.0 * ((y * z) + (w * x));
    out[2][2] = 1.0 - (2.0 * ((x * x) + (y * y)));
}

/* Turns a vector by the transpose of a rotation. */
static void turned_back(double m[3][3], const double v[3], double out[3])
{
    uint32_t i;

    for (i = 0U; i < 3U; i++)
    {
        out[i] = (m[0][i] * v[0]) + (m[1][i] * v[1]) + (m[2][i] * v[2]);
    }
}

/* The quaternion of a rotation vector, right to the last digits at any angle. */
static void exponential(const double v[3], double out[4])
{
    const double square = dot(v, v);
    double half_sinc = 0.5; /* sin(angle / 2) / angle */
    double cosine = 1.0;

    if (square > 1.0e-300)
    {
        const double angle = sqrt(square);
        half_sinc = sin(0.5 * angle) / angle;
        cosine = cos(0.5 * angle);
    }
    out[0] = cosine;
    out[1] = half_sinc * v[0];
    out[2] = half_sinc * v[1];
    out[3] = half_sinc * v[2];
}

/* Of the right Jacobian of a rotation vector: a = (1 - cos n) / n^2 and b = (n - sin n) / n^3, and their
 * derivatives by s = n^2. */
static void jacobian(double s, double *a, double *b, double *a_s, double *b_s)
{
    if (s < 1.0)
    {
        /* sums of (-s)^k / (2 k + 2)! and of (-s)^k / (2 k + 3)! */
        double first = 0.0;
        double second = 0.0;
        double first_s = 0.0;
        double second_s = 0.0;
        uint32_t k;

        for (k = SERIES; k > 0U; k--)
        {
            const double m = 2.0 * (double)k;
            /* 1 - s / ((m + 1) (m + 2)) (1 - ...), and likewise one further on */
            const double one = 1.0 / ((m + 1.0) * (m + 2.0));
            const double two = 1.0 / ((m + 2.0) * (m + 3.0));
            first_s = -one * ((1.0 + first) + (s * first_s));
            first = -one * s * (1.0 + first);
            second_s = -two * ((1.0 + second) + (s * second_s));
            second = -two * s * (1.0 + second);
        }
        *a = 0.5 * (1.0 + first);
        *a_s = 0.5 * first_s;
        *b = (1.0 + second) / 6.0;
        *b_s = second_s / 6.0;
    }
    else
    {
        const double n = sqrt(s);
        const double sine = sin(n);
        const double half = sin(0.5 * n);
        *a = (2.0 * half * half) / s;
        *b = (n - sine) / (n * s);
        *a_s = (((0.5 * sine) / n) - *a) / s;
        *b_s = ((0.5 * *a) - (1.5 * *b)) / s;
    }
}

/* Three polynomials with their first two derivatives by time. */
static void polynomials(const double c[POWERS][3], double x, double slope, double out[3][3])
{
    uint32_t i;
    uint32_t k;

    for (i = 0U; i < 3U; i++)
    {
        double value = 0.0;
        double first = 0.0;
        double second = 0.0; /* half of it */
        for (k = POWERS; k > 0U; k--)
        {
            second = (second * x) + first;
            first = (first * x) + value;
            value = (value * x) + c[k - 1U][i];
        }
        out[0][i] = value;
        out[1][i] = first * slope;
        out[2][i] = 2.0 * second * slope * slope;
    }
}

static void platform(double t, @PREFIX@_state *state)
{
    const uint32_t piece = piece_at(BREAKS, PIECES, t);
    const double *chart = CHARTS[CHART[piece]];
    const double *rate = &chart[5];
    const double tau = t - chart[4];
    double along[3][3];
    double turned[3];
    double eta[3];
    double eta_1[3];
    double half[4];
    double own[4];
    double left[4];
    double gamma[4];
    double half_matrix[3][3];
    double gamma_matrix[3][3];
    double across[3];
    double twice[3];
    double bent[3];
    double across_2[3];
    double twice_2[3];
    double tangent[3];
    double bend[3];
    double x;
    double slope;
    double a;
    double b;
    double a_s;
    double b_s;
    double s_1;
    uint32_t i;

    place(BREAKS, piece, t, &x, &slope);
    polynomials(B[piece], x, slope, along);
    for (i = 0U; i < 3U; i++)
    {
        turned[i] = 0.5 * tau * rate[i];
        eta[i] = along[0][i] - (tau * rate[i]);
        eta_1[i] = along[1][i] - rate[i];
    }
    exponential(turned, half);
    exponential(eta, own);
    product(half, own, left);
    product(left, half, gamma);
    product(chart, gamma, state->quaternion);
    matrix(state->quaternion, state->attitude);
    matrix(half, half_matrix);
    matrix(gamma, gamma_matrix);

    /* D(eta) v = v - a eta x v + b eta x (eta x v), for eta' and, with its own change, for its derivative */
    jacobian(dot(eta, eta), &a, &b, &a_s, &b_s);
    s_1 = 2.0 * dot(eta, eta_1);
    cross(eta, eta_1, across);
    cross(eta, across, twice);
    cross(eta_1, across, bent);
    cross(eta, along[2], across_2);
    cross(eta, across_2, twice_2);
    for (i = 0U; i < 3U; i++)
    {
        tangent[i] = (eta_1[i] - (a * across[i])) + (b * twice[i]);
        bend[i] = ((along[2][i] - (a * across_2[i])) + (b * twice_2[i]))
                  + (((b * bent[i]) + (b_s * s_1 * twice[i])) - (a_s * s_1 * across[i]));
    }

    /* (29): the velocity is gamma^T Omega / 2 + Omega / 2 + U^T D eta' */
    {
        double carried[3];
        double moved[3];
        double bowed[3];
        double first[3];
        double last[3];

        turned_back(gamma_matrix, rate, carried);
        turned_back(half_matrix, tangent, moved);
        turned_back(half_matrix, bend, bowed);
        for (i = 0U; i < 3U; i++)
        {
            carried[i] = 0.5 * carried[i];
            state->angular_velocity[i] = carried[i] + (0.5 * rate[i]) + moved[i];
        }
        cross(carried, state->angular_velocity, first);
        cross(moved, rate, last);
        for (i = 0U; i < 3U; i++)
        {
            state->angular_acceleration[i] = first[i] + (0.5 * last[i]) + bowed[i];
        }
    }
}
@JOINT_FUNCTION@
@PREFIX@_status @PREFIX@_evaluate(double t, @PREFIX@_state *state)
{
    @PREFIX@_status status = @PREFIX_UPPER@_OK;
    double time = t;
    uint32_t i;

    if (state == NULL)
    {
        return @PREFIX_UPPER@_NO_STATE;
    }
    if (!(t >= 0.0))
    {
        time = 0.0;
        status = (t < 0.0) ? @PREFIX_UPPER@_BEFORE : @PREFIX_UPPER@_NOT_A_NUMBER;
    }
    else if (t > @PREFIX_UPPER@_DURATION)
    {
        time = @PREFIX_UPPER@_DURATION;
        status = @PREFIX_UPPER@_AFTER;
    }
    else
    {
        /* within */
    }
    platform(time, state);
@JOINT_CALL@    if (status != @PREFIX_UPPER@_OK)
    {
        for (i = 0U; i < 3U; i++)
        {
            state->angular_velocity[i] = 0.0;
            state->angular_acceleration[i] = 0.0;
        }
@JOINT_REST@    }
    return status;
}

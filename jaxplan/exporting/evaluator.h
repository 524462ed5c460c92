/* @TITLE@
 *
 * The motion that was certified: polynomial pieces, and a function that evaluates them at any time.
 * Made by jaxplan @VERSION@.
 *
 * epoch        @EPOCH@
 * duration     @DURATION@ s, time counts from the epoch
 * joints       @JOINT_LIST@
 * pieces       @PIECES@ of the platform, @JOINT_PIECES@ of the joints
 * tables       @BYTES@ bytes, constant
 * state        @STATE_BYTES@ bytes, the caller's; nothing is allocated, nothing is kept between calls
 * worst case   @OPERATIONS@
 *              a call, with loops of fixed or bounded length
 *
 * Attitude is body to inertial, rates are in body axes, angles in rad, times in s.
 * C99; needs <math.h> for sin, cos and sqrt. Numbers must be IEEE doubles.
 */
#ifndef @GUARD@
#define @GUARD@

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define @PREFIX_UPPER@_DURATION (@DURATION_LITERAL@) /* s */
#define @PREFIX_UPPER@_JOINTS (@JOINTS@)

typedef enum
{
    @PREFIX_UPPER@_OK = 0,           /* the time lies within the motion */
    @PREFIX_UPPER@_BEFORE = 1,       /* earlier: held at the start, rates and accelerations are zero */
    @PREFIX_UPPER@_AFTER = 2,        /* later: held at the end, rates and accelerations are zero */
    @PREFIX_UPPER@_NOT_A_NUMBER = 3, /* the time is none: as before the start */
    @PREFIX_UPPER@_NO_STATE = 4      /* a null pointer: nothing is written */
} @PREFIX@_status;

typedef struct
{
    double quaternion[4];            /* body to inertial, scalar first; its sign does not jump */
    double attitude[3][3];           /* inertial components = attitude * body components */
    double angular_velocity[3];      /* rad/s, body axes */
    double angular_acceleration[3];  /* rad/s^2, body axes */
@JOINT_FIELDS@} @PREFIX@_state;

/* Evaluates the motion at a time t, in s from the epoch. */
@PREFIX@_status @PREFIX@_evaluate(double t, @PREFIX@_state *state);

#ifdef __cplusplus
}
#endif

#endif

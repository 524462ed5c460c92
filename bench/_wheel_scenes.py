"""Random slews of a platform with four wheels among cones, and the tube that they are planned with.

A telescope and a star tracker are fixed to the platform, so what they see follows from the attitude alone;
joints are left out. The wheels stand in a pyramid and store momentum at the start. Their limits bind: plans
are the shortest along one path, in which nearly always some wheel is at its limit of torque or of momentum.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import jaxplan as jp

CONES = 4
PATIENCE = 40  # cones that are drawn before the slew is drawn anew
INERTIA = np.array([[120.0, 4.0, -2.0], [4.0, 100.0, 3.0], [-2.0, 3.0, 80.0]])  # kg m^2, as is thought
TORQUE, MOMENTUM = 0.2, 2.6  # N m and N m s, the most of each wheel
TILT = np.deg2rad(35.0)  # of the wheels' axes from the pyramid's base
CLEAR = np.deg2rad(3.0)  # of both ends from the cones
TELESCOPE, TRACKER = np.array([0.0, 0.0, 1.0]), np.array([0.8, 0.0, -0.6])
AXES = np.array(
    [
        [np.cos(TILT) * np.cos(turn), np.cos(TILT) * np.sin(turn), np.sin(TILT)]
        for turn in np.deg2rad([45, 135, 225, 315])
    ]
)


TUBE = jp.Robust(attitude_error=np.deg2rad(0.4), torque_reserve=15.0, momentum_reserve=10.0)
"""What follows from the controller and the errors of `_wheel_check`.

A loop of 0.1 rad/s that is critically damped halves what it would be off by in the long run where its torque
is wrong at its own frequency, about which slews of a minute speed up and slow down. The array turns the
platform by some 0.23 deg/s^2. Where the inertia is off by 3.5 %, the most in a flight of a middling level,
the flight is then off by 0.035 x 0.23 / 0.1^2 / 2 = 0.40 deg. The momentum that a rate needs is off as the
inertia is, by 5 % and, with products of inertia and what is stored, up to twice that; so is the torque, of
which the controller needs some, too.
"""


def scene(seed: int) -> jp.Scenario:
    """A slew of 40 to 170 deg among four cones of 12 to 30 deg, of which one blocks the straight way."""
    random = np.random.default_rng([290, seed])
    cones: list[tuple[np.ndarray, float]] = []
    while len(cones) < CONES:
        start = Rotation.random(rng=random)
        turn = np.deg2rad(random.uniform(40, 170)) * _drawn(random)
        goal, between = (
            start * Rotation.from_rotvec(share * turn) for share in (1, random.uniform(0.3, 0.7))
        )
        ends = [attitude.apply(sight) for attitude in (start, goal) for sight in (TELESCOPE, TRACKER)]
        cones = []
        for number in range(PATIENCE):
            half = np.deg2rad(random.uniform(12, 30))
            axis = _drawn(random)
            if not cones:  # within half of the cone from where the telescope looks half-way
                axis = between.apply(TELESCOPE) + 0.5 * np.sin(half) * axis
                axis /= np.linalg.norm(axis)
            if max(end @ axis for end in ends) < np.cos(half + CLEAR):
                cones.append((axis, half))
            if len(cones) == CONES or (number == PATIENCE // 2 and not cones):
                break
    stored = random.uniform(-0.2, 0.2, len(AXES)) * MOMENTUM
    craft = jp.Spacecraft(
        terminals=(),
        instruments=(
            jp.Instrument(name="telescope", boresight=TELESCOPE),
            jp.Instrument(name="tracker", boresight=TRACKER),
        ),
        rate_limit=np.deg2rad(10.0),
        acceleration_limit=np.deg2rad(5.0),
        inertia=INERTIA,
        wheels=tuple(
            jp.Wheel(name=f"wheel-{number}", axis=axis, torque=TORQUE, momentum=MOMENTUM, stored=held)
            for number, (axis, held) in enumerate(zip(AXES, stored, strict=True), 1)
        ),
    )
    return jp.Scenario(
        name=f"slew-{seed}",
        spacecraft=craft,
        start=jp.GivenState(rotation_vector=start.as_rotvec(), joints=np.zeros(0)),
        goal=jp.GivenState(rotation_vector=goal.as_rotvec(), joints=np.zeros(0)),
        keep_out=tuple(
            jp.KeepOut(name=f"cone {number}", direction=axis, half_angle=half)
            for number, (axis, half) in enumerate(cones, 1)
        ),
        trajectory=jp.TrajectorySettings(duration="minimum", first_guesses=0),
    )


def _drawn(random: np.random.Generator) -> np.ndarray:
    """A direction (3,), uniform on the sphere."""
    axis = random.standard_normal(3)
    return axis / np.linalg.norm(axis)

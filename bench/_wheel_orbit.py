"""An orbit of the day of links, flown by Basilisk's wheels without errors: what following a file alone costs.

The spacecraft of `case-day` has its rate and acceleration limited; here it has an inertia and four wheels,
too, as in `_wheel_scenes`. Slews and tracks of the first orbit are planned as one motion and written as the
waypoints of a whole file, between which Basilisk's ``waypointReference`` is linear. The controller knows all
as it is, so what is left is the reference's own jumps of rate, and what the loop makes of them.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from _wheel_flight import Craft, Start, fly
from _wheel_scenes import AXES, INERTIA, MOMENTUM, TORQUE

import jaxplan as jp
from jaxplan import so3

ORBIT, SWITCH = 5736.0, 900.0  # s that a satellite takes at 550 km, and between two switches
STEP, FREQUENCY, DAMPING = 0.1, 0.1, 1.0  # s, rad/s, as of the flights with errors
STORED = np.array([0.5, -0.3, 0.2, -0.4])  # N m s in each wheel at the start


def timeline() -> jp.Timeline:
    """The activities of `case-day` that begin within an orbit, of a spacecraft with wheels."""
    whole = jp.example_timeline("case-day")
    wheels = tuple(
        jp.Wheel(name=f"wheel-{number}", axis=axis, torque=TORQUE, momentum=MOMENTUM, stored=float(stored))
        for number, (axis, stored) in enumerate(zip(AXES, STORED, strict=True), 1)
    )
    craft = replace(whole.scene.spacecraft, inertia=INERTIA, wheels=wheels)
    kept = [one for one in whole.activities if one.latest is not None and one.latest < ORBIT + SWITCH]
    scene = replace(whole.scene, spacecraft=craft)
    return replace(whole, scene=scene, activities=tuple(kept), until=kept[-1].latest)


def report() -> None:
    """Plan, write and fly the orbit, and print how far off it was and what the wheels gave."""
    plan = jp.plan_timeline(timeline(), progress=False)
    seconds = plan.trajectory.duration
    first = plan.trajectory.sample([0.0])
    craft = Craft(
        inertia=INERTIA,
        thought=INERTIA,
        axes=AXES,
        torque=np.full(len(AXES), TORQUE),
        momentum=np.full(len(AXES), MOMENTUM),
        frequency=FREQUENCY,
        damping=DAMPING,
        step=STEP,
    )
    begin = Start(
        attitude=np.asarray(so3.log(first.attitude[0])),
        rate=first.angular_velocity[0],
        stored=STORED,
        attitude_noise=0.0,
        rate_noise=0.0,
        seed=1,
    )
    with tempfile.TemporaryDirectory() as folder:
        file = jp.export(plan, Path(folder) / "orbit", format="basilisk", step_s=STEP)
        flown = fly(craft, begin, file, seconds)
    planned = plan.trajectory.sample(np.minimum(flown.times, seconds))
    off = np.rad2deg(so3.distance(np.asarray(planned.attitude), flown.attitude))
    slewing = np.zeros(len(flown.times), bool)
    for one in plan.segments:
        if one.kind == "slew":
            slewing |= (flown.times >= one.start) & (flown.times <= one.end)
    rates = np.rad2deg(np.linalg.norm(flown.rate - np.asarray(planned.angular_velocity), axis=1))
    print(f"{len(plan.activities)} activities in {seconds:.0f} s, slews {slewing.sum() * STEP:.0f} s of it")
    for name, mask in (("slews", slewing), ("tracks", ~slewing)):
        print(f"{name:<8} off by {off[mask].max():.4f} deg and {rates[mask].max():.4f} deg/s at most")
    for name, found, most in (("torque", flown.given, TORQUE), ("momentum", flown.momentum, MOMENTUM)):
        claimed = plan.certificate.peaks["wheel_torques" if name == "torque" else "wheel_momenta"]
        print(f"wheels   {np.max(np.abs(found)) / most:.1%} of their {name}, planned {claimed:.1%}")

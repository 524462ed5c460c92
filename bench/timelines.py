"""Timelines: random ones of random spacecraft, all checked independently, and the day of a link satellite.

`random` draws timelines of 5 to 20 activities for the spacecraft of `any_spacecraft`, some with wheels, a
tube or a zone that moves. Targets are directions in which devices can point, from an attitude that keeps all
zones, and which then turn; or satellites, places on the ground and stars, which may be out of reach. What is
planned is checked in numpy and scipy alone on a grid: zones, masks, ranges, limits, windows, joins, and how
far devices are off their targets. What is refused for a state is checked at the instant that its message
names: 20,000 attitudes that meet the targets, with random angles of the joints that are free; "in doubt"
are those of which one meets all. They are no proof of a wrong refusal, since the activity goes on after that
instant. "broken" and "crashed" must be none.

`ahead` plans random timelines with `look_ahead` and without, in turns, and checks the former likewise: what
slews take in all, how many activities are done, and how many end later. Their tracks last 5 to 60 s; with
`--long` they last six times as long, and no window is waited for.

`day` plans the case `case-day`, and prints time, memory, pointing error and what is proved.

    python bench/timelines.py random [-n 200] [--first-seed 0] [--samples 20000]
    python bench/timelines.py ahead [-n 200] [--first-seed 0] [--long]
    python bench/timelines.py day
"""

import argparse
import re
import resource
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from _machine import print_machine
from _options import not_negative, positive
from scipy.spatial.transform import Rotation

import jaxplan as jp
from jaxplan.cases import any_spacecraft
from jaxplan.cases.paper import example_timeline
from jaxplan.cases.random_kinds import random_angle, random_direction
from jaxplan.model.directions import DirectionPath
from jaxplan.timeline import PlannedActivity
from jaxplan.timeline.pursuit import Pursuit

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # the checks are the tests' own
from dense import joint_limits, shares
from passing import Aim, Orbit, satellite, site
from reference import angle, attitudes_of, in_body, joints_of, spin_of, state_margins, stated_margins

STEP = 5.0  # s between samples of targets, and in which the checks look
TOLERANCE = np.deg2rad(0.01)
ROOM = 200.0  # s that there are for an activity with its slew, on average
OFF = 1e-6  # rad, of what is known of a target from its samples
SHARE = 1 + 1e-4  # of limits, by differences
ROOMY = np.deg2rad(0.2)  # that a state keeps from zones to speak against a refusal
REFUSED = (jp.Status.GOAL_UNREACHABLE, jp.Status.INVALID_GOAL)  # for a state at an instant
LATER = 1e-3  # s, by which the end of an activity is another one
SECONDS = re.compile(r"at (\d+\.\d+) s")

# Drawing timelines.


class Draw:
    """A timeline while it is drawn.

    Args:
        seed: of all draws.
    """

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 41])
        self.drawn = any_spacecraft.draw_scene(self.rng)
        self.count = int(self.rng.integers(5, 21))
        self.until = ROOM * self.count
        self.observer = Orbit(self.rng.uniform(450, 900), *self.rng.uniform(0, 180, 3))
        self.scene = self._scene(seed)

    def timeline(self) -> jp.Timeline:
        """Draw the activities."""
        slew = "calm" if self.rng.uniform() < 0.4 else "shortest"
        activities = tuple(self._activity(number) for number in range(self.count))
        return jp.Timeline(
            name=self.scene.name, scene=self.scene, activities=activities, until=self.until, slew=slew
        )

    def _scene(self, seed: int) -> jp.Scenario:
        """Spacecraft, zones and start; some have wheels, a tube, or a zone that moves."""
        scene = any_spacecraft.draw_scenario(self.drawn, f"random {seed}")
        craft, zones, more = scene.spacecraft, list(scene.keep_out), {}
        if craft.torque_limit is not None and self.rng.uniform() < 0.6:
            axes = np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]]) / np.sqrt(3)
            stored = self.rng.uniform(-2, 2, 4)
            wheels = tuple(
                jp.Wheel(name=f"wheel-{i}", axis=axis, torque=2.0, momentum=12.0, stored=float(own))
                for i, (axis, own) in enumerate(zip(axes, stored, strict=True))
            )
            craft = replace(craft, torque_limit=None, wheels=wheels)
        for number, zone in enumerate(zones):
            if zone.name.startswith("sky") and self.rng.uniform() < 0.4:
                away = Aim(
                    _turning(zone.direction, random_direction(self.rng), random_angle(self.rng, 0, 0.06))
                )
                zones[number] = replace(zone, direction=self._path(away))
                break
        if self.rng.uniform() < 0.15:
            more["robust"] = jp.Robust(attitude_error=np.deg2rad(0.2), joint_error=np.deg2rad(0.1))
        return replace(scene, spacecraft=craft, goal=scene.start, keep_out=tuple(zones), **more)

    def _path(self, aim: Aim) -> DirectionPath:
        """The path of an aim over the whole timeline."""
        times = np.arange(0.0, self.until + STEP, STEP)
        found = DirectionPath.through(times, aim.at(times))
        return replace(found, hidden=aim.hidden)

    def _activity(self, number: int) -> jp.Activity:
        """Draw the activity of a number."""
        rng, middle = self.rng, ROOM * (number + 0.5)
        what = rng.choice(["track", "point", "attitude", "idle"], p=[0.55, 0.12, 0.15, 0.18])
        more: dict = {"name": f"{what} {number + 1}"}
        if rng.uniform() < 0.4:
            more["earliest"] = round(ROOM * (number + rng.uniform(0, 0.5)), 2)
        if what != "point":
            more["duration"] = round(rng.uniform(5, 60), 2)
        if rng.uniform() < 0.1:
            more["latest"] = min(round(ROOM * (number + rng.uniform(1.0, 1.5)), 2), self.until)
        if what == "idle":
            return jp.Activity(idle=True, **more)
        attitude, joints = self._state(middle)
        if what == "attitude":
            held = jp.GivenState(rotation_vector=Rotation.from_matrix(attitude).as_rotvec(), joints=joints)
            return jp.Activity(attitude=held, **more)
        return jp.Activity(**{what: self._targets(attitude, joints, middle)}, **more)

    def _state(self, middle: float) -> tuple[np.ndarray, np.ndarray]:
        """An attitude and joints that keep all zones at a time, s, if twenty draws find one."""
        low, high = self.scene.spacecraft.joint_ranges.T
        for _ in range(20):
            attitude = Rotation.random(rng=self.rng).as_matrix()
            joints = self.rng.uniform(low + any_spacecraft.INSIDE, high - any_spacecraft.INSIDE)
            own = state_margins(self.scene, attitude[None], joints[None], np.array([middle]))
            if all(np.min(margin) > np.deg2rad(2) for margin in own.values()):
                break
        return attitude, joints

    def _targets(self, attitude: np.ndarray, joints: np.ndarray, middle: float) -> jp.Targets:
        """Draw which devices point, and at what."""
        rng, craft = self.rng, self.scene.spacecraft
        chosen = [one.name for one in craft.terminals if rng.uniform() < 0.7]
        for devices, share in ((craft.drives, 0.25), (craft.instruments, 0.5 if chosen else 1.0)):
            if devices and rng.uniform() < share:
                chosen.append(devices[int(rng.integers(len(devices)))].name)
        chosen = chosen or [craft.device_names[0]]
        about, rate = random_direction(rng), random_angle(rng, 0, 0.15)
        targets: dict[str, DirectionPath | np.ndarray] = {}
        for name in chosen:
            now = attitude @ in_body(craft, name, joints[None])[0]
            sort = rng.uniform()
            if sort < 0.7:
                targets[name] = self._path(Aim(_turning(now, about, rate, middle)))
            elif sort < 0.8:
                targets[name] = self._path(satellite(self._neighbour(), self.observer))
            elif sort < 0.9:
                targets[name] = self._path(site(self.observer, middle, rng.uniform(-8, 8), self.until))
            else:
                targets[name] = now
        left = [name for name in craft.device_names if name not in chosen]
        wishes = tuple(
            jp.Wish(device=name, direction=random_direction(rng)) for name in left if rng.uniform() < 0.2
        )
        return jp.Targets.of(targets, tolerance=TOLERANCE, prefer=wishes[:1])

    def _neighbour(self) -> Orbit:
        """Another orbit at the same altitude, some way ahead and beside."""
        own, rng = self.observer, self.rng
        ahead = rng.choice([-1, 1]) * rng.uniform(8, 25)
        return replace(own, node=own.node + rng.uniform(-8, 8), latitude=own.latitude + ahead)


def _turning(first: np.ndarray, about: np.ndarray, rate: float, since: float = 0.0):
    """A function of times, s, to a direction that turns about an axis at a rate, rad/s."""

    def at(time: np.ndarray) -> np.ndarray:
        return Rotation.from_rotvec(np.multiply.outer(rate * (np.asarray(time) - since), about)).apply(first)

    return at


# Checking what is planned.


def broken(plan: jp.TimelinePlan) -> Iterator[str]:
    """Yield what a plan breaks of all that its timeline asks."""
    scene, trajectory = plan.timeline.scene, plan.trajectory
    time_ = np.arange(0.37, trajectory.duration, 1.0)
    bare = replace(scene.spacecraft, wheels=())
    for name, share in shares(trajectory, bare, 2 * len(time_)).items():
        if name != "jerk" and not np.max(np.abs(share), initial=0.0) <= SHARE:
            yield f"{name} is {np.max(np.abs(share)):.6f} of its limit"
    for name, margin in stated_margins(scene, trajectory, time_).items():
        if not np.min(margin) >= -1e-9:
            deep, when = -np.rad2deg(np.min(margin)), time_[np.argmin(margin)]
            yield f"{name} is broken by {deep:.3g} deg at {when:g} s"
    yield from _jumps(plan)
    asked = {one.name: one for one in plan.timeline.activities}
    for done in plan.activities:
        if done.ok and done.name in asked:
            yield from _missed(plan, asked[done.name], done)


def _jumps(plan: jp.TimelinePlan) -> Iterator[str]:
    """Yield where attitude, joints or rates jump between segments."""
    trajectory, beside = plan.trajectory, 1e-6
    for one in plan.segments[1:]:
        pair = one.start + np.array([-beside, beside])
        turn = Rotation.from_matrix(attitudes_of(trajectory, pair))
        joints, rates = joints_of(trajectory, pair, orders=2)
        spin = spin_of(trajectory, pair)[0]
        off = max(
            (turn[0].inv() * turn[1]).magnitude() - np.linalg.norm(spin[0]) * 2 * beside,
            np.max(np.abs(np.diff(joints, axis=0) - 2 * beside * rates[:1]), initial=0.0),
        )
        if not off <= 1e-8:
            yield f"it jumps by {np.rad2deg(off):.3g} deg at {one.start:g} s"


def _missed(plan: jp.TimelinePlan, asked: jp.Activity, done: PlannedActivity) -> Iterator[str]:
    """Yield what an activity misses of its window, its duration, its attitude and its targets."""
    if done.start < (asked.earliest or 0.0) - 1e-9 or done.end > (asked.latest or np.inf) + 1e-9:
        yield f"{done.name} is done from {done.start:g} s to {done.end:g} s, outside of its window"
    if asked.duration is not None and abs(done.end - done.start - asked.duration) > 1e-6:
        yield f"{done.name} takes {done.end - done.start:g} s"
    time_ = np.append(np.arange(done.start, done.end, 0.5), done.end)
    attitudes, joints = attitudes_of(plan.trajectory, time_), joints_of(plan.trajectory, time_, orders=1)[0]
    if asked.attitude is not None:
        turn = Rotation.from_rotvec(asked.attitude.rotation_vector).inv() * Rotation.from_matrix(attitudes)
        if (
            not max(np.max(turn.magnitude()), np.max(np.abs(joints - asked.attitude.joints), initial=0.0))
            < 1e-7
        ):
            yield f"{done.name} is not held"
    if asked.targets is None:
        return
    craft = plan.timeline.scene.spacecraft
    proved = TOLERANCE if done.pointing_error is None else done.pointing_error
    for name, path in zip(asked.targets.names(craft), asked.targets.paths, strict=True):
        toward = np.einsum("kij,kj->ki", attitudes, in_body(craft, name, joints))
        off = float(np.max(angle(toward, path.at(time_))))
        if not off <= min(proved, TOLERANCE) + 1e-9:
            yield f"{done.name}: {name} is off by {np.rad2deg(off):.3g} deg, proved {np.rad2deg(proved):.3g}"


# Checking what is refused.


def states_found(timeline: jp.Timeline, refused: PlannedActivity, samples: int) -> int | None:
    """Number of states that meet all at the instant for which an activity is refused.

    Args:
        timeline: of the activity.
        refused: it.
        samples: number of states that are tried.

    Returns:
        None where it is not refused for a state at an instant.
    """
    asked = next((one for one in timeline.activities if one.name == refused.name), None)
    when = SECONDS.findall(refused.message)
    if asked is None or asked.idle or refused.status not in REFUSED or not when:
        return None
    at, scene = float(when[-1]), timeline.scene
    if asked.attitude is not None:
        attitudes, joints = asked.attitude.attitude[None], asked.attitude.joints[None]
    else:
        attitudes, joints = _states(timeline, asked, at, samples)
    low, high = scene.usable.joint_ranges.T
    good = np.all((joints >= low) & (joints <= high), axis=1)
    room = ROOMY + (
        0.0 if scene.robust is None else scene.robust.attitude_error + 3 * scene.robust.joint_error
    )
    margins = state_margins(scene, attitudes, joints, np.full(len(joints), at)) if len(joints) else {}
    for margin in margins.values():
        good &= margin > room
    if asked.targets is not None:
        good[good] = _slow_enough(timeline, asked, attitudes[good], at)
    return int(np.sum(good))


def _slow_enough(timeline: jp.Timeline, asked: jp.Activity, attitudes: np.ndarray, at: float) -> np.ndarray:
    """Whether the platform can turn as an activity's targets ask of attitudes (k, 3, 3) at a time, s.

    Where they leave it a choice of rates, it can; else the rate is that at which what they ask stays zero.
    """
    craft = timeline.scene.usable
    own = Pursuit.of(craft, timeline.scene.constraints, asked.targets)
    if own.equations < 3 or not len(attitudes):
        return np.ones(len(attitudes), bool)
    _, slopes = own.residuals(attitudes, np.full(len(attitudes), at))
    ahead, behind = (
        own.residuals(attitudes, np.full(len(attitudes), at + side))[0] for side in (0.01, -0.01)
    )
    spins = -(np.linalg.pinv(slopes) @ (ahead - behind)[..., None])[..., 0] / 0.02
    longest = np.inf if craft.rate_norm_limit is None else craft.rate_norm_limit
    within = np.all(np.abs(spins) <= craft.rate_limit, axis=1)
    return within & (np.linalg.norm(spins, axis=1) <= longest)


def _states(
    timeline: jp.Timeline, asked: jp.Activity, at: float, samples: int
) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes and joints, as many as are found of some, that meet an activity's targets at a time, s."""
    scene, craft, rng = timeline.scene, timeline.scene.usable, np.random.default_rng(7)
    own = Pursuit.of(craft, scene.constraints, asked.targets)
    still = Pursuit.of(craft, scene.constraints, asked.targets.at(at))
    time_ = np.zeros(samples)
    low, high = joint_limits(craft)[0].T
    met = still.meeting(Rotation.random(samples, rng=rng).as_matrix(), time_)
    joints = still.joints(met, time_, rng.uniform(low, high, (samples, craft.joint_count)))
    names, toward = asked.targets.names(craft), own.directions(np.array([at]))[0]
    off = np.zeros(samples)
    for name, direction in zip(names, toward, strict=True):
        beams = np.einsum("kij,kj->ki", met, in_body(craft, name, joints))
        off = np.maximum(off, angle(beams, direction))
    good = off <= TOLERANCE
    return met[good], joints[good]


# The two benches.


def random_timelines(count: int, first: int, samples: int) -> None:
    """Plan random timelines, check them, and print what is found."""
    total, error, spent, planned = Counter[str](), 0.0, 0.0, 0
    print(f"{'seed':<6}{'activities':>11}{'OK':>5}{'slew':>10}{'CPU s':>8}{'deg off':>9}  others")
    for seed in range(first, first + count):
        lines: list[str] = []
        began = time.process_time()
        try:
            timeline = Draw(seed).timeline()
            began = time.process_time()
            plan = jp.plan_timeline(timeline, throw=False, go_on=True, progress=False)
        except Exception as fault:
            total["crashed"] += 1
            place = traceback.extract_tb(fault.__traceback__)[-1]
            where = f"{Path(place.filename).name}:{place.lineno}"
            print(f"{seed:<6}crashed: {type(fault).__name__}: {fault} ({where})", flush=True)
            continue
        seconds = time.process_time() - began
        counts = Counter(one.status.name for one in plan.activities)
        worst = max((one.pointing_error or 0.0 for one in plan.activities if one.ok), default=0.0)
        if plan.certificate is not None and not plan.certificate.certified:
            total["uncertified"] += 1
            lines.append(f"  uncertified: {'; '.join(plan.certificate.faults)}")
        for fault in broken(plan) if plan.trajectory is not None else ():
            total["broken"] += 1
            lines.append(f"  broken: {fault}")
        for one in plan.activities:
            if one.ok:
                continue
            lines.append(f"  {one.name}: {one.status.name}: {one.message}")
            states = states_found(timeline, one, samples)
            total["checked refusals"] += states is not None
            if states:
                total["in doubt"] += 1
                lines.append(f"    in doubt: {states} of {samples} states meet all at that time")
        total += counts
        error, spent, planned = max(error, worst), spent + seconds, planned + len(plan.activities)
        others = ", ".join(f"{n} {word}" for word, n in counts.items() if word != "OK")
        print(
            f"{seed:<6}{len(plan.activities):>11}{counts['OK']:>5}{timeline.slew:>10}{seconds:>8.1f}"
            f"{np.rad2deg(worst):>9.1e}  {others}"
        )
        print(*lines, sep="\n", end="\n" if lines else "", flush=True)
    print(
        f"\n{count} timelines, {planned} activities: " + ", ".join(f"{n} {w}" for w, n in total.most_common())
    )
    print(f"worst pointing error {np.rad2deg(error):.2g} deg of {np.rad2deg(TOLERANCE):g} deg")
    print(f"{spent / max(planned, 1):.2f} s of CPU an activity, compiling included")


def ahead(count: int, first: int, *, long: bool) -> None:
    """Plan random timelines with `look_ahead` and without, check the former, and print both side by side."""
    kinds, total, fault_count = (False, True), Counter[tuple[str, bool]](), 0
    print(
        f"{'seed':<6}{'activities':>11}{'slew':>10}{'OK':>5}{'ahead':>7}{'slews s':>10}{'ahead':>9}"
        f"{'led':>5}{'later':>7}{'CPU s':>8}{'ahead':>7}"
    )
    for seed in range(first, first + count):
        timeline = _longer(Draw(seed).timeline()) if long else Draw(seed).timeline()
        plans, spent = {}, Counter[bool]()
        for kind in kinds[:: -1 if seed % 2 else 1]:  # the first of the two compiles most
            began = time.process_time()
            plans[kind] = jp.plan_timeline(
                replace(timeline, look_ahead=kind), throw=False, go_on=True, progress=False
            )
            spent[kind] = time.process_time() - began
        done = {kind: sum(one.ok for one in plans[kind].activities) for kind in kinds}
        slews = {kind: sum(one.slew or 0.0 for one in plans[kind].activities) for kind in kinds}
        led = sum(choice.motion.led for choice in plans[True].choices)
        pairs = zip(*(plans[kind].activities for kind in kinds), strict=False)
        later = sum(one.ok and other.ok and other.end > one.end + LATER for one, other in pairs)
        for kind in kinds:
            total += Counter(
                {("OK", kind): done[kind], ("slews", kind): slews[kind], ("CPU", kind): spent[kind]}
            )
        total += Counter({("led", True): led, ("later", True): later})
        print(
            f"{seed:<6}{len(timeline.activities):>11}{timeline.slew:>10}{done[False]:>5}{done[True]:>7}"
            f"{slews[False]:>10.1f}{slews[True]:>9.1f}{led:>5}{later:>7}{spent[False]:>8.1f}{spent[True]:>7.1f}"
        )
        for fault in broken(plans[True]) if plans[True].trajectory is not None else ():
            fault_count += 1
            print(f"  broken: {fault}")
        sys.stdout.flush()
    print(f"\n{count} timelines, without look_ahead and with it:")
    for what, form in (("OK", "d"), ("slews", ".1f"), ("CPU", ".1f")):
        print(f"{what:<8}{total[what, False]:>10{form}}{total[what, True]:>10{form}}")
    print(f"{total['led', True]} led ahead, {total['later', True]} end later, {fault_count} broken")


def _longer(timeline: jp.Timeline) -> jp.Timeline:
    """A timeline whose tracks last six times as long, and whose windows do not matter."""
    activities = tuple(
        replace(
            one,
            duration=6 * one.duration if one.kind == "track" else one.duration,
            earliest=None,
            latest=None,
        )
        for one in timeline.activities
    )
    return replace(timeline, activities=activities)


def day() -> None:
    """Plan the day of a link satellite and print what it takes."""
    timeline = example_timeline("case-day")
    for words in ("with compiling", "again"):
        began, cpu = time.monotonic(), time.process_time()
        plan = jp.plan_timeline(timeline, throw=False, progress=False)
        wall, cpu = time.monotonic() - began, time.process_time() - cpu
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        parts = ", ".join(f"{name} {seconds:.1f} s" for name, seconds in plan.timings.items())
        print(f"{words:<15} {wall:.1f} s, CPU {cpu:.1f} s ({parts}), memory {memory:.2f} GiB at most")
    print(f"\n{plan}".split("\n\nactivity")[0])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bench", choices=("random", "ahead", "day"))
    parser.add_argument("-n", "--timelines", type=positive, default=200, help="number of them (%(default)s)")
    parser.add_argument("--first-seed", type=not_negative, default=0, help="(%(default)s)")
    parser.add_argument("--samples", type=positive, default=20_000, help="states a refusal (%(default)s)")
    parser.add_argument("--long", action="store_true", help="of `ahead`: tracks last six times as long")
    options = parser.parse_args()
    print_machine()
    if options.bench == "random":
        random_timelines(options.timelines, options.first_seed, options.samples)
    elif options.bench == "ahead":
        ahead(options.timelines, options.first_seed, long=options.long)
    else:
        day()

"""The certificate's verdict on random trajectories, beside that of brute-force sampling.

Zones are drawn, and then opened or closed until the smallest margin that samples find is a wanted one, from
hair's breadths to degrees on either side; around the smallest they are a ten-thousandth as far apart. Samples
only ever see too large a margin, so the certificate must not say yes where they say no, and its bound must
not exceed what they see.
"""

from dataclasses import dataclass, replace

import numpy as np
from manoeuvres import craft, grid, judge, manoeuvre
from reference import boresights_of, random_units, zone_margin

from jaxplan.certificate import MARGIN_ALLOWANCE
from jaxplan.model.spacecraft import Spacecraft
from jaxplan.model.zones import KeepIn, KeepOut
from jaxplan.trajectory import Trajectory

CLEAR = np.deg2rad(0.05)  # from such a margin on the certificate is to say yes
SHARE = 0.99  # of these, at least
SAMPLES = 401
FINER = 100
ROUNDING = 1e-12  # rad

Zone = KeepOut | KeepIn


class Sampler:
    """A trajectory's boresights on a grid, and finer where a margin is smallest."""

    def __init__(self, trajectory: Trajectory, spacecraft: Spacecraft) -> None:
        self.trajectory, self.spacecraft = trajectory, spacecraft
        self.times = grid(trajectory, SAMPLES)
        self.seen = boresights_of(trajectory, spacecraft, self.times)

    def least(self, zone: Zone) -> float:
        """The smallest margin of a zone, rad."""
        times, margins = self.times, zone_margin(zone, self.spacecraft, self.seen)
        found = float(margins.min())
        for _ in range(2):
            best = int(np.argmin(margins))
            first, last = times[max(best - 1, 0)], times[min(best + 1, len(times) - 1)]
            times = np.linspace(first, last, 2 * FINER + 1)
            margins = zone_margin(
                zone, self.spacecraft, boresights_of(self.trajectory, self.spacecraft, times)
            )
            found = min(found, float(margins.min()))
        return found


@dataclass(frozen=True, kw_only=True)
class Case:
    """A trajectory among zones, and the smallest margin that samples find, rad."""

    trajectory: Trajectory
    spacecraft: Spacecraft
    zones: list[Zone]
    least: float


def case(seed: int) -> Case:
    """A third of the cases is broken, and of the others half are clear by `CLEAR` or more."""
    rng = np.random.default_rng([seed, 8])
    terminals = int(rng.choice([0, 1, 1, 2, 2, 3, 4]))
    spacecraft = craft(terminals, instruments=int(rng.integers(0 if terminals else 1, 3)))
    trajectory = manoeuvre(
        int(rng.integers(2**31)),
        terminals=terminals,
        pieces=int(rng.integers(1, 5)),
        joint_pieces=int(rng.integers(1, 4)),
        duration=float(10 ** rng.uniform(1, 2.5)),
        wiggle=float(rng.uniform(0, 0.5)),
        step=float(rng.uniform(0.05, 0.6)),
    )
    sampler = Sampler(trajectory, spacecraft)
    zones, least, lowest = [], np.inf, -1.3 if seed % 3 == 2 else -6
    while len(zones) < 1 + seed % 4:
        wanted = float(np.deg2rad(10 ** rng.uniform(lowest, 1)))
        if seed % 3 == 0 and not zones:
            wanted = -wanted
        zone = tuned(random_zone(rng, spacecraft.device_names, len(zones)), sampler, wanted)
        if 0.005 < zone.half_angle < 3.135:
            zones.append(zone)
            least = min(least, wanted)
    return Case(trajectory=trajectory, spacecraft=spacecraft, zones=zones, least=least)


def random_zone(rng: np.random.Generator, devices: tuple[str, ...], number: int) -> Zone:
    """For some of the devices, of a size that is to be tuned."""
    names = np.array(devices)[rng.permutation(len(devices))[: rng.integers(1, len(devices) + 1)]]
    kind = KeepOut if rng.random() < 0.6 else KeepIn
    return kind(name=f"z{number}", direction=random_units(rng), half_angle=1.0, devices=tuple(names.tolist()))


def tuned(zone: Zone, sampler: Sampler, wanted: float) -> Zone:
    """The zone with another half angle, by which samples find the wanted margin, rad."""
    side = 1 if isinstance(zone, KeepOut) else -1
    return replace(zone, half_angle=float(zone.half_angle + side * (sampler.least(zone) - wanted)))


def attempt(seed: int) -> str:
    """One verdict; its kind in a word. Raises where the certificate says yes and samples say no."""
    found = case(seed)
    report = judge(found.trajectory, found.spacecraft, found.zones)
    assert report.min_margin is not None, report.faults
    assert report.min_margin <= found.least + ROUNDING, "the bound is above a sample"
    if report.certified:
        assert found.least >= -MARGIN_ALLOWANCE, "yes where samples say no"
    if found.least >= CLEAR:
        return "clear, yes" if report.certified else "clear, no"
    if found.least >= 0:
        return "narrow, yes" if report.certified else "narrow, no"
    return "broken"

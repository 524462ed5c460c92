"""The real sky: where Sun, Moon, Earth and satellites are at an epoch, and keep-out zones from that.

    >>> from jaxplan import sky
    >>> here = sky.parse_tle(open("mine.tle").read())
    >>> zone = sky.keep_out("sun", epoch="2026-03-20T12:00:00", observer=here, exclusion_deg=30.0)
    >>> sky.path("earth", epoch="2026-03-20T12:00:00", observer=here, duration_s=80.0)  # of a zone that moves
    >>> sky.directions("moon", epoch="2026-03-20T12:00:00", observer=here, times=[0.0, 40.0, 80.0])

Conventions. Axes are those of the GCRS, which are those of J2000 (EME2000) to 1.2e-7 rad; positions are in km
from the Earth's centre, times in SI seconds after an epoch in UTC. Two-line elements are propagated by SGP4
in its frame TEME and rotated into these axes. The observer and what is looked at may each be a satellite, a
point of the ground, a body's name (``"sun"``, ``"moon"``, ``"earth"``) or a position. What is looked at may
also be ``"nadir"``, ``"zenith"``, ``"ram"`` or ``"orbit_normal"``, which are directions that depend on the
observer's own motion.

Directions are geometric: where the other is at that instant. Left out are light time and aberration. These
displace the Sun by up to 1.0e-4 rad (0.006 deg) for the Earth's motion, and everything by up to 2.6e-5 rad
for that of a satellite in low orbit. The Moon is good to 1e-4 rad, the Sun to 1e-6; a satellite of two-line
elements to about 1 km at their epoch, and several km more for each day since.

The package needs the extra ``orbit``: pyerfa for bodies and frames, sgp4 for two-line elements; for ephemeris
messages also the extra ``oem``, for kernels of SPICE ``spice``.
"""

from jaxplan.sky.body_zones import keep_out, path
from jaxplan.sky.ephemeris import Ephemeris, EphemerisError, read_oem
from jaxplan.sky.frames import BODIES, RADII
from jaxplan.sky.ground import GroundPoint
from jaxplan.sky.line_of_sight import Occulter, hidden, occulter, target
from jaxplan.sky.orbits import CircularOrbit, KeplerOrbit
from jaxplan.sky.passes import Pass, passes
from jaxplan.sky.sights import (
    LOCAL,
    Satellite,
    angular_radius,
    direction_rates,
    directions,
    drift,
    local_axes,
    positions,
    velocities,
)
from jaxplan.sky.spk import SpkBody, read_spk
from jaxplan.sky.two_line_elements import StaleTleWarning, Tle, TleError, parse_tle

__all__ = [
    "BODIES",
    "LOCAL",
    "RADII",
    "CircularOrbit",
    "Ephemeris",
    "EphemerisError",
    "GroundPoint",
    "KeplerOrbit",
    "Occulter",
    "Pass",
    "Satellite",
    "SpkBody",
    "StaleTleWarning",
    "Tle",
    "TleError",
    "angular_radius",
    "direction_rates",
    "directions",
    "drift",
    "hidden",
    "keep_out",
    "local_axes",
    "occulter",
    "parse_tle",
    "passes",
    "path",
    "positions",
    "read_oem",
    "read_spk",
    "target",
    "velocities",
]

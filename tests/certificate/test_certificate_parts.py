"""The certificate's tools: jets, majorants, errors of interpolation and rounding, Bernstein bounds."""

from dataclasses import replace
from math import comb, factorial

import numpy as np
import pytest
from manoeuvres import craft
from numpy.polynomial import legendre
from reference import assert_each
from scipy.spatial.transform import Rotation
from wheels import wheels

from jaxplan.certificate import Claim, bounds, limits, series
from jaxplan.certificate.bounds import Errors, Evidence, Layout, Minima, Rows
from jaxplan.certificate.margins import Bindings
from jaxplan.certificate.motion import DEGREE, NODES, Motion, Mountings, Views, Way
from jaxplan.certificate.series import ROUNDING, Pieces
from jaxplan.model import limits as model
from jaxplan.model.directions import DirectionPath
from jaxplan.model.tabulation import tabulate
from jaxplan.model.zones import KeepIn, KeepOut

RNG = np.random.default_rng
LONG = np.longdouble
INERTIA = np.array([[120.0, 5, -3], [5, 80, 2], [-3, 2, 150]])


def random_motion(seed, terminals=2, instruments=1, degree=12, size=0.3, duration=60.0):
    """Random polynomials on two pieces, with jumps between them, of terminals mounted in any way."""
    rng = RNG(seed)
    decay = 1 / (1 + np.arange(degree + 1))[:, None]
    breaks = np.array([0, 0.4, 1]) * duration
    fixed = rng.normal(size=(instruments, 3))
    return Motion(
        platform=Pieces.of((breaks, size * decay * rng.normal(size=(2, degree + 1, 3)))),
        joints=Pieces.of((breaks, size * decay * rng.normal(size=(2, degree + 1, 2 * terminals)))),
        chart_attitude=Rotation.random(2, random_state=seed).as_matrix(),
        chart_start=breaks[:-1],
        chart_rate=rng.normal(size=(2, 3)) / duration,
        mountings=Mountings(
            axes=Rotation.random(terminals, random_state=seed).as_matrix(), tilts=np.zeros(0)
        ),
        fixed_boresights=fixed / np.linalg.norm(fixed, axis=1, keepdims=True),
    )


def straight(breaks, platform, joints, rate=(0.0, 0.0, 0.0)):
    """One terminal and no instrument, in charts that all begin at the same attitude."""
    pieces = len(breaks) - 1
    return Motion(
        platform=Pieces.of((breaks, platform)),
        joints=Pieces.of((breaks, joints)),
        chart_attitude=np.repeat(np.eye(3)[None], pieces, axis=0),
        chart_start=breaks[:-1],
        chart_rate=np.tile(rate, (pieces, 1)),
        mountings=mounted([0.0]),
        fixed_boresights=np.zeros((0, 3)),
    )


def cut(motion, parts):
    """Its pieces, cut at equal times besides."""
    breaks = motion.platform.breaks()
    return motion.between(np.union1d(np.linspace(0, breaks[-1], parts + 1), breaks))


def gathered(motion, on, **changes):
    """All that is known on intervals, but for what is given."""
    majorants = bounds.majorants(motion, on)
    found = Evidence(
        on=on,
        samples=motion.sample(on),
        majorants=majorants,
        left_out=bounds.interpolation(on, majorants),
        rounding=bounds.rounding(motion, on, majorants),
    )
    return replace(found, **changes)


def without_errors(motion, on):
    """What would be known if nothing were left out or rounded."""
    found = gathered(motion, on)
    none = Errors(**{name: 0 * size for name, size in vars(found.left_out).items() if size is not None})
    return replace(found, left_out=none, rounding=none)


def every_limit(stored=0.0, allocation="pseudo_inverse"):
    """Limits of every kind, also of those that no file may hold together."""
    array = wheels(np.array([[1, 0, 0], [0, 0.6, 0.8], [0, -0.6, 0.8], [0.6, 0.8, 0]]), 1.0, 9.0, stored)
    loads = {"torque_limit": 1.0, "wheel_momentum_limit": 1.0, "wheels": array, "allocation": allocation}
    return craft(2, joints={}, jerk_limit=1.0, inertia=INERTIA, **loads)


def hat(v):
    """Cross-product matrices (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    rows = ((0 * x, -z, y), (z, 0 * x, -x), (-y, x, 0 * x))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def exponential(v):
    """Rotation matrices by Rodrigues' formula, of real or complex vectors of any precision."""
    square = np.sum(v * v, axis=-1)[..., None, None]
    square = np.where(square == 0, 1, square)  # times zero below
    angle = np.sqrt(square)
    return (
        np.eye(3) + np.sin(angle) / angle * hat(v) + 2 * np.sin(angle / 2) ** 2 / square * (hat(v) @ hat(v))
    )


def gimbal_angles(motion, joints):
    """Azimuth and elevation (k, T + D) of joints (k, 2T + D) of any precision."""
    tilts = motion.mountings.tilts
    count = len(motion.mountings.axes) - len(tilts)
    yaws, pitches, angles = np.split(joints, [count, 2 * count], axis=1)
    return np.hstack([yaws, angles]), np.hstack([pitches, 0 * angles + tilts])


def mounted(terminals=(), drives=0, seed=0):
    """Terminals at angles about z, and drives about any axes with any tilts."""
    turns = Rotation.concatenate(
        [Rotation.from_euler("z", np.reshape(terminals, (-1, 1))), Rotation.random(drives, random_state=seed)]
    )
    tilts = RNG(seed).uniform(-1.2, 1.2, drives)
    return Mountings(axes=np.swapaxes(turns.as_matrix(), 1, 2), tilts=tilts)


def curve(motion, piece, time, kind=LONG):
    """Attitudes (k, 3, 3), joints (k, 2T) and boresights (k, D, 3) by definition, also at complex times."""
    first, last = motion.platform.breaks()[piece : piece + 2].astype(kind)
    x = 2 * (time - first) / (last - first) - 1
    b, joints = (
        legendre.legval(x, p.derivatives[piece, :, 0].astype(kind)).T
        for p in (motion.platform, motion.joints)
    )
    chart = (time - motion.chart_start[piece])[:, None] * motion.chart_rate[piece].astype(kind)
    half = exponential(chart / 2)
    attitude = motion.chart_attitude[piece].astype(kind) @ half @ exponential(b - chart) @ half
    azimuth, elevation = gimbal_angles(motion, joints)
    level = np.cos(elevation)
    own = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)
    moving = np.einsum("gij,kgi->kgj", motion.mountings.axes, own)
    fixed = np.broadcast_to(motion.fixed_boresights, (len(time), *motion.fixed_boresights.shape))
    return attitude, joints, np.concatenate([moving, fixed], axis=1) @ np.swapaxes(attitude, 1, 2)


def in_body(motion, joints):
    """All sights (k, S, 3) in body axes, of joints (k, 2T) of any precision, by turns about joints' axes."""
    azimuth, elevation = gimbal_angles(motion, joints)
    upward, backward = np.array([0, 0, 1]), np.array([0, -1, 0])
    turn = exponential(azimuth[..., None] * upward) @ exponential(elevation[..., None] * backward)
    turn = np.swapaxes(motion.mountings.axes, 1, 2) @ turn
    fixed = np.broadcast_to(motion.fixed, (len(joints), *motion.fixed.shape))
    carried = np.einsum("kvij,vj->kvi", turn[:, motion.views.carrier], motion.views.carried)
    return np.concatenate([turn[..., 0], fixed, carried], axis=1)


def looks(motion, piece, time, kind=LONG):
    """What is seen within the body (k, looks, 1) or, from its axes, (k, looks, 3), and sights, inertial."""
    attitude, joints, _ = curve(motion, piece, time, kind)
    sights = in_body(motion, joints)
    pairs, axes = motion.views.within[motion.views.within[:, 1] >= 0].T
    single = motion.views.within[motion.views.within[:, 1] < 0, 0]
    products = np.sum(sights[:, pairs] * sights[:, axes], axis=-1, keepdims=True)
    return products, sights[:, single], sights @ np.swapaxes(attitude, 1, 2)


def taylor(motion, piece, time, half, orders, curve=curve):
    """Taylor coefficients of `curve` in the unit `half`, by Cauchy's integral, and their errors."""
    shrink = 1.5  # the smaller circle, where the functions are smaller too
    angles = np.arctan2(LONG(0), LONG(-1)) / 32 * np.arange(64)
    results = []
    for values in curve(motion, piece, time + half / shrink * np.exp(1j * angles), np.clongdouble):
        scale = (LONG(shrink) ** np.arange(orders)).reshape(-1, *[1] * (values.ndim - 1))
        coefficients = (np.fft.fft(values, axis=0) / 64)[:orders].real * scale
        results.append((coefficients, 1e-14 * np.abs(values).max() * scale.ravel()))
    return results


def test_jets_of_products_and_exponentials_are_those_of_power_series():
    rng = RNG(0)
    a, b = rng.normal(size=(2, 7, 5))
    product = series.product("n,n->n", a, b)
    for n in range(5):
        assert product[:, n] == pytest.approx(np.polymul(a[::-1, n], b[::-1, n])[::-1][:7])
    assert series.slope(a)[:, 0] == pytest.approx(np.polynomial.polynomial.polyder(a[:, 0]))
    line = np.array([[0.3], [2.0], *[[0.0]] * 5])
    exact = np.exp(0.3) * np.array([2.0**k / factorial(k) for k in range(7)])
    assert series.exponential(line)[:, 0] == pytest.approx(exact, rel=1e-15)
    assert series.exponential(a + b) == pytest.approx(
        series.product("n,n->n", series.exponential(a), series.exponential(b))
    )


def test_quaternions_are_those_of_scipy_at_any_angle():
    rng = RNG(1)
    axes = rng.normal(size=(9, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.array([0, 1e-12, 1e-8, 1e-4, 1, np.pi - 1e-11, np.pi, 2 * np.pi, 19.9])
    jet = np.zeros((3, 3, 9))
    jet[0] = (axes * angles[:, None]).T
    matrices = np.moveaxis(series.rotation(series.quaternion(jet)[0]), -1, 0)
    assert np.abs(matrices - Rotation.from_rotvec(axes * angles[:, None]).as_matrix()).max() < 3e-12
    assert np.abs(matrices[:8] - Rotation.from_rotvec(axes * angles[:, None]).as_matrix()[:8]).max() < 3e-15
    np.testing.assert_array_equal(series.quaternion(1.01 * jet)[..., 8], np.nan)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="needs extended precision")
def test_samples_are_those_of_the_definition_to_far_less_than_the_allowances():
    factorials = np.array([factorial(k) for k in range(5)])[:, None] * LONG(2) ** np.arange(5)[:, None]
    for seed in range(6):
        motion = random_motion(seed, size=(0.02, 0.5, 1.0)[seed % 3])
        on = cut(motion, 19)
        samples = motion.sample(on)
        stated = bounds.rounding(motion, on, bounds.majorants(motion, on))
        for n, m in np.ndindex(samples.time.shape):
            if (n + m) % 5:
                continue
            (r, _), (joints, _), (boresights, _) = taylor(motion, on.piece[n], samples.time[n, m], 0.5, 5)
            r, joints = r * factorials[..., None], joints * factorials
            back = np.swapaxes(r, 1, 2)
            # w^ = R^T R', and its derivatives by the product rule.
            skew = np.stack(
                [
                    back[0] @ r[1],
                    back[1] @ r[1] + back[0] @ r[2],
                    back[2] @ r[1] + 2 * back[1] @ r[2] + back[0] @ r[3],
                ]
            )
            spin = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
            off = np.linalg.norm(samples.spin[:, :, n, m] - spin, axis=1)
            assert_each(off, "<=", stated.spin[:, n])
            assert_each(off, "<=", 1e-12 * np.abs(samples.spin).max(axis=(1, 2, 3)))
            off = np.abs(samples.joints[:3, :, n, m] - joints[:3])
            assert_each(off, "<=", stated.joints[:, :, n])
            assert_each(off, "<=", 1e-12 * np.abs(samples.joints[:3]).max(axis=(1, 2, 3))[:, None])
            off = np.linalg.norm(samples.boresights[:, :, n, m] - boresights[0], axis=1)
            assert_each(off, "<=", stated.direction[:, n])
            assert_each(off, "<=", 1e-14)
            assert np.abs(samples.attitude[:, :, n, m] - r[0]).max() <= 1e-14


@pytest.mark.parametrize("parts", [9, 30])
def test_majorants_bound_taylor_coefficients_anywhere_on_an_interval(parts):
    looseness = []
    for seed in range(4):
        motion = random_motion(10 + seed, degree=6, size=(0.05, 0.3)[seed % 2])
        on = cut(motion, parts)
        majorants = bounds.majorants(motion, on)
        orders, rng = len(majorants.spin), RNG(seed)
        for n in rng.integers(len(on.half), size=4):
            for place in (-1, rng.uniform(-1, 1), 1):
                time, half = on.centre[n] + place * on.half[n], on.half[n]
                curves = taylor(motion, on.piece[n], time, half, orders + 1)
                (attitude, noise), (joints, joint_noise), (boresights, boresight_noise) = curves
                slope = attitude[1:] * np.arange(1, orders + 1)[:, None, None]
                skew = [sum(attitude[i].T @ slope[k - i] for i in range(k + 1)) for k in range(orders)]
                spin = np.array([np.linalg.norm([m[2, 1], m[0, 2], m[1, 0]]) for m in skew])
                assert_each(spin, "<=", majorants.spin[:, n] + 30 * noise[:orders])
                sizes = np.linalg.norm(boresights[:orders], axis=-1)
                assert_each(sizes, "<=", majorants.direction[:orders, :, n] + boresight_noise[:orders, None])
                sizes = np.abs(joints[:orders])
                assert_each(sizes, "<=", majorants.joints[:orders, :, n] + joint_noise[:orders, None])
                looseness.append(majorants.spin[0, n] / spin[0])
    assert min(looseness) < 1.5  # they are not bounds for being enormous


def bernstein_basis(degree, place):
    """(degree + 1, k) of the Bernstein polynomials on [-1, 1]."""
    u = (1 + np.asarray(place)) / 2
    return np.stack([comb(degree, j) * u**j * (1 - u) ** (degree - j) for j in range(degree + 1)])


@pytest.mark.parametrize("parts", [6, 12, 40])
def test_polynomials_through_samples_are_off_by_no_more_than_stated(parts):
    share = {}
    for seed in range(3):
        spacecraft = every_limit([0.0, 5.0, -8.0][seed], ("pseudo_inverse", "minimax")[seed % 2])
        motion = random_motion(20 + seed, size=0.1)
        on = cut(motion, parts)
        place = np.linspace(-1, 1, 41)
        through = bounds.to_bernstein(DEGREE).T @ bernstein_basis(DEGREE, place)
        curves = []
        for samples in (motion.sample(on), motion.sample(on, place)):
            evidence = gathered(motion, on, samples=samples)
            left_out, rounding = evidence.left_out, evidence.rounding
            found = {
                q.name: (q.values, q.left_out, q.rounding) for q in limits.quantities(spacecraft, evidence)
            }
            boresights = np.moveaxis(samples.boresights, 1, 0), left_out.direction, rounding.direction
            curves.append(found | {"boresights": boresights})
        for name, (values, missed, noise) in curves[0].items():
            exact = curves[1][name][0]
            off = np.abs(values @ through - exact).max(axis=-1)
            conversion = ROUNDING * bounds.growth(DEGREE) * np.abs(exact).max(axis=-1)
            stated = missed + bounds.LEBESGUE * noise + conversion
            assert_each(off, "<=", stated, name)
            share[name] = max(share.get(name, 0), np.max(off / stated))
    assert len(share) == 12
    assert min(share.values()) > {6: 0, 12: 3e-5, 40: 1e-3}[parts], share  # the bounds have the right size


def test_errors_go_with_the_unit_of_time():
    """What is stated of the same motion eight times as slow is the same in the new unit, to rounding."""
    spacecraft = every_limit()
    derivatives = {"angular_velocity": 1, "angular_acceleration": 2, "jerk": 3, "joint_rates": 1}
    derivatives |= {"joint_accelerations": 2, "yaw": 0, "pitch": 0, "torque": 2, "wheel_momentum": 1}
    derivatives |= {"wheel_torques": 2, "wheel_momenta": 1}
    found = []
    for slower in (1.0, 8.0):
        motion = random_motion(50, size=0.1, duration=60.0 * slower)
        evidence = gathered(motion, cut(motion, 30))
        limited = {q.name: q for q in limits.quantities(spacecraft, evidence)}
        assert limited.keys() == derivatives.keys()
        found.append((evidence.left_out.direction, evidence.rounding.direction, evidence.majorants, limited))
    once, slow = found
    for own, other in zip(once[:2], slow[:2], strict=True):
        np.testing.assert_allclose(other, own, rtol=1e-9)
    for name in ("turning", "direction", "spin", "joints"):
        np.testing.assert_allclose(getattr(slow[2], name), getattr(once[2], name), rtol=1e-9, atol=1e-300)
    for name, order in derivatives.items():
        own, other = once[3][name], slow[3][name]
        for part in ("left_out", "rounding"):
            np.testing.assert_allclose(8.0**order * getattr(other, part), getattr(own, part), rtol=1e-9)


def test_rounding_of_the_torque_is_what_that_of_the_rates_makes_of_it():
    spacecraft = craft(2, joints={}, torque_limit=1.0, inertia=INERTIA)
    motion, rng = random_motion(51), RNG(51)
    exactly = without_errors(motion, cut(motion, 120))
    samples = exactly.samples
    for sizes in ((1e-6, 1e-12), (1e-12, 1e-6)):  # of the velocity, of the acceleration
        size = np.array([*sizes, 0.0])[:, None]
        rounding = replace(exactly.rounding, spin=exactly.rounding.spin + size)

        def torque(spin, rounding=rounding):
            evidence = replace(exactly, samples=replace(samples, spin=spin), rounding=rounding)
            return next(q for q in limits.quantities(spacecraft, evidence) if q.name == "torque")

        exact, off = torque(samples.spin), 0.0
        for _ in range(100):
            noise = rng.normal(size=samples.spin.shape)
            noise *= size[..., None, None] / np.linalg.norm(noise, axis=1, keepdims=True)
            moved = np.abs(torque(samples.spin + noise).values - exact.values).max(axis=-1)
            off = np.maximum(off, moved / exact.rounding)
        assert 0.1 < off.max() <= 1 + 1e-5


INSTRUMENT = 3  # where the instrument, which stands still, is among what is looked at within the body below


def motion_with_views(seed, **changes):
    """Two terminals, an instrument, two axes of the body, three vectors of moving parts, and many looks."""
    rng, motion = RNG(seed), random_motion(seed, **changes)
    body, carried = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 3, 3)))
    pairs = [[0, -1], [0, 1], [1, 3], [2, -1], [5, -1], [5, 0], [6, 5], [7, 2], [7, 6]]
    views = Views(body=body[:2], carrier=np.array([1, 0, 1]), carried=carried, within=np.array(pairs))
    return replace(motion, views=views)


def in_order(motion, products, single):
    """Scalar products and what is seen from axes of the body, (looks, ...) each, in the order of `within`."""
    found = [None] * len(motion.views.within)
    of_axes = motion.views.within[:, 1] < 0
    for place, one in zip(np.flatnonzero(~of_axes), products, strict=True):
        found[place] = one
    for place, one in zip(np.flatnonzero(of_axes), single, strict=True):
        found[place] = one
    return found


@pytest.mark.parametrize("parts", [9, 30])
def test_majorants_bound_what_is_seen_within_the_body(parts):
    for seed in range(4):
        motion = motion_with_views(60 + seed, degree=6, size=(0.05, 0.3)[seed % 2])
        on = cut(motion, parts)
        direction = bounds.majorants(motion, on).direction
        orders, rng = len(direction), RNG(seed)
        assert direction.shape[1] == 8 + 9
        for n in rng.integers(len(on.half), size=4):
            for place in (-1, rng.uniform(-1, 1), 1):
                time, half = on.centre[n] + place * on.half[n], on.half[n]
                found = taylor(motion, on.piece[n], time, half, orders, looks)
                products, single, inertial = (
                    np.moveaxis(np.linalg.norm(value, axis=-1) - noise[:, None], 0, 1)
                    for value, noise in found
                )
                sizes = np.stack([*inertial, *in_order(motion, products, single)], axis=1)
                assert_each(sizes, "<=", direction[..., n])
                assert_each(direction[1:, 8 + INSTRUMENT, n], "==", 0)


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="needs extended precision")
def test_sights_in_body_axes_are_those_of_the_definition_to_the_stated_rounding():
    for seed in range(4):
        motion = motion_with_views(70 + seed, size=(0.02, 1.0)[seed % 2])
        on = cut(motion, 11)
        samples = motion.sample(on)
        stated = bounds.rounding(motion, on, bounds.majorants(motion, on)).direction
        for n in range(len(on.half)):
            _, joints, _ = curve(motion, on.piece[n], samples.time[n].astype(LONG))
            exact = np.moveaxis(in_body(motion, joints), 0, -1)
            off = np.linalg.norm(samples.in_body[:, :, n] - exact, axis=1).max(axis=1)
            assert_each(off, "<=", 1e-14)
            for (sight, axis), most in zip(motion.views.within, stated[8:, n], strict=True):
                assert off[sight] + (0 if axis < 0 else off[axis]) <= most <= 1e-13


@pytest.mark.parametrize("parts", [6, 12, 40])
def test_polynomials_of_what_is_seen_within_the_body_are_off_by_no_more_than_stated(parts):
    place = np.linspace(-1, 1, 41)
    through = bounds.to_bernstein(DEGREE).T @ bernstein_basis(DEGREE, place)
    share = np.zeros(9)
    for seed in range(3):
        motion = motion_with_views(80 + seed, size=0.1)
        on = cut(motion, parts)
        majorants = bounds.majorants(motion, on)
        left_out = bounds.interpolation(on, majorants).direction[8:]
        noise = bounds.rounding(motion, on, majorants).direction[8:]
        axis = np.array([0.48, 0.6, 0.64])
        values = []
        for samples in (motion.sample(on), motion.sample(on, place)):
            sights = np.moveaxis(samples.in_body, 1, -1)
            first = [sights[i] for i, _ in motion.views.within]
            other = [axis if i < 0 else sights[i] for _, i in motion.views.within]
            values.append([np.sum(a * b, axis=-1) for a, b in zip(first, other, strict=True)])
        off = np.abs(np.stack(values[0]) @ through - np.stack(values[1])).max(axis=-1)
        stated = left_out + bounds.LEBESGUE * noise + ROUNDING * bounds.growth(DEGREE)
        assert_each(off, "<=", stated)
        share = np.maximum(share, (off / stated).max(axis=1))
    assert_each(share, ">", {6: 1e-5, 12: 3e-3, 40: 3e-3}[parts], share)  # the bounds have the right size


@pytest.mark.parametrize("tight", ["direction", "spin", "joints"])
def test_intervals_are_cut_until_so_little_is_left_out_and_no_finer(tight):
    motion = random_motion(52, size=0.1)
    sizes = {"direction": np.ones((3, 1)), "spin": np.ones((3, 1)), "joints": np.ones((3, 4, 1))}
    wanted = Errors(**{name: ones * (1e-9 if name == tight else 1e99) for name, ones in sizes.items()})
    evidence = bounds.gather(motion, wanted)
    shares = {name: np.max(getattr(evidence.left_out, name) / getattr(wanted, name)) for name in sizes}
    assert max(shares.values()) == shares[tight] <= 1
    edges = np.append(evidence.on.centre - evidence.on.half, 60.0)
    on = motion.between(np.union1d(edges[::3], motion.platform.breaks()))  # two thirds of the cuts left out
    coarse = getattr(bounds.interpolation(on, bounds.majorants(motion, on)), tight)
    assert np.max(coarse) > 1e-9


@pytest.mark.parametrize(("pieces", "excess"), [(1, 3.5), (3000, 1.5)])
def test_intervals_are_as_many_as_the_order_of_the_error_asks_for(pieces, excess):
    """Of joints whose next derivative is constant and the same on every piece; many pieces are cut, too."""
    basis = np.zeros((pieces, DEGREE + 2, 2))
    basis[:, -1] = 1.0
    breaks = np.linspace(0, 60, pieces + 1)
    motion = straight(breaks, np.zeros((pieces, DEGREE + 2, 3)), basis)
    on = motion.between(breaks)
    most = bounds.interpolation(on, bounds.majorants(motion, on)).joints[0].max()
    joints = np.array([[most / excess ** (DEGREE + 1)] * 2, [1e99] * 2, [1e99] * 2])[..., None]
    wanted = Errors(direction=np.full((1, 1), 1e99), spin=np.full((3, 1), 1e99), joints=joints)
    evidence = bounds.gather(motion, wanted)
    assert len(evidence.on.centre) == pieces * np.ceil(excess)
    assert_each(evidence.left_out.joints[0], "<=", joints[0, 0])


def test_rounding_of_what_is_almost_still_is_a_few_units_of_its_own_size():
    rate, angles = np.array([0.03, -0.02, 0.06]), np.array([0.7, -0.3])
    joints = np.stack([angles, 0 * angles])[None]
    motion = straight(np.array([0.0, 60.0]), np.zeros((1, 2, 3)), joints, rate)
    on = motion.between(np.array([0.0, 20.0, 60.0]))
    stated = bounds.rounding(motion, on, bounds.majorants(motion, on))
    # Of the rate: its own, and twice that of the attitude, both of a majorant that counts the chart's turn
    # there and back; of the angles: those of the sum and of the sample.
    np.testing.assert_allclose(stated.spin[0], 3 * ROUNDING * 2 * np.linalg.norm(rate), rtol=1e-12)
    np.testing.assert_allclose(stated.joints[0].T, [2 * ROUNDING * np.abs(angles)] * 2, rtol=1e-12)


def test_conversion_to_bernstein_coefficients_is_counted_into_peaks():
    motion = random_motion(54)
    evidence = gathered(motion, motion.between(motion.platform.breaks()))
    values, none = np.stack([np.full((2, DEGREE + 1), value) for value in (0.25, 1.0, 0.5)]), np.zeros(2)
    torque = model.limits(craft(0, inertia=INERTIA, torque_limit=np.full(3, 2.0)))[-1]
    quantity = limits.Limited(torque, values, none, none, torque.bound)
    room = limits.prove([quantity], evidence)
    ratios = np.array([0.125, 0.5, 0.25])
    lost = 1 - ratios - room.bound
    assert lost == pytest.approx(ROUNDING * bounds.growth(DEGREE) * ratios, rel=0.3, abs=0)


def test_a_limit_of_which_no_proof_is_known_is_not_passed_over(monkeypatch):
    spacecraft, motion = craft(0, inertia=INERTIA, torque_limit=1.0), random_motion(54)
    evidence = gathered(motion, motion.between(motion.platform.breaks()))
    torque = next(quantity for quantity in model.QUANTITIES if quantity.name == "torque")
    unknown = replace(torque, name="magnetic_moment")
    assert unknown.given(spacecraft) == 1.0
    monkeypatch.setattr(model, "QUANTITIES", (unknown,))
    with pytest.raises(KeyError, match="magnetic_moment"):
        limits.quantities(spacecraft, evidence)


def test_a_margin_that_a_cap_settles_is_less_by_the_rounding_of_the_boresight():
    spacecraft = craft(1, instruments=0)
    motion = random_motion(55, terminals=1, instruments=0, size=1e-9)  # next to none
    motion = replace(
        motion, chart_rate=1e-9 * motion.chart_rate, chart_attitude=motion.chart_attitude[[0, 0]]
    )
    exactly = without_errors(motion, motion.between(motion.platform.breaks()))
    away = np.cross(exactly.samples.boresights[0, :, 0, 0], [0.3, 0.2, 0.9])  # at a right angle
    for kind, angles in ((KeepOut, (0.3, 1.5)), (KeepIn, (2.0, 1.6))):  # the second one decides
        zones = [
            kind(name="z", direction=away / np.linalg.norm(away), half_angle=angle, devices=("terminal-0",))
            for angle in angles
        ]
        zones = (zones, []) if kind is KeepOut else ([], zones)
        bindings = Bindings.of(tabulate(*zones, spacecraft), 1)
        found = []
        for noise in (0.0, 0.01):
            rounding = replace(exactly.rounding, direction=exactly.rounding.direction + noise)
            evidence = replace(exactly, rounding=rounding)
            found.append(float(bindings.prove(evidence).bound[0]))
        # Of a chord, which at a right angle changes by less than the angle.
        assert found[0] - found[1] == pytest.approx(0.01 * np.sqrt(2), rel=0.1)


def test_conversion_to_bernstein_coefficients_is_counted_into_margins():
    spacecraft = craft(1, instruments=0)
    motion = random_motion(57, terminals=1, instruments=0, size=0.0)
    motion = replace(motion, chart_rate=0 * motion.chart_rate, chart_attitude=motion.chart_attitude[[0, 0]])
    evidence = without_errors(motion, motion.between(motion.platform.breaks()))
    majorants = evidence.majorants
    majorants = replace(majorants, direction=np.ones_like(majorants.direction))  # so that no cap settles it
    evidence = replace(evidence, majorants=majorants)
    boresight = evidence.samples.boresights[0, :, 0, 0]
    for angle in (0.5, 1.5):
        sideways = np.cross(boresight, [0.3, 0.2, 0.9])
        axis = np.cos(angle) * boresight + np.sin(angle) * sideways / np.linalg.norm(sideways)
        zone = KeepOut(name="z", direction=axis, half_angle=0.1, devices=spacecraft.device_names)
        minima = Bindings.of(tabulate([zone], [], spacecraft), 1).prove(evidence)
        # Of the squared chord, whose slope is twice the sine of the angle.
        off = ROUNDING * bounds.growth(DEGREE) * 2 * (1 - np.cos(angle)) / (2 * np.sin(angle))
        assert angle - 0.1 - minima.bound[0] == pytest.approx(off, rel=0.3, abs=0)


@pytest.mark.parametrize(("seen", "said"), [(-0.05, "breach"), (0.0, "no proof"), (0.05, "no proof")])
def test_faults_say_which_device_is_where_it_must_not_be(seen, said):
    motion, names = random_motion(56, terminals=1, instruments=1), ("terminal-0", "instrument-0")
    out = KeepOut(name="Sun", direction=np.array([0, 0, 1.0]), half_angle=0.3, devices=names[:1])
    inside = KeepIn(name="station", direction=np.array([0, 1.0, 0]), half_angle=0.3, devices=names[1:])
    minima = Minima(bound=np.full(2, -0.1), seen=np.full(2, seen), time=np.array([3.0, 4.0]))
    cones = tabulate([out], [inside], craft(1))
    claim = Claim(
        trajectory=None,
        spacecraft=craft(1),
        cones=cones,
        zone_names=("Sun", "station"),
        start=None,
        goal=None,
    )
    found = list(Bindings.of(cones, 1).faults(np.arange(2), minima, motion, claim, 1e-6))
    expected = {
        "breach": [
            "terminal-0 is 2.86 deg inside the keep-out zone Sun at t = 3 s",
            "instrument-0 is 2.86 deg outside the keep-in zone station at t = 4 s",
        ],
        "no proof": [
            f"the margin of {device} to the {kind} zone {zone} is not proved: "
            f"{np.rad2deg(seen):.3g} deg was met at t = {time} s, the bound is -5.73 deg"
            for device, kind, zone, time in (
                ("terminal-0", "keep-out", "Sun", 3),
                ("instrument-0", "keep-in", "station", 4),
            )
        ],
    }[said]
    assert found == expected


def test_intervals_stay_within_the_pieces_of_axes_that_move():
    motion = random_motion(53, size=0.01)
    times = np.array([-5.0, 7.0, 31.0, 55.0, 70.0])
    samples = np.array([[1, 0, 0], [1, 0.1, 0], [1, 0.2, 0.1], [1, 0.2, 0.3], [1, 0, 0.4]])
    way = Way.of(DirectionPath.through(times, samples / np.linalg.norm(samples, axis=1, keepdims=True)))
    loose = Errors(
        direction=np.full((3, 1), 1e99), spin=np.full((3, 1), 1e99), joints=np.full((3, 4, 1), 1e99)
    )
    on = bounds.gather(motion, loose, [way]).on
    edges = np.append(on.centre - on.half, on.centre[-1] + on.half[-1])
    np.testing.assert_allclose(edges, [0, 7, 24, 31, 55, 60], atol=1e-12)
    seen, still = (
        bounds.rounding(motion, on, bounds.majorants(motion, on, ways), ways).direction
        for ways in ([way], [])
    )
    np.testing.assert_allclose(seen - still, [way.rounding(on.centre, on.half)] * len(seen), rtol=1e-6)


@pytest.mark.parametrize("duration", [0.5, 20.0])
def test_the_bound_of_what_is_left_out_is_attained(duration):
    """By a turn about one axis so small that it is linear, and joints, whose next derivative is constant."""
    through = bounds.to_bernstein(DEGREE).T @ bernstein_basis(DEGREE, np.linspace(-1, 1, 401))
    for order in range(3):
        degree = DEGREE + 1 + order
        basis = 1e-16 * np.eye(degree + 2)[..., None]
        turning, sweeping = basis[None, degree + 1] * [0, 1, 0], basis[None, degree] * [1, 0]
        motion = straight(np.array([0, duration]), turning, sweeping)
        on = motion.between(np.array([0, duration]))
        left_out = bounds.interpolation(on, bounds.majorants(motion, on))
        for stated, place, times in (
            (left_out.spin[order, 0], degree + 1, order + 1),
            (left_out.joints[order, 0, 0], degree, order),
        ):
            series = legendre.legder(basis[place, :, 0], times) * (2 / duration) ** times
            exact = legendre.legval(np.linspace(-1, 1, 401), series)
            off = np.abs(legendre.legval(NODES, series) @ through - exact).max()
            assert 0.9 * stated <= off <= (1 + 1e-9) * stated


def test_stated_errors_are_counted_into_margins_and_peaks():
    spacecraft = craft(2)
    motion = random_motion(40, size=0.05)
    motion = replace(motion, chart_rate=0.1 * motion.chart_rate, chart_attitude=motion.chart_attitude[[0, 0]])
    exactly = without_errors(motion, cut(motion, 60))
    samples, none = exactly.samples, exactly.rounding
    # Zones, one wider than a right angle, that two devices just touch.
    axes, half_angles = [], []
    for device, apart in enumerate((1.0, 2.5)):
        boresight = samples.boresights[device, :, 30, 0]
        sideways = np.cross(boresight, [0.3, 0.2, 0.9])
        axes.append(np.cos(apart) * boresight + np.sin(apart) * sideways / np.linalg.norm(sideways))
        half_angles.append(np.arccos(np.einsum("i,inm->nm", axes[device], samples.boresights[device])).min())
    assert half_angles[1] > np.pi / 2
    zones = [
        KeepOut(name=name, direction=axis, half_angle=angle, devices=(name,))
        for name, axis, angle in zip(spacecraft.device_names, axes, half_angles, strict=False)
    ]
    bindings = Bindings.of(tabulate(zones, [], spacecraft), 2)

    def proved(left_out, rounding):
        evidence = replace(exactly, left_out=left_out, rounding=rounding)
        room = limits.prove(limits.quantities(spacecraft, evidence), evidence)
        return np.cos(bindings.prove(evidence).bound + half_angles), room.bound

    cosine, room = proved(none, none)
    # Limits are 9, but for pitches, and margins almost zero. Polynomials of cosines are off by as much as
    # boresights are.
    left_out = Errors(direction=none.direction + 1e-3, spin=none.spin + 0.09, joints=none.joints + 0.18)
    raised, lowered = proved(left_out, none)
    lost = np.array([0.01] * 6 + [0.02] * 10 + [0.18 / spacecraft.joint_ranges[2, 1]] * 2)
    assert room - lowered == pytest.approx(lost, abs=1e-5)
    assert raised - cosine == pytest.approx(np.array([1e-3, 1e-3]), rel=0.05)
    # Rounding moves the samples, and so a chord, and with it the cosine, by less.
    raised, lowered = proved(none, left_out)
    assert room - lowered == pytest.approx(bounds.LEBESGUE * lost, abs=1e-5)
    chords = 2 * np.array([np.sin(half_angles[0] / 2), np.cos(half_angles[1] / 2)])
    assert raised - cosine == pytest.approx(bounds.LEBESGUE * 1e-3 * chords, rel=0.15)


@pytest.mark.parametrize("degree", [4, 8, 10])
def test_bernstein_coefficients_give_back_the_polynomial(degree):
    nodes, place = -np.cos(np.pi * np.arange(degree + 1) / degree), np.linspace(-1, 1, 33)
    polynomials = RNG(2).normal(size=(20, degree + 1))
    values = np.stack([np.polynomial.polynomial.polyval(nodes, p) for p in polynomials])
    coefficients = bounds.to_rows(values).T
    wanted = np.stack([np.polynomial.polynomial.polyval(place, p) for p in polynomials])
    assert coefficients @ bernstein_basis(degree, place) == pytest.approx(wanted, abs=1e-13)
    np.testing.assert_array_equal(coefficients[:, [0, -1]], values[:, [0, -1]])
    assert bounds.growth(degree) == pytest.approx({4: 35 / 3, 8: 1287 / 7, 10: 46189 / 63}[degree], rel=1e-9)
    exact = [[comb(j, i) * 2**i for i in range(degree + 1)] for j in range(degree + 1)]  # of ((1 + x) / 2)^i
    powers = np.array(exact) / [comb(degree, i) * 2**i for i in range(degree + 1)]
    shifted = np.stack([((1 + nodes) / 2) ** i for i in range(degree + 1)])
    assert shifted @ bounds.to_bernstein(degree).T == pytest.approx(powers.T, abs=1e-12)


def random_rows(rng, layout, tasks, degree):
    """Random polynomials for some clauses, one after the other in time, and their values on a grid."""
    clauses = np.sort(rng.integers(len(layout.quantity), size=tasks))
    kind = np.concatenate([np.flatnonzero(layout.clause == c) for c in clauses])
    coefficients = rng.normal(size=(len(kind), degree + 1)).cumsum(axis=1)
    low = np.arange(tasks, dtype=float)
    rows = Rows(
        coefficients=coefficients.T.copy(), error=np.zeros(len(kind)), kind=kind, low=low, high=low + 1
    )
    return rows, clauses, coefficients @ bernstein_basis(degree, np.linspace(-1, 1, 4001))


def brute(layout, kind, values):
    """Least value of each task by Python loops: the best entry's worst row."""
    tasks, row = [], 0
    while row < len(kind):
        entries = []
        first = True
        while row < len(kind) and (first or not layout.opens_clause[kind[row]]):
            if layout.opens_entry[kind[row]]:
                entries.append(values[row])
            else:
                entries[-1] = np.minimum(entries[-1], values[row])
            row, first = row + 1, False
        tasks.append(np.max(entries, axis=0))
    return np.array(tasks)


LAYOUTS = {
    "single rows": Layout(
        opens_entry=np.ones(5, bool),
        opens_clause=np.ones(5, bool),
        quantity=np.array([0, 0, 1, 2, 2]),
        owner=np.zeros(5, int),
    ),
    "groups": Layout(
        opens_entry=np.array([1, 0, 1, 1, 1, 0, 0, 1, 1], bool),
        opens_clause=np.array([1, 0, 0, 1, 1, 0, 0, 0, 1], bool),
        quantity=np.array([0, 0, 0, 1]),
        owner=np.zeros(4, int),
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("shift", [-3.0, 0.0, 8.0])
def test_minima_are_bounds_and_tight_for_what_decides(name, shift):
    layout = LAYOUTS[name]
    for seed in range(20):
        rows, clauses, values = random_rows(RNG(seed), layout, 30, DEGREE)
        rows.coefficients[:] += shift
        table = brute(layout, rows.kind, values + shift)
        minima = Minima.of(len(layout.quantity))
        bounds.minimise(rows, layout, minima, lambda x, _: x, lambda x: np.full_like(x, 1e-6))
        exact = np.array([table[clauses == c].min(initial=np.inf) for c in range(len(layout.quantity))])
        assert_each(minima.bound, "<=", exact + 1e-12)
        for clause, quantity in enumerate(layout.quantity):
            least = exact[layout.quantity == quantity].min()
            if exact[clause] in (least, np.inf) or exact[clause] < 0:
                assert minima.bound[clause] >= exact[clause] - 2e-3  # the grid misses a little, most at kinks
            else:
                assert minima.bound[clause] >= min(max(least, 0), exact[clause]) - 2e-3
            met = [  # at the time that is named, on the intervals that hold it
                brute(
                    layout,
                    rows.kind,
                    rows.coefficients.T @ bernstein_basis(DEGREE, [2 * (minima.time[clause] - t) - 1]),
                )[t, 0]
                for t in np.flatnonzero(clauses == clause)
                if t <= minima.time[clause] <= t + 1
            ]
            assert len(met) == 0 or min(abs(np.array(met) - minima.seen[clause])) < 1e-9


def test_an_error_of_a_row_lowers_its_bound_by_as_much():
    layout = LAYOUTS["single rows"]
    rows, _, _ = random_rows(RNG(3), layout, 30, DEGREE)
    found = []
    for error in (0.0, 0.25):
        minima = Minima.of(5)
        rows.error[:] = error
        bounds.minimise(rows, layout, minima, lambda x, _: x, lambda x: np.full_like(x, 1e-9))
        found.append(minima)
    low = found[0].seen < 0
    assert found[1].bound[low] == pytest.approx(found[0].bound[low] - 0.25, abs=1e-8)
    assert found[1].seen[low] == pytest.approx(found[0].seen[low], abs=1e-8)  # what is met is not lowered


@pytest.mark.parametrize("most_rows", [50, 1000])
def test_work_is_bounded_and_the_bound_remains_one(monkeypatch, most_rows):
    monkeypatch.setattr(bounds, "_MOST_ROWS", most_rows)
    layout = LAYOUTS["single rows"]
    rows, clauses, values = random_rows(RNG(4), layout, 30, DEGREE)
    exact = np.array([values[clauses == c].min() for c in range(5)])
    minima = Minima.of(5)
    bounds.minimise(
        rows, layout, minima, lambda x, _: x, lambda x: np.full_like(x, -1e9)
    )  # never good enough
    assert_each(minima.bound, "<=", exact + 1e-12)
    assert_each(minima.bound, ">=", exact - (9 if most_rows == 50 else 1e-3))


def test_a_bound_of_what_is_not_a_number_is_not_a_number(monkeypatch):
    monkeypatch.setattr(bounds, "_MOST_ROWS", 10_000)
    layout = LAYOUTS["groups"]
    rows, _, _ = random_rows(RNG(5), layout, 30, DEGREE)
    rows.coefficients[3, 7] = np.nan
    minima = Minima.of(len(layout.quantity))
    with np.errstate(invalid="ignore"):
        bounds.minimise(rows, layout, minima, lambda x, _: x, lambda x: np.full_like(x, 1e-6))
    assert np.isnan(minima.bound[layout.clause[rows.kind[7]]])

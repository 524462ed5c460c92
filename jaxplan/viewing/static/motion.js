// The motion, evaluated from the polynomials that are certified: docs/flight.md has the formula.
"use strict";

const Motion = (() => {
  // The number of the piece that a time (s) is in; at a break the later one.
  function pieceAt(breaks, time) {
    let low = 0, high = breaks.length - 2;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (breaks[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  }

  // The polynomial of a piece, each of its components; powers rise.
  function polynomial(curve, time) {
    const k = pieceAt(curve.breaks_s, time);
    const begin = curve.breaks_s[k], end = curve.breaks_s[k + 1];
    const x = end > begin ? 2 * (time - begin) / (end - begin) - 1 : -1;
    const powers = curve.powers_rad[k];
    const found = powers[powers.length - 1].slice();
    for (let i = powers.length - 2; i >= 0; i--) {
      for (let c = 0; c < found.length; c++) found[c] = found[c] * x + powers[i][c];
    }
    return { piece: k, value: found };
  }

  // The quaternion, scalar first, of a rotation vector (rad).
  function exponential(vector) {
    const angle = Math.hypot(...vector);
    const factor = angle < 1e-8 ? 0.5 : Math.sin(angle / 2) / angle;
    return [Math.cos(angle / 2), ...vector.map((part) => factor * part)];
  }

  function product(a, b) {
    return [
      a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
      a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
      a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
      a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ];
  }

  // Attitude (body to inertial, scalar first) and joints (rad) at a time, s; held before and after the motion.
  function at(motion, wanted) {
    const time = Math.min(Math.max(wanted, 0), motion.duration_s);
    const { piece, value } = polynomial(motion.platform, time);
    const chart = motion.charts[motion.platform.chart[piece]];
    const turned = chart.rate_rad_s.map((rate) => rate * (time - chart.start_s));
    const half = exponential(turned.map((part) => part / 2));
    const rest = exponential(value.map((part, i) => part - turned[i]));
    const attitude = product(product(product(chart.quaternion, half), rest), half);
    const joints = motion.joints.names.length ? polynomial(motion.joints, time).value : [];
    return { attitude, joints };
  }

  // The unit vector along a path's cubic at a time, s; a path that stands still has one sample.
  function direction(path, time) {
    const times = path.times_s;
    if (times.length === 1) return path.samples[0];
    const known = Math.min(Math.max(time, times[0]), times[times.length - 1]);
    const k = pieceAt(times, known);
    const h = times[k + 1] - times[k], s = (known - times[k]) / h;
    const [p, q, m, n] = [path.samples[k], path.samples[k + 1], path.slopes[k], path.slopes[k + 1]];
    const found = p.map((_, c) =>
      (1 + 2 * s) * (1 - s) ** 2 * p[c] + s * (1 - s) ** 2 * h * m[c]
      + s * s * (3 - 2 * s) * q[c] + s * s * (s - 1) * h * n[c]);
    const length = Math.hypot(...found);
    return found.map((part) => part / length);
  }

  return { at, direction, pieceAt };
})();

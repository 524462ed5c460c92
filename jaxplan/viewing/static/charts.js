// Curves beneath the picture: margins, rates over their limits, joints; a cursor that follows the time.
"use strict";

const Charts = (() => {
  const LEFT = 46, RIGHT = 8, TOP = 18, BOTTOM = 18;
  let data, charts = [], ink = {};

  function colours() {
    const style = getComputedStyle(document.documentElement);
    ["--ink", "--faint", "--rule", "--bad"].forEach((name) => { ink[name] = style.getPropertyValue(name).trim(); });
  }

  // A colour (#rrggbb) as it is drawn: lighter on dark ground.
  function shade(colour) {
    if (document.documentElement.dataset.theme !== "dark") return colour;
    const parts = [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
    return `rgb(${parts.map((part) => Math.round(part + 0.35 * (255 - part))).join(",")})`;
  }

  function start(given, onSeek) {
    data = given;
    data.charts.forEach((chart) => {
      const figure = document.createElement("figure");
      const canvas = document.createElement("canvas");
      const legend = document.createElement("figcaption");
      const needle = document.createElement("div");  // at the time; the curves stay as they are painted
      needle.className = "needle";
      figure.append(canvas, needle, legend);
      document.getElementById("charts").append(figure);
      const own = { chart, canvas, needle, hidden: new Set() };
      chart.lines.forEach((one, number) => {
        const entry = document.createElement("button");
        entry.type = "button";
        entry.title = `show or hide ${one.name}`;
        entry.innerHTML = '<i></i><span class="name"></span><b></b>';
        entry.querySelector("i").style.background = one.dashes  // as its curve is drawn
          ? `repeating-linear-gradient(90deg, ${one.colour} 0 5px, transparent 5px 8px)` : one.colour;
        entry.querySelector(".name").textContent = one.name;
        entry.addEventListener("click", () => {
          if (own.hidden.has(number)) own.hidden.delete(number); else own.hidden.add(number);
          entry.classList.toggle("off", own.hidden.has(number));
          paint(own);
          cursor(own, own.time || 0);
        });
        legend.append(entry);
      });
      own.values = [...legend.querySelectorAll("b")].map((element) => ({ element, text: "" }));
      const seek = (event) => {
        const box = canvas.getBoundingClientRect();
        onSeek(Math.min(Math.max((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT), 0), 1) * data.motion.duration_s);
      };
      canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); seek(event); });
      canvas.addEventListener("pointermove", (event) => { if (event.buttons) seek(event); });
      charts.push(own);
    });
    window.addEventListener("resize", repaint);
  }

  function span(own) {
    let low = Infinity, high = -Infinity;
    own.chart.lines.forEach((one, number) => {
      if (own.hidden.has(number)) return;
      for (const value of one.values) {
        if (value !== null) { low = Math.min(low, value); high = Math.max(high, value); }
      }
    });
    if (own.chart.floor !== null) low = Math.min(low, own.chart.floor);
    if (own.chart.limit !== null) high = Math.max(high, own.chart.limit);
    if (!(high > low)) { high = (Number.isFinite(high) ? high : 0) + 1; low = high - 2; }
    const pad = 0.06 * (high - low);
    return [low - pad, high + pad];
  }

  function ticks(low, high, most) {
    const raw = (high - low) / most, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((times) => times * power).find((wide) => wide >= raw);
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push(v);
    return { found, places: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  function paint(own) {
    const { canvas, chart } = own, ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    own.needle.style.top = `${TOP}px`;
    own.needle.style.height = `${height - TOP - BOTTOM}px`;
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = "12px system-ui, sans-serif";
    const [low, high] = span(own), duration = Math.max(data.motion.duration_s, 1e-9);
    const x = (time) => LEFT + (width - LEFT - RIGHT) * time / duration;
    const y = (value) => TOP + (height - TOP - BOTTOM) * (high - value) / (high - low);
    own.x = x;
    pen.fillStyle = ink["--ink"];
    pen.textBaseline = "middle";
    pen.fillText(chart.title, LEFT, 8);
    pen.strokeStyle = ink["--rule"];
    pen.lineWidth = 1;
    pen.fillStyle = ink["--faint"];
    const up = ticks(low, high, Math.max(2, height / 34));
    pen.textAlign = "right";
    up.found.forEach((value) => {
      pen.beginPath(); pen.moveTo(LEFT, y(value)); pen.lineTo(width - RIGHT, y(value)); pen.stroke();
      pen.fillText(value.toFixed(up.places), LEFT - 5, y(value));
    });
    const scale = duration > 7200 ? [3600, "h"] : duration > 600 ? [60, "min"] : [1, "s"];
    const along = ticks(0, duration / scale[0], Math.max(3, width / 90));
    pen.textAlign = "center";
    along.found.forEach((value, i) => {
      const last = i === along.found.length - 1 ? ` ${scale[1]}` : "";
      pen.fillText(value.toFixed(along.places) + last, Math.min(x(value * scale[0]), width - 22), height - 8);
    });
    pen.textAlign = "left";
    if (chart.limit !== null && chart.limit >= low && chart.limit <= high) {
      pen.strokeStyle = ink["--bad"];
      pen.lineWidth = 1.5;
      pen.beginPath(); pen.moveTo(LEFT, y(chart.limit)); pen.lineTo(width - RIGHT, y(chart.limit)); pen.stroke();
    }
    chart.lines.forEach((one, number) => {
      if (own.hidden.has(number)) return;
      pen.strokeStyle = shade(one.colour);
      pen.lineWidth = 1.6;
      pen.setLineDash(one.dashes ? [5, 3] : []);
      pen.beginPath();
      one.values.forEach((value, i) => {  // null is a gap
        if (value === null) return;
        if (i && one.values[i - 1] !== null) pen.lineTo(x(data.times_s[i]), y(value));
        else pen.moveTo(x(data.times_s[i]), y(value));
      });
      pen.stroke();
    });
    pen.setLineDash([]);
  }

  function at(times, values, time) {
    const k = Motion.pieceAt(times, time);
    const share = times[k + 1] > times[k] ? Math.min(Math.max((time - times[k]) / (times[k + 1] - times[k]), 0), 1) : 0;
    if (values[k] === null || values[k + 1] === null) return null;
    return values[k] + share * (values[k + 1] - values[k]);
  }

  // Nothing here asks how large anything is, which would have the browser lay out the page in every frame.
  function cursor(own, time) {
    own.time = time;
    own.needle.style.transform = `translateX(${own.x(time)}px)`;
    own.chart.lines.forEach((one, number) => {
      const value = at(data.times_s, one.values, time), place = own.values[number];
      const text = value === null ? "\u2013" : one.scale
        ? `${(value * one.scale / 100).toFixed(one.places)} ${one.unit} (${value.toFixed(0)} %)`
        : `${value.toFixed(one.places)} ${one.unit}`;
      if (text !== place.text) place.element.textContent = place.text = text;
    });
  }

  function repaint() { colours(); charts.forEach(paint); charts.forEach((own) => cursor(own, own.time || 0)); }

  return { start, repaint, show: (time) => charts.forEach((own) => cursor(own, time)) };
})();

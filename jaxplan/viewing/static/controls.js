// Time, play, keys and pointer: what a person does with the page.
"use strict";

const Viewer = (() => {
  const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800];
  const byId = (id) => document.getElementById(id);
  let data, time = 0, playing = false, speed = 2, last = null, named = true, dirty = true;
  const spent = [];

  function format(seconds) {
    if (data.motion.duration_s < 600) return `${seconds.toFixed(2)} s`;
    const h = Math.floor(seconds / 3600), m = Math.floor(seconds / 60) % 60, s = Math.floor(seconds % 60);
    return [h, m, s].map((part) => String(part).padStart(2, "0")).join(":");
  }

  function clock(seconds) {
    if (!data.epoch_ms) return "";
    return `${new Date(data.epoch_ms + 1000 * seconds).toISOString().slice(0, 19).replace("T", " ")} UTC`;
  }

  function seek(wanted) {
    time = Math.min(Math.max(wanted, 0), data.motion.duration_s);
    dirty = true;
  }

  const told = {};
  function say(id, text) {
    if (told[id] !== text) byId(id).textContent = told[id] = text;
  }

  function refresh() {
    World.show(time);
    Charts.show(time);
    byId("slider").value = time;
    say("time", `${format(time)} of ${format(data.motion.duration_s)}`);
    say("clock", clock(time));
    const own = data.motion.segments.find((segment) => time <= segment.end_s) || null;
    say("segment", own ? `${own.kind}: ${own.name}` : "");
    dirty = false;
  }

  function frame(now) {
    const began = performance.now();
    if (playing && last !== null) {
      seek(time + (now - last) / 1000 * SPEEDS[speed]);
      if (time >= data.motion.duration_s) play(false);
    }
    last = now;
    if (dirty) refresh();
    World.draw();
    document.documentElement.dataset.ready = "true";  // for whoever takes a picture of the page
    spent.push(performance.now() - began);
    if (spent.length > 600) spent.shift();
    requestAnimationFrame(frame);
  }

  function play(on) {
    if (on && time >= data.motion.duration_s) seek(0);
    playing = on;
    byId("play").textContent = on ? "Pause" : "Play";
    byId("play").setAttribute("aria-pressed", on);
  }

  function setSpeed(number) {
    speed = Math.min(Math.max(number, 0), SPEEDS.length - 1);
    byId("speed").textContent = `${SPEEDS[speed]}\u00d7`;
  }

  function setTheme(name) { World.setTheme(name); Charts.repaint(); dirty = true; }

  function toggleBody() {
    World.follow(!World.followsBody());
    byId("frame").textContent = World.followsBody() ? "Body axes" : "Inertial axes";
    dirty = true;
  }

  function step(share) { play(false); seek(time + share * data.motion.duration_s); }

  const KEYS = {
    " ": () => play(!playing),
    ArrowLeft: (event) => step(event.shiftKey ? -0.001 : -0.01),
    ArrowRight: (event) => step(event.shiftKey ? 0.001 : 0.01),
    Home: () => seek(0),
    End: () => seek(data.motion.duration_s),
    "+": () => setSpeed(speed + 1),
    "=": () => setSpeed(speed + 1),
    "-": () => setSpeed(speed - 1),
    b: toggleBody,
    t: () => setTheme(World.theme() === "light" ? "dark" : "light"),
    l: () => { named = !named; World.labels(named); },
    r: () => { World.home(); dirty = true; },
    "?": () => byId("help").toggleAttribute("hidden"),
    Escape: () => byId("help").setAttribute("hidden", ""),
  };

  function listen() {
    byId("slider").max = data.motion.duration_s;
    byId("slider").step = data.motion.duration_s / 10000 || 1;
    byId("slider").addEventListener("input", () => seek(Number(byId("slider").value)));
    byId("play").addEventListener("click", () => play(!playing));
    byId("slower").addEventListener("click", () => setSpeed(speed - 1));
    byId("faster").addEventListener("click", () => setSpeed(speed + 1));
    byId("frame").addEventListener("click", toggleBody);
    byId("theme").addEventListener("click", () => KEYS.t());
    byId("reset").addEventListener("click", () => KEYS.r());
    byId("keys").addEventListener("click", () => KEYS["?"]());
    window.addEventListener("keydown", (event) => {
      const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.target.tagName === "BUTTON" && event.key === " ") return;  // which presses it
      event.preventDefault();
      act(event);
    });
    const hint = byId("hint");
    World.canvas().addEventListener("pointermove", (event) => {
      const told = event.buttons ? "" : World.toldAt(event);
      hint.textContent = told;
      hint.hidden = !told;
      const box = byId("stage").getBoundingClientRect();
      hint.style.left = `${Math.min(event.clientX - box.left + 14, box.width - 240)}px`;
      hint.style.top = `${event.clientY - box.top + 14}px`;
    });
    World.canvas().addEventListener("pointerleave", () => { hint.hidden = true; });
  }

  function addSegments() {
    const bar = byId("segments");
    if (!data.motion.segments.length) { bar.remove(); return; }
    const kinds = [...new Set(data.motion.segments.map((own) => own.kind))];
    data.motion.segments.forEach((own) => {
      const part = document.createElement("i");
      part.style.left = `${100 * own.start_s / data.motion.duration_s}%`;
      part.style.width = `${100 * (own.end_s - own.start_s) / data.motion.duration_s}%`;
      part.className = `kind${kinds.indexOf(own.kind) % 5}`;
      part.title = `${own.kind}: ${own.name}, ${format(own.start_s)} to ${format(own.end_s)}`;
      part.addEventListener("click", () => seek(own.start_s));
      bar.append(part);
    });
  }

  function start(three, given) {
    data = given;
    byId("name").textContent = data.name;
    byId("status").textContent = data.status;
    World.start(three, data);
    Charts.start(data, (wanted) => { play(false); seek(wanted); });
    addSegments();
    listen();
    const long = data.motion.duration_s / 40;  // so that all of it takes some forty seconds at most
    const fits = SPEEDS.findIndex((each) => each >= long);
    setSpeed(fits < 0 ? SPEEDS.length - 1 : Math.max(fits, 2));
    const asked = new URLSearchParams(location.search).get("theme") || (location.hash === "#dark" ? "dark" : "");
    setTheme(asked || (window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
    Charts.repaint();
    frame(performance.now());  // at once, so that no picture of the page is without the sphere
  }

  return {
    start, seek, play,
    // For checks from outside: ms of script in each of the last frames; matrices at a time.
    spent: (anew) => { const found = spent.slice(); if (anew) spent.length = 0; return found; },
    at: (wanted) => { seek(wanted); refresh(); return World.matrices(); },
  };
})();

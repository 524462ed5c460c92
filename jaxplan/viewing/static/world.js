// What turns: the sphere of directions with zones, the platform with its devices, beams and their trails.
"use strict";

const World = (() => {
  const RADIUS = 1, SIZE = 0.13;  // of the sphere of directions; half an edge of the platform's cube
  const THEMES = {
    light: { ground: 0xffffff, sphere: 0xdfe4ea, grid: 0xb9c2cc, body: 0x8d99a6, ink: "#1c2430", axis: 0x5b6672 },
    dark: { ground: 0x10151c, sphere: 0x2a3441, grid: 0x3d4a5a, body: 0x9aa7b5, ink: "#e8edf3", axis: 0x93a1b0 },
  };
  let THREE, data, renderer, scene, camera, caster;
  const eye = { azimuth: 0, elevation: 0, distance: 3 };  // rad, rad, radii of the sphere
  let platform, world, zones = [], devices = [], trails = [], picks = [], labels = [], coloured = [], spot;
  let inBody = false, theme = "light", width = 1, height = 1, named = true, changed = true;

  // A material in a colour of its own, lighter on dark ground so that it is seen there.
  function tinted(material, colour) {
    coloured.push(() => {
      material.color.set(colour);
      if (theme === "dark") material.color.lerp(new THREE.Color("#ffffff"), 0.35);
    });
    return material;
  }

  const vector = (a) => new THREE.Vector3(a[0], a[1], a[2]);

  function line(points, material, closed) {
    const geometry = new THREE.BufferGeometry().setFromPoints(points);
    return closed ? new THREE.LineLoop(geometry, material) : new THREE.Line(geometry, material);
  }

  // A cap about +z with its edge; the area is what a pointer finds.
  function cap(halfAngle, colour, radius, edgeDashes, filled) {
    const group = new THREE.Group();
    const around = 96, edge = [];
    for (let i = 0; i <= around; i++) {
      const a = 2 * Math.PI * i / around;
      edge.push(new THREE.Vector3(
        radius * Math.sin(halfAngle) * Math.cos(a), radius * Math.sin(halfAngle) * Math.sin(a),
        radius * Math.cos(halfAngle)));
    }
    const material = tinted(edgeDashes
      ? new THREE.LineDashedMaterial({ dashSize: 0.03, gapSize: 0.02 })
      : new THREE.LineBasicMaterial(), colour);
    const rim = line(edge, material, false);
    if (edgeDashes) rim.computeLineDistances();
    group.add(rim);
    const geometry = new THREE.SphereGeometry(radius, 48, 24, 0, 2 * Math.PI, 0, halfAngle);
    geometry.rotateX(Math.PI / 2);  // three.js has the pole along y
    const area = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      color: colour, transparent: true, opacity: filled, side: THREE.DoubleSide, depthWrite: false,
    }));
    group.add(area);
    group.userData.area = area;
    return group;
  }

  function turnTo(object, axis) {
    object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), vector(axis));
  }

  function addSphere() {
    const material = new THREE.MeshBasicMaterial({
      transparent: true, opacity: 0.28, side: THREE.BackSide, depthWrite: false,
    });
    coloured.push((own) => material.color.setHex(own.sphere));
    world.add(new THREE.Mesh(new THREE.SphereGeometry(RADIUS, 64, 32), material));
    const grid = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55 });
    coloured.push((own) => grid.color.setHex(own.grid));
    const circle = (at) => world.add(line([...Array(97).keys()].map((i) => at(2 * Math.PI * i / 96)), grid, false));
    for (let d = -60; d <= 60; d += 30) {
      const z = Math.sin(d * Math.PI / 180), r = Math.cos(d * Math.PI / 180);
      circle((a) => new THREE.Vector3(r * Math.cos(a), r * Math.sin(a), z));
    }
    for (let m = 0; m < 180; m += 30) {
      const b = m * Math.PI / 180;
      circle((a) => new THREE.Vector3(Math.cos(a) * Math.cos(b), Math.cos(a) * Math.sin(b), Math.sin(a)));
    }
    [["x", [1.12, 0, 0]], ["y", [0, 1.12, 0]], ["z", [0, 0, 1.12]]].forEach(([name, at]) => {
      const axis = new THREE.LineBasicMaterial();
      coloured.push((own) => axis.color.setHex(own.axis));
      world.add(line([vector(at.map((part) => part * 0.9)), vector(at)], axis, false));
      addLabel(`inertial ${name}`, world, vector(at), "axis");
    });
  }

  function addZones() {
    data.zones.forEach((zone) => {
      const keepIn = zone.side < 0;
      const radius = RADIUS * (zone.on === "inertial" ? 0.998 : 0.96);
      const group = cap(zone.half_angle, zone.colour, radius, keepIn, keepIn ? 0.08 : 0.17);
      const parent = zone.on === "inertial" ? world : zone.on === "body" ? platform : devices[zone.device].moving;
      if (zone.on === "body") turnTo(group, zone.axis);  // a device's boresight is its z axis already
      parent.add(group);
      pick(group.userData.area, () => `${zone.name}: ${zone.told}`);
      addLabel(zone.name, group, new THREE.Vector3(0, 0, radius * 1.03), "zone");
      zones.push({ zone, group });
    });
    data.tracks.forEach((track) => world.add(line(
      track.points.map(vector), tinted(new THREE.LineBasicMaterial({ transparent: true, opacity: 0.6 }), track.colour))));
  }

  function addPlatform() {
    const material = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.85 });
    coloured.push((own) => material.color.setHex(own.body));
    const cube = new THREE.Mesh(new THREE.BoxGeometry(2 * SIZE, 2 * SIZE, 2 * SIZE), material);
    platform.add(cube);
    pick(cube, () => `${data.name}: platform`);
    [["x", 0xd1495b], ["y", 0x3a9e5c], ["z", 0x3273c8]].forEach(([name, colour], i) => {
      const tip = new THREE.Vector3().setComponent(i, 2.6 * SIZE);
      platform.add(new THREE.ArrowHelper(tip.clone().normalize(), new THREE.Vector3(), tip.length(), colour, 0.035, 0.02));
      addLabel(name, platform, tip.multiplyScalar(1.12), "axis");
    });
  }

  function addDevices() {
    data.devices.forEach((device) => {
      const foot = vector(device.foot).multiplyScalar(SIZE);
      const moving = new THREE.Group();  // its z axis is the boresight, from the middle of the sphere
      moving.matrixAutoUpdate = false;
      const colour = device.colour;
      const tube = new THREE.Group();  // the same axes at the foot
      tube.matrixAutoUpdate = false;
      const body = new THREE.Mesh(
        device.kind === "instrument" ? new THREE.CylinderGeometry(0.03, 0.03, 0.11, 20) : new THREE.CylinderGeometry(0.022, 0.034, 0.12, 20),
        tinted(new THREE.MeshLambertMaterial(), colour));
      body.geometry.rotateX(Math.PI / 2);
      body.geometry.translate(0, 0, 0.06);
      tube.add(body);
      if (device.kind !== "instrument") {
        const base = new THREE.Mesh(new THREE.SphereGeometry(0.036, 20, 12), tinted(new THREE.MeshLambertMaterial(), colour));
        base.position.copy(foot);
        platform.add(base);
      }
      const beam = line([foot, new THREE.Vector3(0, 0, 1)], tinted(new THREE.LineBasicMaterial({ transparent: true, opacity: 0.9 }), colour));
      platform.add(beam);
      const spot = new THREE.Mesh(new THREE.SphereGeometry(0.014, 16, 10), tinted(new THREE.MeshBasicMaterial(), colour));
      spot.position.set(0, 0, RADIUS);
      moving.add(spot);
      if (device.field) {
        const corners = device.field.map(vector), rim = [];
        corners.forEach((corner, i) => {
          const next = corners[(i + 1) % corners.length];
          for (let s = 0; s < 1; s += 0.125) rim.push(corner.clone().lerp(next, s).normalize());
        });
        moving.add(line(rim, tinted(new THREE.LineBasicMaterial(), colour), true));
      }
      device.masks.forEach((mask) => {  // in the axes that yaw and pitch turn in, near the device
        const rim = mask.points.map((point) => vector(point).multiplyScalar(0.45).add(foot));
        const outline = line(rim, tinted(new THREE.LineDashedMaterial({ dashSize: 0.02, gapSize: 0.015 }), colour), true);
        outline.computeLineDistances();
        platform.add(outline);
        pick(outline, () => `${device.name}: ${mask.name}`);
      });
      platform.add(moving, tube);
      pick(body, () => `${device.name} (${device.kind})`);
      pick(spot, () => `${device.name} (${device.kind})`);
      addLabel(device.name, moving, new THREE.Vector3(0, 0, RADIUS * 1.06), "device", device.colour);
      devices.push({ device, moving, tube, beam, foot });
    });
  }

  function addTrails() {
    data.trails.forEach((trail, number) => {
      const points = trail.map((point) => vector(point).multiplyScalar(RADIUS * 1.001));
      const colour = data.devices[number].colour;
      world.add(line(points, tinted(new THREE.LineBasicMaterial({ transparent: true, opacity: 0.35 }), colour)));
      const flown = line(points, tinted(new THREE.LineBasicMaterial(), colour));
      world.add(flown);
      trails.push(flown);
    });
    data.targets.forEach((target) => {
      const mark = new THREE.Mesh(new THREE.RingGeometry(0.02, 0.028, 24), tinted(new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }), target.colour));
      mark.position.copy(vector(target.direction).multiplyScalar(RADIUS));
      mark.lookAt(0, 0, 0);
      world.add(mark);
      pick(mark, () => `target of ${target.name}`);
    });
  }

  function pick(object, told) { object.userData.told = told; picks.push(object); }

  function addLabel(text, parent, at, kind, colour) {
    const element = document.createElement("div");
    element.className = `label ${kind}`;
    element.textContent = text;
    if (colour) element.style.color = colour;
    document.getElementById("labels").append(element);
    labels.push({ element, parent, at, rank: ["device", "zone", "axis"].indexOf(kind), wide: 0, high: 0 });
  }

  // Rotation matrix of a quaternion, scalar first, as rows.
  function rows(q) {
    const [w, x, y, z] = q;
    return [
      [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
      [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
      [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ];
  }

  // Rows of the matrix from a device's axes (-up, left, boresight) to the body's, at joints in rad.
  function deviceRows(device, joints) {
    if (device.kind === "instrument") return device.frame;
    const a = joints[device.yaw];
    const b = (device.pitch === null ? 0 : joints[device.pitch]) + device.tilt;
    const [ca, sa, cb, sb] = [Math.cos(a), Math.sin(a), Math.cos(b), Math.sin(b)];
    const own = [[ca * sb, -sa, ca * cb], [sa * sb, ca, sa * cb], [-cb, 0, sb]];
    return device.frame.map((row) => [0, 1, 2].map((c) => row[0] * own[0][c] + row[1] * own[1][c] + row[2] * own[2][c]));
  }

  function matrixOf(r, at) {
    const p = at || { x: 0, y: 0, z: 0 };
    return new THREE.Matrix4().set(
      r[0][0], r[0][1], r[0][2], p.x, r[1][0], r[1][1], r[1][2], p.y, r[2][0], r[2][1], r[2][2], p.z, 0, 0, 0, 1);
  }

  function show(time) {
    const state = Motion.at(data.motion, time);
    platform.matrix.copy(matrixOf(rows(state.attitude)));
    platform.matrixWorldNeedsUpdate = true;
    devices.forEach(({ device, moving, tube, beam, foot }) => {
      const own = deviceRows(device, state.joints);
      moving.matrix.copy(matrixOf(own));
      tube.matrix.copy(matrixOf(own, foot));
      const ends = beam.geometry.attributes.position;
      ends.setXYZ(1, own[0][2] * RADIUS, own[1][2] * RADIUS, own[2][2] * RADIUS);
      ends.needsUpdate = true;
    });
    zones.forEach(({ zone, group }) => {
      if (zone.on === "inertial") turnTo(group, Motion.direction(zone.path, time));
    });
    const seen = data.times_s, last = seen.length - 1;
    const count = time >= seen[last] ? seen.length : Motion.pieceAt(seen, time) + 1;
    trails.forEach((trail) => trail.geometry.setDrawRange(0, count));
    world.matrix.identity();
    if (inBody) world.matrix.copy(platform.matrix).invert();
    world.matrixWorldNeedsUpdate = true;
    changed = true;
    return state;
  }

  // The eye goes round the middle: by dragging, by the wheel, and by two fingers.
  function listen(canvas) {
    const fingers = new Map();
    const apart = () => {
      const [one, other] = [...fingers.values()];
      return Math.hypot(one.x - other.x, one.y - other.y);
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const wide = fingers.size === 2 ? apart() : 0;
      if (fingers.size === 1) {
        eye.azimuth -= (event.clientX - before.x) / canvas.clientHeight * 3;
        eye.elevation += (event.clientY - before.y) / canvas.clientHeight * 3;
        eye.elevation = Math.min(Math.max(eye.elevation, -1.55), 1.55);
        changed = true;
      }
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (wide) come(wide / apart());
    });
    ["pointerup", "pointercancel"].forEach((kind) => canvas.addEventListener(kind, (event) => fingers.delete(event.pointerId)));
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      come(Math.exp(Math.sign(event.deltaY) * 0.1));
    }, { passive: false });
  }

  function come(times) {
    eye.distance = Math.min(Math.max(eye.distance * times, 0.4), 9);
    changed = true;
  }

  function look() {
    const c = Math.cos(eye.elevation) * eye.distance;
    camera.position.set(c * Math.cos(eye.azimuth), c * Math.sin(eye.azimuth), eye.distance * Math.sin(eye.elevation));
    camera.lookAt(0, 0, 0);
  }

  // Draws what is new since the last time; where nothing moved there is nothing to do.
  function draw() {
    if (!changed) return;
    changed = false;
    look();
    scene.updateMatrixWorld();
    renderer.render(scene, camera);
    if (named) placeLabels();
  }

  // Steps aside from where a thing is, in widths and heights of its name, the best first.
  const ASIDE = [[0, 0], [0, -1], [0, 1], [0, -2], [0, 2], [0.75, 0], [-0.75, 0], [0.75, -1], [-0.75, -1], [0.75, 1], [-0.75, 1]];

  // Puts names where their things are; of two that would touch, the less important one steps aside, and is
  // not shown where there is no room beside either.
  function placeLabels() {
    const toEye = camera.position.clone().normalize(), taken = [];
    labels.forEach((label) => {
      const place = label.parent.localToWorld(spot.copy(label.at));
      const behind = place.dot(toEye) < -0.15 * place.length() && place.length() > 0.6;
      const flat = place.project(camera);
      const at = [(flat.x + 1) / 2 * width, (1 - flat.y) / 2 * height];
      const places = ASIDE.map(([across, up]) => [at[0] + across * (label.wide + 4), at[1] + 1.3 * up * label.high]);
      const free = places.find(([x, y]) => taken.every((other) =>
        Math.abs(other.x - x) > (other.wide + label.wide) / 2 || Math.abs(other.y - y) > (other.high + label.high) / 2));
      const [x, y] = free || at;
      if (free) taken.push({ x, y, wide: label.wide, high: label.high });
      label.element.style.opacity = !free ? 0 : behind ? 0.45 : 1;
      label.element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    });
  }

  function resize() {
    const box = document.getElementById("stage");
    [width, height] = [box.clientWidth, box.clientHeight];
    renderer.setSize(width, height);
    camera.aspect = width / Math.max(height, 1);
    camera.updateProjectionMatrix();
    labels.forEach((label) => {
      [label.wide, label.high] = [label.element.offsetWidth, 0.8 * label.element.offsetHeight];
    });
    changed = true;
  }

  function home() {
    const far = 3.2 * Math.max(1, 1 / camera.aspect);
    eye.azimuth = Math.atan2(data.eye[1], data.eye[0]);
    eye.elevation = Math.asin(data.eye[2]);
    eye.distance = far;
    changed = true;
  }

  function setTheme(name) {
    theme = name;
    document.documentElement.dataset.theme = name;
    scene.background = new THREE.Color(THEMES[name].ground);
    coloured.forEach((paint) => paint(THEMES[name]));
    changed = true;
  }

  function toldAt(event) {
    const box = renderer.domElement.getBoundingClientRect();
    const at = new THREE.Vector2((event.clientX - box.left) / box.width * 2 - 1, 1 - (event.clientY - box.top) / box.height * 2);
    caster.setFromCamera(at, camera);
    const hit = caster.intersectObjects(picks, false)[0];
    return hit ? hit.object.userData.told() : "";
  }

  function start(three, given) {
    THREE = three;
    data = given;
    scene = new THREE.Scene();
    world = new THREE.Group();
    world.matrixAutoUpdate = false;
    platform = new THREE.Group();
    platform.matrixAutoUpdate = false;
    world.add(platform);
    scene.add(world, new THREE.AmbientLight(0xffffff, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 2.0);
    sun.position.set(2, -3, 4);
    scene.add(sun);
    camera = new THREE.PerspectiveCamera(42, 1, 0.05, 50);
    camera.up.set(0, 0, 1);
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    // k3d has colours taken as they are, which must then not be changed on their way to the screen.
    renderer.outputColorSpace = THREE.ColorManagement.enabled ? THREE.SRGBColorSpace : THREE.LinearSRGBColorSpace;
    renderer.setPixelRatio(window.devicePixelRatio);
    document.getElementById("stage").prepend(renderer.domElement);
    listen(renderer.domElement);
    caster = new THREE.Raycaster();
    caster.params.Line.threshold = 0.015;
    addSphere();
    addPlatform();
    addDevices();
    addZones();
    addTrails();
    spot = new THREE.Vector3();
    labels.sort((one, other) => one.rank - other.rank);  // the more important ones are placed first
    resize();
    home();
    new ResizeObserver(resize).observe(document.getElementById("stage"));  // it shrinks when curves come
  }

  return {
    start, show, draw, home, setTheme, toldAt,
    theme: () => theme,
    follow: (body) => { inBody = body; },
    followsBody: () => inBody,
    canvas: () => renderer.domElement,
    labels: (shown) => {
      document.getElementById("labels").style.display = shown ? "" : "none";
      named = shown;
      changed = true;
    },
    // For checks from outside: world matrices of platform and devices, by columns, as three.js has them.
    matrices: () => {
      scene.updateMatrixWorld(true);
      return { platform: [...platform.matrixWorld.elements], devices: devices.map((own) => [...own.moving.matrixWorld.elements]) };
    },
  };
})();

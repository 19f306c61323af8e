"use strict";
const $ = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search), participant = location.pathname === "/participant";
if (participant) document.body.classList.add("participant");
const inputs = { enable: false, target: null, push: [0, 0, 0], stick: [0, 0], switch: false, gripper: false, frozen: -1, noise: 0, delay: 0 };
let scene = null, frame = null, commands = false, socket = null, dirty = true, drag = "target", trail = [];
window.live = { inputs, frames: 0, get frame() { return frame; }, get scene() { return scene; }, screen: (p) => project(p) };

// ---- small vectors
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]], add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const mul = (a, s) => [a[0] * s, a[1] * s, a[2] * s], dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(...a), unit = (a) => mul(a, 1 / (size(a) || 1));

// ---- camera and picture
/* Shapes are drawn from far to near on a 2-D canvas: without WebGL there is enough time for the heartbeat. */
const canvas = $("scene"), pen = canvas.getContext("2d"), camera = { centre: [0, 0, 0.4], away: 2, turn: -0.9, lift: 0.45 };
let eye, right, up, ahead, focus, wide, high;
function look() {
  const c = Math.cos(camera.lift), out = [c * Math.cos(camera.turn), c * Math.sin(camera.turn), Math.sin(camera.lift)];
  eye = add(camera.centre, mul(out, camera.away)); ahead = mul(out, -1); wide = canvas.clientWidth; high = canvas.clientHeight; focus = 1.1 * Math.min(wide, high);
  right = Math.abs(out[2]) > 0.999 ? [-Math.sin(camera.turn), Math.cos(camera.turn), 0] : unit(cross(ahead, [0, 0, 1])); up = cross(right, ahead);
}
/* Pixel coordinates of a point, and pixels per metre at its depth; null for a point behind the eye. */
function seen(p) {
  const d = sub(p, eye), z = dot(d, ahead), k = focus / z;
  return z > 0.02 * camera.away ? [wide / 2 + k * dot(d, right), high / 2 - k * dot(d, up), k] : null;
}
function project(p) { look(); return seen(p); }
/* Point at pixel (x, y) in the plane through `p` that faces the camera; for planar problems, in the horizontal plane. */
function placed(x, y, p) {
  const ray = add(mul(ahead, focus), add(mul(right, x - wide / 2), mul(up, high / 2 - y))), normal = scene.planar ? [0, 0, 1] : ahead;
  return add(eye, mul(ray, dot(sub(p, eye), normal) / dot(ray, normal)));
}
const shade = (colour, k) => "rgb(" + [1, 3, 5].map((i) => k * parseInt(colour.slice(i, i + 2), 16)).join() + ")";
function capsule(shapes, c) {
  const a = c.slice(0, 3), b = c.slice(3, 6), pieces = Math.max(1, Math.min(4, Math.round(size(sub(b, a)) / (0.15 * scene.reach))));
  for (let i = 0; i < pieces; i++) {
    const from = add(a, mul(sub(b, a), i / pieces)), to = add(a, mul(sub(b, a), (i + 1) / pieces)), p = seen(from), q = seen(to);
    if (p && q) shapes.push([p[2] + q[2], () => body(p, q, p[2] * c[6], q[2] * c[6], c[7])]);
  }
}
function body(p, q, r, s, colour) {
  const dx = q[0] - p[0], dy = q[1] - p[1], long = Math.hypot(dx, dy), ball = long <= Math.abs(r - s) + 0.5, wider = Math.max(r, s);
  let paint;
  pen.beginPath();
  if (ball) {
    const [x, y] = r > s ? p : q; pen.arc(x, y, wider, 0, 7); paint = pen.createRadialGradient(x - wider / 3, y - wider / 2, wider / 8, x, y, wider);
    paint.addColorStop(0, shade(colour, 1.08)); paint.addColorStop(1, shade(colour, 0.7));
  } else {
    const turn = Math.atan2(dy, dx), open = Math.acos((r - s) / long);
    pen.arc(p[0], p[1], r, turn + open, turn - open + 2 * Math.PI); pen.arc(q[0], q[1], s, turn - open, turn + open); pen.closePath();
    let nx = -dy / long, ny = dx / long; if (ny > 0 || (ny === 0 && nx > 0)) { nx = -nx; ny = -ny; } // the light is above
    paint = pen.createLinearGradient(p[0] - nx * wider, p[1] - ny * wider, p[0] + nx * wider, p[1] + ny * wider);
    paint.addColorStop(0, shade(colour, 0.62)); paint.addColorStop(0.7, shade(colour, 1.06)); paint.addColorStop(1, shade(colour, 0.9));
  }
  pen.fillStyle = paint; pen.fill();
}
function line(shapes, l) {
  const points = l.points.map(seen);
  for (let i = 1; i < points.length; i++) {
    const p = points[i - 1], q = points[i];
    if (p && q) shapes.push([p[2] + q[2], () => stroke([p, q], l.colour, Math.max(1.6, (l.radius || 0) * 2 * p[2]))]);
  }
}
function stroke(points, colour, width) { pen.strokeStyle = colour; pen.lineWidth = width; pen.lineCap = "round"; pen.beginPath(); points.forEach((p, i) => i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])); pen.stroke(); }
function arrow(from, along, colour, width) {
  const p = seen(from), q = seen(add(from, along)); if (!p || !q) return;
  const dx = q[0] - p[0], dy = q[1] - p[1], long = Math.hypot(dx, dy), head = Math.min(long, 4 * width); if (long < 2) return;
  const x = dx / long, y = dy / long, bx = q[0] - x * head, by = q[1] - y * head;
  stroke([p, [bx, by]], colour, width); pen.fillStyle = colour; pen.beginPath(); pen.moveTo(q[0], q[1]); pen.lineTo(bx - y * head / 2, by + x * head / 2); pen.lineTo(bx + y * head / 2, by - x * head / 2); pen.fill();
}
function dot2(p, r, colour) { const q = p && seen(p); if (!q) return; pen.fillStyle = colour; pen.strokeStyle = "#fff"; pen.lineWidth = 2; pen.beginPath(); pen.arc(q[0], q[1], r, 0, 7); pen.fill(); pen.stroke(); }
function picture() {
  const step = scene.reach < 1 ? 0.1 : scene.reach > 4 ? 1 : 0.25, z = scene.floor || 0, half = step * Math.ceil(scene.reach / step), [cx, cy] = scene.centre.map((v) => Math.round(v / step) * step);
  for (let v = -half; v <= half + 1e-9; v += step) for (const [a, b] of [[[cx + v, cy - half, z], [cx + v, cy + half, z]], [[cx - half, cy + v, z], [cx + half, cy + v, z]]]) { const p = seen(a), q = seen(b); if (p && q) stroke([p, q], "#d3dbe2", 1); }
  const shapes = [], h = frame.handles || {};
  for (const f of scene.fills || []) {
    const points = f.points.map(seen); if (points.every(Boolean)) shapes.push([2 * Math.min(...points.map((p) => p[2])), () => { pen.fillStyle = f.colour; pen.beginPath(); points.forEach((p, i) => i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])); pen.fill(); }]);
  }
  for (const l of [...(scene.lines || []), ...(frame.lines || []), { points: trail, colour: "#e69f00" }]) line(shapes, l);
  for (const c of [...(scene.capsules || []), ...(frame.capsules || [])]) capsule(shapes, c);
  for (const [, paint] of shapes.sort((a, b) => a[0] - b[0])) paint();
  for (const a of scene.arrows || []) arrow(a.slice(0, 3), a.slice(3, 6), a[6], 1.5);
  dot2(h.target, 9, "#0072b2"); dot2(h.hand, 6, "#e69f00");
  for (const a of frame.arrows || []) arrow(a.slice(0, 3), mul(a.slice(3, 6), scene.arrow || 0.01), a[6], 5);
}
function draw() {
  if (dirty && scene && frame) {
    dirty = false;
    const sharp = Math.min(devicePixelRatio || 1, 2), w = Math.round(canvas.clientWidth * sharp), h = Math.round(canvas.clientHeight * sharp);
    if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
    pen.setTransform(sharp, 0, 0, sharp, 0, 0); pen.clearRect(0, 0, w, h); look();
    if (participant) drawParticipant(pen); else picture();
  }
  requestAnimationFrame(draw);
}

// ---- the participant's screen
function onScreen(p) {
  const s = scene.screen, d = sub(p, s.centre), k = Math.min(canvas.clientWidth, canvas.clientHeight) / 2 / s.half;
  return [canvas.clientWidth / 2 + k * dot(d, s.u), canvas.clientHeight / 2 - k * dot(d, s.v), k];
}
let inside = false, audio = null;
function drawParticipant(g) {
  const h = frame.handles || {}, target = frame.goal || h.target;
  if (!h.hand) return;
  const r = Math.max(24, 0.06 * Math.min(canvas.clientWidth, canvas.clientHeight)), [x, y] = onScreen(h.hand);
  const [tx, ty] = target ? onScreen(target) : [NaN, NaN], there = Math.hypot(x - tx, y - ty) < r;
  if (target) { g.fillStyle = there ? "#3fae7a" : "#2f6f9f"; g.beginPath(); g.arc(tx, ty, r, 0, 7); g.fill(); }
  g.fillStyle = "#f2c14e"; g.beginPath(); g.arc(x, y, r / 3, 0, 7); g.fill();
  if (there && !inside && $("sound").checked) {
    audio = audio || new AudioContext(); const o = audio.createOscillator(), v = audio.createGain();
    v.gain.value = 0.1; o.frequency.value = 660; o.connect(v).connect(audio.destination); o.start(); o.stop(audio.currentTime + 0.12);
  }
  inside = there;
}

// ---- pointer in the scene
let grabbed = null, last = null;
canvas.addEventListener("contextmenu", (e) => e.preventDefault());
canvas.addEventListener("pointerdown", (e) => {
  canvas.setPointerCapture(e.pointerId); last = [e.offsetX, e.offsetY]; grabbed = null;
  if (!scene || !frame) return;
  const h = frame.handles || {};
  if (participant) { if (scene.handled && h.hand) { grabbed = h.hand; pull(e); } return; }
  const p = drag === "push" ? h.hand : h.target || h.hand;
  if (commands && p && e.button === 0 && allowed(drag)) {
    const near = [h.hand, h.target].filter(Boolean).some((q) => { const [x, y] = project(q); return Math.hypot(x - e.offsetX, y - e.offsetY) < 34; });
    if (near) { grabbed = p; canvas.style.cursor = "grabbing"; pull(e); }
  }
});
function pull(e) {
  if (participant) {
    const s = scene.screen, [cx, cy, k] = [canvas.clientWidth / 2, canvas.clientHeight / 2, onScreen(s.centre)[2]];
    inputs.target = add(s.centre, add(mul(s.u, (e.offsetX - cx) / k), mul(s.v, (cy - e.offsetY) / k)));
  } else {
    look(); const to = placed(e.offsetX, e.offsetY, grabbed);
    if (drag === "push") { const f = mul(sub(to, frame.handles.hand), scene.spring || 100), most = scene.push || 30; inputs.push = size(f) > most ? mul(unit(f), most) : f; }
    else inputs.target = to;
  }
}
canvas.addEventListener("pointermove", (e) => {
  if (!last) return;
  if (grabbed) pull(e);
  else if (!participant) {
    const dx = e.offsetX - last[0], dy = e.offsetY - last[1];
    if (e.buttons === 2 || e.shiftKey) { const k = camera.away / focus; camera.centre = add(camera.centre, add(mul(right, -dx * k), mul(up, dy * k))); }
    else { camera.turn -= 0.008 * dx; camera.lift = Math.max(-0.3, Math.min(1.5707, camera.lift + 0.008 * dy)); }
  }
  last = [e.offsetX, e.offsetY]; dirty = true;
});
function letGo() { last = grabbed = null; inputs.push = [0, 0, 0]; if (participant || (scene && scene.springy)) inputs.target = null; canvas.style.cursor = ""; }
canvas.addEventListener("pointerup", letGo); canvas.addEventListener("pointercancel", letGo);
canvas.addEventListener("wheel", (e) => { camera.away *= Math.exp(0.001 * e.deltaY); dirty = true; e.preventDefault(); }, { passive: false });
addEventListener("resize", () => { dirty = true; });

// ---- controls
const allowed = (what) => scene && scene.controls.includes(what);
function choose(what) { drag = what; $("dragtarget").classList.toggle("on", what === "target"); $("dragpush").classList.toggle("on", what === "push"); }
$("dragtarget").onclick = () => choose("target"); $("dragpush").onclick = () => choose("push");
$("follow").onclick = () => { inputs.target = null; };
function enable(on, why) { inputs.enable = on && commands && !document.hidden; if (why !== undefined) $("why").textContent = why; beat(); shown(); }
$("deadman").onclick = (e) => { enable(!inputs.enable, ""); e.currentTarget.blur(); };
const keys = {};
addEventListener("keydown", (e) => {
  if (e.code === "Escape") enable(false, "released");
  if (e.target.tagName === "SELECT" || e.target.type === "range") return;
  if (e.code === "Space") { e.preventDefault(); if (!e.repeat) enable(true, "held by the space bar"); }
  if (e.code.startsWith("Arrow") && allowed("stick")) e.preventDefault();
  keys[e.code] = 1;
});
addEventListener("keyup", (e) => {
  if (keys.Space && e.code === "Space") { e.preventDefault(); enable(false, "space bar released"); }
  delete keys[e.code];
});
function left() { if (keys.Space) enable(false, "released: the keyboard went elsewhere"); for (const k in keys) delete keys[k]; }
addEventListener("blur", left); addEventListener("focusin", (e) => { if (e.target.tagName === "SELECT") left(); });
for (const name of ["switch", "gripper"]) { $(name).onpointerdown = () => { keys[name] = 1; }; $(name).onpointerup = $(name).onpointerleave = () => { delete keys[name]; }; }
let padded = null;
function onPad(e) { const r = $("pad").getBoundingClientRect(), x = (e.clientX - r.left) / r.width * 2 - 1, y = (e.clientY - r.top) / r.height * 2 - 1, k = 1 / Math.max(1, Math.hypot(x, y)); padded = [-y * k, -x * k]; }
$("pad").onpointerdown = (e) => { $("pad").setPointerCapture(e.pointerId); if (commands) onPad(e); };
$("pad").onpointermove = (e) => { if (padded) onPad(e); }; $("pad").onpointerup = $("pad").onpointercancel = () => { padded = null; };
function stick() {
  const pad = [...(navigator.getGamepads?.() || [])].find((p) => p && p.axes.length > 1);
  inputs.switch = !!(keys.KeyM || keys.switch || pad?.buttons[0]?.pressed); inputs.gripper = !!(keys.KeyG || keys.gripper || pad?.buttons[1]?.pressed);
  if (padded) return padded;
  const k = [(keys.ArrowUp || 0) - (keys.ArrowDown || 0), (keys.ArrowLeft || 0) - (keys.ArrowRight || 0)];
  return k[0] || k[1] || !pad ? k : [-pad.axes[1], -pad.axes[0]];
}
function drawPad() {
  const g = $("pad").getContext("2d"), [f, l] = inputs.stick; g.clearRect(0, 0, 260, 260);
  g.fillStyle = "#eef2f5"; g.beginPath(); g.arc(130, 130, 124, 0, 7); g.fill(); g.strokeStyle = "#cdd6de"; g.lineWidth = 2; g.beginPath(); g.moveTo(130, 10); g.lineTo(130, 250); g.moveTo(10, 130); g.lineTo(250, 130); g.stroke();
  g.fillStyle = "#0072b2"; g.beginPath(); g.arc(130 - 100 * l, 130 - 100 * f, 22, 0, 7); g.fill();
}
$("frozen").onchange = () => { inputs.frozen = +$("frozen").value; };
$("noise").oninput = () => { const v = +$("noise").value; inputs.noise = v ? 1e-5 * 10 ** (3 * v) : 0; $("noisetext").textContent = v ? (1e3 * inputs.noise).toPrecision(2) + " " + scene.noise : "0"; };
$("delay").oninput = () => { inputs.delay = +$("delay").value / 1e3; $("delaytext").textContent = $("delay").value + " ms"; };
$("take").onclick = () => socket.send('{"take":true}');
document.addEventListener("visibilitychange", () => { if (document.hidden) { enable(false, "released: the tab was hidden"); } });

/* The heartbeat runs in the page's own thread, so that a hanging page sends none. Each heartbeat has its send time on the
   server's clock, estimated from the newest frame, so that the server can detect delayed heartbeats. */
let told = null;
function clock() { return told && told.clock + (performance.now() - told.at) / 1e3; }
function beat() {
  if (!socket || socket.readyState !== 1 || document.hidden) return;
  if (participant) { if (scene && scene.handled) socket.send(JSON.stringify({ hand: inputs.target })); return; }
  if (!commands) return;
  if (allowed("stick")) { inputs.stick = stick(); drawPad(); }
  socket.send(JSON.stringify({ inputs, clock: clock() }));
}
setInterval(beat, 25);

// ---- the panel
const plots = [];
function panel() {
  document.title = scene.title; $("title").textContent = scene.title; $("title").title = scene.title;
  $("dragging").hidden = !(allowed("target") || allowed("push")); $("dragtarget").hidden = !allowed("target"); $("dragpush").hidden = !allowed("push"); $("follow").hidden = !allowed("target") || scene.springy;
  $("dragtarget").textContent = scene.led || "target"; choose(allowed("target") ? "target" : "push");
  $("sticking").hidden = !allowed("stick"); $("faults").hidden = !allowed("faults");
  for (const [i, name] of scene.encoders.entries()) $("frozen").add(new Option("freeze " + name, i));
  const rows = scene.joints || []; $("jointpart").hidden = !rows.length; if (scene.jointtitle) $("jointtitle").textContent = scene.jointtitle;
  for (const j of rows) {
    const tr = $("joints").insertRow(), name = tr.insertCell(), bar = document.createElement("div"); name.className = "name"; name.textContent = name.title = j.name;
    bar.className = "bar"; bar.append(document.createElement("i")); tr.insertCell().append(bar); tr.insertCell().className = "n";
  }
  for (const p of scene.plots) {
    const box = document.createElement("div"), head = document.createElement("div"), value = document.createElement("b"), c = document.createElement("canvas");
    box.className = "plot"; head.append(p.name, value); box.append(head, c); $("plots").append(box); plots.push({ ...p, value, c, kept: [] });
  }
  const legend = [...(scene.planar ? [] : [["#b9c4cf", "robot"]]), ...(allowed("target") ? [["#0072b2", "target"]] : []), ["#e69f00", "hand and its trail"], ...(scene.legend || [])];
  for (const [colour, name] of legend) { const s = document.createElement("span"), i = document.createElement("i"); i.style.background = colour; s.append(i, name); $("legend").append(s); }
  const hint = document.createElement("span"); hint.textContent = "drag beside the robot: turn · shift-drag: move · wheel: zoom"; $("legend").append(hint);
  camera.centre = scene.centre.slice(); camera.away = 1.35 * scene.reach; if (scene.planar) { camera.lift = 1.5707; camera.turn = -Math.PI / 2; } else if (scene.turn !== undefined) camera.turn = scene.turn;
  if (scene.logged) $("take").hidden = true;
  shown();
}
const number = (v) => v === null ? "–" : Math.abs(v) >= 100 ? v.toFixed(0) : Math.abs(v) >= 10 ? v.toFixed(1) : v.toFixed(2);
function plot(p, now) {
  const k = p.kept, w = p.c.clientWidth, h = 38, sharp = Math.min(devicePixelRatio || 1, 2), g = p.c.getContext("2d");
  while (k.length && k[0][0] < now - 10) k.shift();
  if (!w || !k.length) return;
  p.c.width = w * sharp; p.c.height = h * sharp; g.setTransform(sharp, 0, 0, sharp, 0, 0);
  const values = k.map((e) => e[1]).filter((v) => v !== null); if (p.line !== undefined) values.push(p.line);
  const low = Math.min(0, ...values), high = Math.max(p.least || 1e-9, ...values) * 1.1, y = (v) => h - 3 - (h - 6) * (v - low) / (high - low);
  if (p.line !== undefined) { g.strokeStyle = "#d1495b"; g.setLineDash([4, 3]); g.beginPath(); g.moveTo(0, y(p.line)); g.lineTo(w, y(p.line)); g.stroke(); g.setLineDash([]); }
  g.strokeStyle = "#0072b2"; g.lineWidth = 1.4; g.beginPath(); let pen = false;
  for (const [t, v] of k) { if (v === null) { pen = false; continue; } const x = w * (1 - (now - t) / 10); if (pen) g.lineTo(x, y(v)); else g.moveTo(x, y(v)); pen = true; }
  g.stroke();
}
function shown() {
  $("deadman").disabled = !commands; $("deadman").classList.toggle("on", inputs.enable);
  $("deadman").textContent = !commands ? (scene ? (scene.logged ? "A log is shown" : "Another tab commands") : "Starting") : inputs.enable ? "Enabled: press to release" : "Press to enable (or hold the space bar)";
  for (const each of document.querySelectorAll("#dragging button, #faults select, #faults input, #sticking button")) each.disabled = !commands;
}
const good = ["ok", "backup"], stopped = ["braking", "holding", "releasing", "released", "lost"];
function show(message) {
  const first = !frame; frame = message.frame; live.frames++;
  $("wait").hidden = true;
  const w = message.words, state = stopped.includes(w.status) ? "stop" : good.includes(w.status) && !w.relaxed ? "ok" : "warn";
  $("status").textContent = w.status; $("status").className = state;
  $("reason").textContent = [w.reason, w.relaxed && "relaxed: " + w.relaxed].filter(Boolean).join(" · ") || (w.status === "ok" ? "every bound certified" : "");
  $("mode").textContent = w.mode ? "stick: " + w.mode : ""; $("clock").textContent = message.late;
  if (inputs.enable && message.lapsed) { inputs.enable = false; $("why").textContent = message.lapsed; shown(); }
  const h = frame.handles && frame.handles.hand;
  if (h && (first || !trail.length || size(sub(h, trail[trail.length - 1])) > 0.006 * scene.reach)) { trail.push(h); if (trail.length > 120) trail.shift(); }
  if (!participant) {
    frame.numbers.forEach((v, i) => { const p = plots[i]; p.kept.push([message.time, v]); p.value.textContent = number(v) + " " + p.unit; if (live.frames % 3 === 0) plot(p, message.time); });
    if (live.frames % 3 === 0) (scene.joints || []).forEach((j, i) => {
      const v = frame.joints[j.index], tr = $("joints").rows[i], bar = tr.cells[1].firstChild.firstChild, ended = j.lower !== null, k = j.angle ? 180 / Math.PI : 1e3;
      const margin = ended ? Math.min(v - j.lower, j.upper - v) : 9;
      bar.style.left = (ended ? Math.max(0, Math.min(100, 100 * (v - j.lower) / (j.upper - j.lower))) : 50) + "%";
      bar.style.background = margin > 0.35 ? "#2e9e6b" : margin > 0.087 ? "#e9b44c" : "#d1495b"; tr.cells[2].textContent = (k * v).toFixed(0) + (j.angle ? "°" : " mm");
    });
  }
  dirty = true;
}
function seat(s) {
  commands = s.commands; if (!commands) inputs.enable = false;
  $("seattext").textContent = (commands ? "this tab commands" : "this tab watches") + " · " + s.tabs + (s.tabs === 1 ? " tab" : " tabs") + (s.participants ? ", " + s.participants + " for the participant" : "");
  $("take").hidden = commands || (scene && scene.logged); shown();
}
function lost(text) { commands = false; inputs.enable = false; $("wait").hidden = false; $("wait").textContent = text; $("status").textContent = "lost"; $("status").className = "stop"; $("reason").textContent = text; $("seattext").textContent = "not connected"; $("take").hidden = true; shown(); }
function connect() {
  socket = new WebSocket("ws://" + location.host + "/ws?" + new URLSearchParams({ token: query.get("token"), view: participant ? "participant" : "main" }));
  socket.onmessage = (e) => {
    const m = JSON.parse(e.data);
    if (m.clock) told = { clock: m.clock, at: performance.now() };
    if (m.scene) { const known = scene; scene = m.scene; if (!known) panel(); }
    if (m.seat) seat(m.seat);
    if (m.frame && scene) show(m);
    if (m.lost) lost(m.lost);
  };
  socket.onclose = () => { lost("the connection to rehab-opt live is gone: the robot was stopped"); };
}
connect(); draw();

// The live page: frames in, pictures out. Everything that comes from the team is shown as text, never as markup.

import { Cache, History, best, coverage, decode, lineOf } from "./frames.js";
import { TABLE, apart, chart, colour, contour, level, mark, outline, peak, picture, place, prepare, projection, steps } from "./draw.js";

const PACES = { lockstep: "lockstep", realtime: "real time", free: "no world" };
const $ = (id) => document.getElementById(id);
const DASHES = [[[], "solid"], [[5, 3], "dashed"], [[1.5, 2.5], "dotted"]]; // of a line in a chart, and in its legend
const OLD = 1; // seconds after which a belief on the map tells its age
const TRAIL = 60; // seconds of team time
const WINDOW = 180; // seconds of team time that the charts show
const history_ = new History();
const saved = (key) => { try { return localStorage.getItem(key); } catch { return null; } };
const save = (key, value) => { try { localStorage.setItem(key, value); } catch { /* a private window keeps nothing */ } };
const asked = new URLSearchParams(location.hash.slice(1));
const POLL = 1000; // milliseconds between two questions for what is over
const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20];
const cache = new Cache();
const state = {
  live: null, // the newest header, with what the processes do now
  shown: null, // the header that is drawn
  paused: asked.has("tick"), // a moment that is over is shown, standing or played
  playing: false,
  index: 0, // of the moment that is shown while paused
  time: 0, // team time in seconds up to which is played
  speed: 1,
  wanted: asked.has("tick") ? { tick: Number(asked.get("tick")), run: asked.get("run") } : null,
  tape: null, // whether this is a tape; null until the server has said so
  done: false, // whether the tape is read to its end
  subject: asked.get("subject") || "",
  log: saved("scale") !== "linear",
  light: saved("theme") ? saved("theme") === "light" : matchMedia("(prefers-color-scheme: light)").matches,
  connected: false,
  socket: null,
  fetching: "",
  order: new Map(), // subject -> its place among the colours
  whyFor: "",
  hidden: new Set(JSON.parse(saved("hidden") || "[]")), // layers of the map that are not drawn
  zoom: 1, // of the map
  centre: null, // of the map, in the grid's unit; null: that of the grid
  seen: new Set(JSON.parse(saved("seen") || "[]")), // alarms that were looked at
  important: saved("events") === "important", // of what happened only alarms and warnings are shown
};
const LOST = 0.1; // share of the map, exp(entropy) of its cells, as blackboard/state/alarms.py has it: such a belief is not filled
const FAINT = 0.05; // share of the map: a belief that is wider is drawn thinner, so that it never covers the map
window.page = { state, history: history_, level, peak, best, contour, apart }; // for tests and the curious

// --- what comes in -------------------------------------------------------------------------------------------------------------

function take(buffer) {
  const header = decode(buffer);
  state.live = header;
  if (header.tick !== null) {
    history_.add(lineOf(header));
    cache.put(nameOf(header, header.chosen), buffer);
  }
  redraw();
}

/** Ask for the lines that are new; on a tape until it is read. */
async function askPast() {
  if (state.tape && state.done) return;
  try {
    const answer = await (await fetch(`past?from=${history_.asked}`)).json();
    const first = state.tape === null;
    state.tape = answer.source.tape;
    state.done = answer.source.done;
    history_.extend(answer.past);
    if (first && state.tape && !state.paused) pause(true, 0);
    if (state.wanted && history_.newest) {
      if (state.wanted.run && state.wanted.run !== history_.newest.run && !state.tape) { state.paused = false; state.wanted = null; }
      else if (history_.newest.tick >= state.wanted.tick || state.done) { state.index = history_.index(state.wanted.tick); state.wanted = null; }
    }
    redraw();
  } catch { /* the server is away; the socket says so */ }
}

async function connect() {
  await askPast();
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
  socket.binaryType = "arraybuffer";
  let newest = null;
  socket.onopen = () => { state.connected = true; state.socket = socket; if (state.subject) socket.send(state.subject); redraw(); };
  socket.onmessage = (event) => { // only the newest of those that came between two pictures is drawn
    if (newest === null) requestAnimationFrame(() => { const it = newest; newest = null; take(it); });
    newest = event.data;
  };
  socket.onclose = () => { state.connected = false; state.socket = null; redraw(); setTimeout(connect, 1000); };
}

// --- which moment, which subject -------------------------------------------------------------------------------------------------

const nameOf = (moment, subject) => `${moment.run} ${moment.tick} ${subject}`;

/** The header to draw: the newest, or that of the moment that is wanted; the one before it until that has come. */
function current() {
  if (!state.paused || !history_.moments.length) return state.tape ? state.shown : state.live;
  if (state.wanted) return state.shown || (state.tape ? null : state.live);
  state.index = Math.max(0, Math.min(state.index, history_.moments.length - 1));
  const moment = history_.moments[state.index], name = nameOf(moment, state.subject);
  if (state.shown && state.shown.name === name) return state.shown;
  const buffer = cache.get(name);
  if (buffer) return { ...decode(buffer), name };
  askFrame(moment, name);
  return state.shown || state.live;
}

/** Ask for the frame of a moment, one at a time: of those that are passed while one is on its way only the last is asked for. */
async function askFrame(moment, name) {
  if (state.fetching) return;
  state.fetching = name;
  try {
    const answer = await fetch(`frame?${new URLSearchParams({ run: moment.run, tick: moment.tick, subject: state.subject })}`);
    if (answer.ok) cache.put(name, await answer.arrayBuffer());
    else if (answer.status === 404) history_.drop(moment.tick);
    redraw();
  } catch { setTimeout(redraw, 500); } finally { state.fetching = ""; }
}

function pause(on, index = history_.moments.length - 1) {
  state.paused = on || Boolean(state.tape); state.playing = false; state.wanted = null; state.index = index; remember(); redraw();
}

/** Play from the moment that is shown, or stand still. At the end of a tape it begins anew. */
function play(on) {
  if (!history_.moments.length) return;
  if (!state.paused) pause(true);
  if (on && state.tape && state.index >= history_.moments.length - 1) state.index = 0;
  state.playing = on;
  state.time = history_.moments[state.index].time;
  if (on) requestAnimationFrame((at) => playOn(at, at)); else remember();
  redraw();
}

function playOn(before, now) {
  if (!state.playing) return;
  const last = history_.moments.length - 1;
  state.time = Math.min(state.time + Math.min(0.25, (now - before) / 1000) * state.speed, history_.moments[last].time);
  const index = history_.before(state.time);
  if (index !== state.index && !state.fetching) { state.index = index; redraw(); }
  if (index < last || (state.tape && !state.done)) requestAnimationFrame((at) => playOn(now, at));
  else if (state.tape) { state.playing = false; state.index = last; remember(); redraw(); }
  else pause(false);
}

function step(by) {
  const from = state.paused ? state.index : history_.moments.length - 1;
  pause(true, Math.max(0, Math.min(from + by, history_.moments.length - 1)));
}

function faster(by) {
  state.speed = SPEEDS[(SPEEDS.indexOf(state.speed) + by + SPEEDS.length) % SPEEDS.length];
  redraw();
}

function choose(name) {
  state.subject = name;
  state.socket?.send(name);
  remember();
  redraw();
}

/** The address names the subject, and the moment while paused: it is a link to what is shown. */
function remember() {
  const found = new URLSearchParams();
  if (state.subject) found.set("subject", state.subject);
  const moment = state.paused && history_.moments[state.index];
  if (moment) { found.set("run", moment.run); found.set("tick", moment.tick); }
  history.replaceState(null, "", "#" + found);
}

// --- drawing -----------------------------------------------------------------------------------------------------------------------

let due = false;
function redraw() { if (!due) { due = true; requestAnimationFrame(draw); } }

function theme() {
  const css = getComputedStyle(document.documentElement), of = (name) => css.getPropertyValue(name).trim();
  return { ink: of("--ink"), soft: of("--soft"), line: of("--line"), arena: of("--arena"), accent: of("--accent"), panel: of("--panel") };
}

function draw() {
  due = false;
  document.documentElement.dataset.theme = state.light ? "light" : "dark";
  const header = current();
  state.shown = header;
  const colours = theme();
  drawHead(header);
  if (!header) return;
  const names = Object.keys(header.subjects).sort((a, b) => (a.startsWith("robot/") ? 0 : 1) - (b.startsWith("robot/") ? 0 : 1) || a.localeCompare(b, "en", { numeric: true }));
  for (const name of names) if (!state.order.has(name)) state.order.set(name, state.order.size);
  if (!header.subjects[state.subject] && names.length && !asked.has("subject")) choose(names.find((it) => it.startsWith("object/") && best(header.subjects[it])) || names[0]);
  drawMap(header, names, colours);
  drawChips(header, names);
  drawNumbers(header);
  drawMatrix(header, colours);
  drawCharts(header, colours);
  drawProcesses(header);
  drawPulse(state.tape ? header : state.live || header);
  drawAlarms(header);
  drawEvents(header);
  askWhy(header);
}

const tint = (name) => colour(state.order.get(name) || 0, state.light);

function drawHead(header) {
  const it = $("state");
  it.className = "state" + (!state.connected ? " lost" : state.paused ? "" : " live");
  const over = state.playing ? `playing ${state.speed}×` : "paused";
  const settled = header && header.tick !== null;
  it.textContent = !state.connected ? "no connection" : state.tape && !state.done ? "reading the tape"
    : state.tape && !history_.moments.length ? "nothing was settled" : state.paused ? (state.tape && !state.playing ? "tape" : over) : settled ? "live" : "nothing settled yet";
  $("theme").textContent = state.light ? "dark" : "light";
  $("scale").textContent = state.log ? "log" : "linear";
  $("pause").className = state.playing || !state.paused ? "pause" : "play";
  $("pause").setAttribute("aria-label", $("pause").className);
  $("speed").textContent = `${state.speed}×`;
  $("now").hidden = Boolean(state.tape) || !state.paused;
  const scrub = $("scrub"), count = history_.moments.length;
  scrub.max = Math.max(0, count - 1);
  scrub.value = state.paused ? state.index : count - 1;
  if (!header) return;
  $("team").textContent = `team ${header.team}`;
  document.title = `${header.team}: what the team believes`;
  const board = header.processes.filter((one) => one.kind === "board");
  const rate = Math.max(0, ...board.map((one) => one.rate));
  $("clock").textContent = header.tick === null ? "" : `tick ${header.tick} · ${header.time.toFixed(1)} s · ${PACES[header.mode]} · ${rate.toFixed(1)} ticks/s`;
  const at = header.tick === null ? "" : `${header.time.toFixed(1)} s`;
  if (document.activeElement !== $("moment")) $("moment").value = at; // what is being typed stays
  scrub.setAttribute("aria-valuetext", at);
}

function drawMap(header, names, colours) {
  const canvas = $("map"), grid = header.grid;
  if (grid) canvas.style.aspectRatio = `${grid.shape[0]} / ${grid.shape[1]}`;
  const { context, width, height } = prepare(canvas);
  if (!grid) return;
  const [x0, y0] = grid.origin, x1 = x0 + grid.shape[0] * grid.cell, y1 = y0 + grid.shape[1] * grid.cell;
  const [cx, cy] = state.centre || [(x0 + x1) / 2, (y0 + y1) / 2], wide = (x1 - x0) / 2 / state.zoom, high = (y1 - y0) / 2 / state.zoom;
  const to = projection(cx - wide, cx + wide, cy - high, cy + high, width, height, 20), on = (layer) => !state.hidden.has(layer);
  map = { to, x0, x1, y0, y1, cx, cy };
  context.font = "10px system-ui, sans-serif"; context.fillStyle = colours.soft; context.strokeStyle = colours.line; context.lineWidth = 1;
  context.globalAlpha = 0.7;
  const left = Math.max(x0, cx - wide), right = Math.min(x1, cx + wide), low = Math.max(y0, cy - high), top = Math.min(y1, cy + high);
  for (const x of steps(left, right, 6)) {
    line(context, to.x(x), to.y(y0), to.x(x), to.y(y1));
    context.textAlign = "center"; context.textBaseline = "top"; context.fillText(String(x), to.x(x), Math.min(to.y(y0) + 4, height - 14));
  }
  for (const y of steps(low, top, 6)) {
    line(context, to.x(x0), to.y(y), to.x(x1), to.y(y));
    context.textAlign = "right"; context.textBaseline = "middle"; context.fillText(String(y), Math.max(to.x(x0) - 4, 18), to.y(y));
  }
  context.textAlign = "left"; context.textBaseline = "top"; context.fillText(grid.unit, 4, 3);
  context.globalAlpha = 1;
  context.strokeRect(to.x(x0), to.y(y1), to.x(x1) - to.x(x0), to.y(y0) - to.y(y1));
  if (on("trail")) drawTrails(context, to, header, names);
  const means = Object.fromEntries(names.map((name) => [name, best(header.subjects[name])?.mean]));
  context.lineWidth = 1;
  for (const [observer, seen] of on("sighting") ? header.sightings : []) {
    const from = means[observer], end = means[seen];
    if (!from || !end) continue;
    const chosen = observer === state.subject || seen === state.subject;
    context.globalAlpha = chosen ? 0.85 : 0.32; context.strokeStyle = chosen ? colours.ink : colours.soft;
    line(context, to.x(from[0]), to.y(from[1]), to.x(end[0]), to.y(end[1]));
  }
  for (const seen of on("sighting") ? names.filter((name) => means[name]) : []) {
    for (const [observer, odds, taken] of header.subjects[seen].unnamed || []) {
      if (!means[observer]) continue;
      context.globalAlpha = (observer === state.subject || seen === state.subject ? 0.85 : 0.32) * odds;
      context.strokeStyle = colours.soft; context.setLineDash(taken ? [] : [2, 4]);
      line(context, to.x(means[observer][0]), to.y(means[observer][1]), to.x(means[seen][0]), to.y(means[seen][1]));
    }
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
  const away = absent(header);
  for (const name of names) {
    const it = header.subjects[name], belief = best(it);
    if (!belief) continue;
    const tone = away.has(name) ? colours.soft : tint(name), [r, g, b] = rgb(tone), chosen = name === state.subject;
    const share = belief.area / (grid.cell ** 2 * grid.shape[0] * grid.shape[1]), ink = 235 * Math.min(1, Math.sqrt(FAINT / Math.max(share, 1e-9)));
    context.globalAlpha = it.share ?? 1; // what may not be there, or may be what was seen, is faint
    const lost = isLost(belief, grid);
    if (on("belief") && !lost) place(context, to, grid, belief, picture(belief, (at) => [r, g, b, at ? ink * Math.exp((at - 255) * header.step * 0.6) : 0]), true);
    context.strokeStyle = tone; context.lineWidth = chosen ? 2.6 : 1.5; context.setLineDash(lost ? [2, 5] : it.conflict ? [5, 3] : []);
    if (on("region")) outline(context, to, grid, belief);
    context.setLineDash([]);
    context.globalAlpha = 1;
    if (on("region")) drawMotion(context, to, it, belief, tone);
  }
  const labels = [];
  for (const name of names) {
    const it = header.subjects[name], belief = best(it);
    if (it.truth && on("truth")) mark(context, to.x(it.truth[0]), to.y(it.truth[1]), 4, colours.ink, colours.arena);
    if (!belief || !on("name")) continue;
    const off = Math.max(11, Math.min(60, 1.9 * belief.sigma * to.scale + 5));
    context.font = `${name === state.subject ? 700 : 600} 12px system-ui, sans-serif`;
    context.textAlign = "left"; context.textBaseline = "alphabetic"; context.lineJoin = "round";
    const label = name.split("/")[1] + (away.has(name) ? `, ${away.get(name)}` : isLost(belief, grid) ? ", lost" : belief.age > OLD ? `, ${belief.age.toFixed(0)} s old` : "");
    const x = Math.min(to.x(belief.mean[0]) + off * 0.72, to.x(x1) - 8 * label.length);
    const y = apart(labels, x, Math.max(to.y(belief.mean[1]) - off * 0.72, 14), context.measureText(label).width);
    context.lineWidth = 3.5; context.strokeStyle = colours.arena; context.strokeText(label, x, y);
    context.fillStyle = away.has(name) ? colours.soft : tint(name); context.fillText(label, x, y);
  }
  for (const [name, place_] of on("name") ? lastPlaces(header, away) : []) {
    const x = to.x(place_[0]), y = to.y(place_[1]);
    context.strokeStyle = context.fillStyle = colours.soft; context.lineWidth = 2; context.setLineDash([3, 3]);
    context.beginPath(); context.arc(x, y, 10, 0, 7); context.stroke(); context.setLineDash([]);
    context.fillText(`${name.split("/")[1]}, ${away.get(name)}`, Math.min(x + 13, to.x(x1) - 90), Math.max(y, 14));
  }
  canvas.onclick = (event) => {
    if (dragged) return;
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    const far = (name) => (means[name] ? Math.hypot(to.x(means[name][0]) - x, to.y(means[name][1]) - y) : Infinity);
    const nearest = names.reduce((a, b) => (far(b) < far(a) ? b : a), names[0]);
    if (nearest && far(nearest) < 40) choose(nearest);
  };
}

/** A cone of where it heads, within two sigmas, and the way that it goes in a second. */
function drawMotion(context, to, it, belief, tone) {
  const x = to.x(belief.mean[0]), y = to.y(belief.mean[1]);
  context.strokeStyle = context.fillStyle = tone; context.lineWidth = 1.5;
  if (it.heading) {
    const [angle, sigma] = it.heading, half = Math.min(Math.PI, Math.max(0.05, 2 * sigma));
    context.globalAlpha = 0.45; context.beginPath(); context.moveTo(x, y); context.arc(x, y, 16, -angle - half, -angle + half); context.fill();
    context.globalAlpha = 1;
  }
  if (it.velocity) line(context, x, y, to.x(belief.mean[0] + it.velocity[0]), to.y(belief.mean[1] + it.velocity[1]));
}

/** Whether a belief is so wide that it says nearly nothing of the place. */
function isLost(belief, grid) { return Math.exp(belief.entropy) > LOST * grid.shape[0] * grid.shape[1]; }

/** Robots that are gone or silent, by subject, and for how long. */
function absent(header) {
  const found = new Map();
  for (const it of header.processes) if (it.kind === "robot" && it.state !== "alive") found.set(`robot/${it.name}`, since(it));
  return found;
}

/** Where those were believed to be last of whom nothing is believed any more, by subject. */
function lastPlaces(header, away) {
  const end = header.tick === null ? -1 : history_.index(header.tick), found = new Map();
  for (const name of away.keys()) {
    if (header.subjects[name] && best(header.subjects[name])) continue;
    for (let k = end; k >= 0 && !found.has(name); k--) if (history_.moments[k].subjects[name]?.mean) found.set(name, history_.moments[k].subjects[name].mean);
  }
  return found;
}

/** What a process does: "alive", "gone 12 s", "never heard". */
function since(it) { return it.state === "alive" ? it.state : it.away === null ? "never heard" : `${it.state} ${it.away.toFixed(0)} s`; }

let map = null, dragged = false; // the projection of the map as it was drawn; whether the pointer has moved since it was pressed

/** Zoom by a factor, so that a point of the screen stays where it is [default: the middle]. */
function zoom(by, event) {
  if (!map) return;
  const before = state.zoom, box = $("map").getBoundingClientRect();
  state.zoom = Math.max(1, Math.min(40, state.zoom * by));
  const share = 1 - before / state.zoom; // of the way to the point
  const x = event ? (event.clientX - box.left - map.to.x(0)) / map.to.scale : map.cx, y = event ? (map.to.y(0) - event.clientY + box.top) / map.to.scale : map.cy;
  shift(map.cx + (x - map.cx) * share, map.cy + (y - map.cy) * share);
}

/** Put the middle of the map somewhere, within the grid. */
function shift(x, y) {
  state.centre = state.zoom === 1 ? null : [Math.max(map.x0, Math.min(map.x1, x)), Math.max(map.y0, Math.min(map.y1, y))];
  redraw();
}

function whole() { state.zoom = 1; state.centre = null; redraw(); }

function drawTrails(context, to, header, names) {
  const end = header.tick === null ? -1 : history_.index(header.tick);
  const moments = history_.moments.slice(0, end + 1).filter((it) => it.run === header.run && it.time >= header.time - TRAIL);
  context.lineJoin = "round"; context.lineCap = "butt";
  for (const name of names) {
    context.strokeStyle = tint(name);
    for (let k = 1; k < moments.length; k++) {
      const a = moments[k - 1].subjects[name]?.mean, b = moments[k].subjects[name]?.mean;
      if (!a || !b) continue;
      context.globalAlpha = 0.08 + 0.5 * (1 - (header.time - moments[k].time) / TRAIL); context.lineWidth = 1.4;
      line(context, to.x(a[0]), to.y(a[1]), to.x(b[0]), to.y(b[1]));
    }
  }
  context.globalAlpha = 1;
}

function line(context, x, y, u, v) { context.beginPath(); context.moveTo(x, y); context.lineTo(u, v); context.stroke(); }

function rgb(text) { return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16)); }

function element(tag, attributes = {}, ...children) {
  const it = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) it[key] = value;
  it.append(...children);
  return it;
}

/** As many children as there are rows, each filled in its place, so that focus and scrolling stay. */
function fill(parent, rows, make, set) {
  while (parent.children.length > rows.length) parent.lastChild.remove();
  while (parent.children.length < rows.length) parent.append(make());
  rows.forEach((row, index) => set(parent.children[index], row, index));
}

function drawChips(header, names) {
  const away = absent(header);
  fill($("subjects"), names, () => element("button", {}, element("i"), element("span")), (it, name) => {
    it.firstChild.style.background = tint(name);
    it.firstChild.className = name.split("/")[0];
    it.lastChild.textContent = name.split("/")[1];
    it.setAttribute("aria-pressed", String(name === state.subject));
    it.className = away.has(name) ? "away" : header.subjects[name].conflict ? "conflict" : "";
    it.title = away.has(name) ? `${name}, ${away.get(name)}` : name;
    it.onclick = () => choose(name);
  });
}

function drawNumbers(header) {
  const it = header.subjects[state.subject], belief = it && best(it), unit = header.grid ? header.grid.unit : "";
  const rows = [];
  if (belief) {
    const score = it.scores.agreed || it.scores[`consensus/${belief.who}`];
    rows.push(["at", belief.mean.map((x) => x.toFixed(1)).join(", ")], ["entropy", `${belief.entropy.toFixed(2)} nats`],
      ["95 % region", `${Number(belief.area.toPrecision(3))} ${unit}²`]);
    if (score) rows.push(["error", `${score.error.toFixed(2)} ${unit}`, !score.inside], ["truth is", score.inside ? "inside" : "outside", !score.inside]);
    if (it.heading) rows.push(["heads", `${(it.heading[0] * 180 / Math.PI).toFixed(0)}°, give or take ${(it.heading[1] * 180 / Math.PI).toFixed(2)}°`]);
    if (it.velocity) rows.push(["moves at", `${Math.hypot(...it.velocity).toFixed(2)} ${unit}/s`]);
    if (it.existence != null) rows.push(["is there with", `${(100 * it.existence).toFixed(1)} %`]);
    const unclear = (it.unnamed || []).filter((one) => !one[2] && one[1] >= 0.05);
    if (unclear.length) rows.push(["may have been seen by", unclear.map(([who, odds]) => `${who.split("/")[1]} (${(100 * odds).toFixed(0)} %)`).join(", "), true]);
    const sensors = Object.entries(it.sensors).map(([name, value]) => `${name} ${Number(value.toPrecision(3))}`);
    if (sensors.length) rows.push(["sensors err by", sensors.join(", "), true]);
    rows.push(["rule", it.rule]);
    if (it.dissent.length) rows.push(["keeps disagreeing", it.dissent.map(([who, sigmas, weight]) => `${who} (${sigmas.toFixed(1)} σ, counts ${(100 * weight).toFixed(0)} %)`).join(", "), true]);
    if (it.camps.length) rows.push(["camps", it.camps.map((camp) => camp.join(", ")).join(" against "), true]);
    if (it.left_out.length) rows.push(["ignored", it.left_out.map((one) => one[0]).join(", "), true]);
  }
  fill($("numbers"), rows, () => element("div", {}, element("dt"), element("dd")), (div, [name, value, bad]) => {
    div.firstChild.textContent = name;
    div.lastChild.textContent = div.lastChild.title = value;
    div.lastChild.className = bad ? "bad" : "";
  });
}

/** The square of cells that the heat maps show: most beliefs to 2.5 sigma, and the truth; a much wider one fills its tile. */
function window_(beliefs, grid) {
  if (!beliefs.length) return [[0, 0], 12];
  const centre = beliefs[0].mean;
  const reach = beliefs.map((it) => Math.max(...it.mean.map((x, axis) => Math.abs(x - centre[axis]))) + 2.5 * it.sigma).sort((a, b) => a - b);
  const side = Math.min(Math.max(12, 2 * Math.ceil(reach[Math.floor(0.7 * (reach.length - 1))] / grid.cell)), Math.max(...grid.shape));
  return [centre.map((x, axis) => (x - grid.origin[axis]) / grid.cell - side / 2), side];
}

function drawMatrix(header, colours) {
  const it = header.subjects[state.subject], grid = header.grid, beliefs = it ? it.beliefs : [];
  if (!grid) return;
  const top = Math.max(1e-300, ...beliefs.map((one) => one.peak));
  const [from, side] = window_(beliefs, grid);
  $("matrix").className = beliefs.length <= 4 ? "few" : beliefs.length <= 8 ? "some" : "";
  const edge = (axis, cells) => grid.origin[axis] + cells * grid.cell;
  fill($("matrix"), beliefs, () => element("figure", {}, element("canvas"), element("figcaption", {}, element("b"), element("span"))), (figure, belief) => {
    const [canvas, caption] = figure.children, { context, width, height } = prepare(canvas);
    context.fillStyle = `rgb(${TABLE[0]},${TABLE[1]},${TABLE[2]})`;
    context.fillRect(0, 0, width, height);
    const to = projection(edge(0, from[0]), edge(0, from[0] + side), edge(1, from[1]), edge(1, from[1] + side), width, height, 0);
    const paint = (at) => {
      const nats = (at - 255) * header.step + Math.log(belief.peak / top);
      const shade = at ? Math.round(255 * Math.max(0, state.log ? 1 + nats / 9 : Math.exp(nats))) : 0;
      return [TABLE[3 * shade], TABLE[3 * shade + 1], TABLE[3 * shade + 2], 255];
    };
    place(context, to, grid, belief, picture(belief, paint), false);
    if (it.truth) mark(context, to.x(it.truth[0]), to.y(it.truth[1]), 3, "#ffffff", "#00224e");
    const what = { agreed: "agreed", consensus: `sub-team ${belief.who}`, firsthand: belief.who, informed: belief.who }[belief.kind];
    caption.firstChild.textContent = what;
    const more = { firsthand: " first-hand", informed: " informed" }[belief.kind] || "";
    caption.lastChild.textContent = `${more} ${belief.entropy.toFixed(2)}` + (belief.age > 0.5 ? `, ${belief.age.toFixed(0)} s old` : "");
  });
  const { context, width } = prepare($("bar"));
  for (let x = 0; x < width; x++) {
    const shade = Math.round((255 * x) / Math.max(1, width - 1));
    context.fillStyle = `rgb(${TABLE[3 * shade]},${TABLE[3 * shade + 1]},${TABLE[3 * shade + 2]})`;
    context.fillRect(x, 0, 1, 9);
  }
  context.font = "10px system-ui, sans-serif"; context.fillStyle = colours.soft; context.textBaseline = "bottom";
  context.textAlign = "left"; context.fillText(state.log ? "e⁻⁹" : "0", 0, 23);
  context.textAlign = "right"; context.fillText(beliefs.length ? `${top.toPrecision(2)} a cell` : "", width, 23);
}

function drawCharts(header, colours) {
  const newest = history_.newest, name = state.subject;
  if (!newest || !name) return;
  const moments = history_.around(state.paused ? header.time : newest.time, WINDOW);
  const times = moments.map((it) => it.time), found = [...new Set(moments.flatMap((it) => Object.keys(it.subjects[name]?.entropy || {})))].sort().reverse();
  const cursor = state.paused ? times.findIndex((time) => time >= header.time) : null;
  const look = (who, index) => (who === "agreed" ? { colour: tint(name), width: 2.2, dash: [] } : { colour: colours.soft, width: 1.2, dash: DASHES[index % 3][0] });
  const unit = header.grid ? header.grid.unit : "";
  fill($("lines"), found, () => element("span", {}, element("i"), element("span")), (it, who) => {
    const index = found.indexOf(who);
    it.firstChild.style.borderTop = who === "agreed" ? `3px solid ${tint(name)}` : `2px ${DASHES[index % 3][1]} ${colours.soft}`;
    it.lastChild.textContent = who.replace("consensus/", "sub-team ");
  });
  $("errorunit").textContent = `error, ${unit}`;
  const options = { ...colours, cursor };
  const pick = (value) => (who, index) => ({ values: moments.map((it) => value(it.subjects[name], who) ?? null), ...look(who, index) });
  const charts = {
    entropy: chart($("entropy"), times, found.map(pick((it, who) => it?.entropy[who])), options),
    error: chart($("error"), times, found.map(pick((it, who) => it?.scores[who]?.error)), options),
    coverage: chart($("coverage"), times, [{ values: coverage(moments, name), colour: tint(name), width: 2.2 }], { ...options, high: 1.04, rule: 0.95 }),
  };
  for (const [id, it] of Object.entries(charts)) {
    $(id).onclick = (event) => {
      const time = it.time(event.clientX - $(id).getBoundingClientRect().left);
      const index = history_.moments.findIndex((one) => one.time >= time);
      pause(true, index < 0 ? history_.moments.length - 1 : index);
    };
  }
}

function drawProcesses(header) {
  fill($("processes"), header.processes, () => element("tr", {}, ...Array.from({ length: 6 }, () => element("td"))), (row, it) => {
    const refused = Object.entries(it.refused).map(([reason, count]) => `${reason} ${count}`).join(", ");
    const where = it.sub_teams.length ? ` (${it.sub_teams.join(", ")})` : "";
    const more = [refused, it.dropped ? `dropped ${it.dropped}` : "", it.late ? `late ${it.late}` : ""].filter(Boolean).join(", ");
    const cells = [it.name + where, since(it), it.tick ?? "-", it.rate.toFixed(1), it.age === null ? "-" : `${it.age.toFixed(1)} s`, more || "-"];
    cells.forEach((text, index) => { row.children[index].textContent = text; });
    row.children[1].className = it.state;
  });
}

/** One mark for each process in the head: boards and the world are squares, who is gone stands on a corner. */
function drawPulse(header) {
  fill($("pulse"), header.processes, () => element("i"), (it, process) => {
    it.className = `${process.kind} ${process.state}`;
    it.title = `${process.name}: ${since(process)}, ${process.rate.toFixed(1)} ticks/s`;
  });
  const alive = header.processes.filter((it) => it.state === "alive").length;
  $("pulse").setAttribute("aria-label", `${alive} of ${header.processes.length} processes alive`);
}

/** What must not be missed, until somebody has looked at it: a card for each that lasts, and one for all that are over. */
function drawAlarms(header) {
  const nameOf = (it) => `${header.run} ${it.what} ${it.who} ${Math.round(it.since)}`;
  const found = header.alarms.filter((it) => !state.seen.has(nameOf(it))), over = found.filter((it) => it.over !== null);
  const rows = found.filter((it) => it.over === null).map((it) => ({ text: it.text, age: `${it.for.toFixed(0)} s`, its: [it] }));
  if (over.length) rows.push({ text: `over: ${over.map((it) => `${it.who} ${it.what}`).join(", ")}`, title: over.map((it) => `${it.text}, for ${it.for.toFixed(0)} s; over since ${it.over.toFixed(0)} s`).join("\n"), its: over, over: true });
  fill($("alarms"), rows, () => element("li", {}, element("span"), element("i"), element("button", { textContent: "seen" })), (row, it) => {
    row.className = it.over ? "over" : it.its[0].what.replace(" ", "-");
    row.firstChild.textContent = it.text;
    row.firstChild.title = it.title || it.text;
    row.children[1].textContent = it.age || "";
    row.lastChild.onclick = () => { for (const one of it.its) state.seen.add(nameOf(one)); save("seen", JSON.stringify([...state.seen].slice(-200))); redraw(); };
  });
}

function told(event) {
  return event.what === "here" || event.what === "gone" ? `${event.text} is ${event.what}` : event.text;
}

function drawEvents(header) {
  const grave = header.events.filter((it) => it.severity !== "note"), last = grave[grave.length - 1] || header.events[header.events.length - 1];
  $("important").setAttribute("aria-pressed", String(state.important));
  if (last) {
    $("latest").className = last.severity;
    $("latest").textContent = `${last.tick < 0 ? "" : `tick ${last.tick}: `}${told(last)}`;
  }
  const rows = (state.important ? grave : header.events).slice().reverse();
  fill($("events"), rows, () => element("li", {}, element("span"), element("div")), (row, it) => {
    row.className = it.severity;
    row.firstChild.textContent = it.tick < 0 ? "" : `tick ${it.tick}`;
    row.lastChild.textContent = told(it);
  });
}

/** Ask the server why, for the moment that is shown; while it is live every two seconds. */
async function askWhy(header) {
  if (!state.subject || header.tick === null || !state.connected) return;
  const query = new URLSearchParams({ subject: state.subject, run: header.run, tick: header.tick });
  const key = `${state.subject} ${state.paused && !state.playing ? query : Math.floor(Date.now() / 2000)}`;
  if (key === state.whyFor) return;
  state.whyFor = key;
  try {
    const found = await (await fetch(`why?${query}`)).json();
    if (state.whyFor !== key) return;
    $("whytitle").textContent = found.why ? `Why, in tick ${found.why.tick}` : "Why";
    fill($("why"), found.sentences.filter(Boolean), () => element("p"), (it, text) => {
      it.textContent = text;
      it.className = /^Sub-team/.test(text) || text === found.sentences[0] ? "lead" : "";
    });
  } catch { state.whyFor = ""; }
}

// --- hands ---------------------------------------------------------------------------------------------------------------------------

/** What stands is played, what goes stands. */
function toggle() { play(state.paused && !state.playing); }
function toggleScale() { state.log = !state.log; save("scale", state.log ? "log" : "linear"); redraw(); }
function toggleTheme() { state.light = !state.light; save("theme", state.light ? "light" : "dark"); redraw(); }
async function copyLink() {
  if (!state.paused) pause(true);
  remember();
  try { await navigator.clipboard.writeText(location.href); $("link").textContent = "copied"; } catch { $("link").textContent = "in the address"; }
  setTimeout(() => { $("link").textContent = "link"; }, 1500);
}
function next(by) {
  const names = [...$("subjects").children].map((it) => it.title), at = names.indexOf(state.subject);
  if (names.length) choose(names[(at + by + names.length) % names.length]);
}

$("pause").onclick = toggle;
$("speed").onclick = () => faster(1);
$("now").onclick = () => pause(false);
$("scrub").oninput = (event) => pause(true, Number(event.target.value));
$("moment").onkeydown = (event) => {
  event.stopPropagation(); // letters and arrows are for the text
  if (event.key !== "Enter" && event.key !== "Escape") return;
  const time = parseFloat($("moment").value);
  $("moment").blur();
  if (event.key === "Enter" && Number.isFinite(time) && history_.moments.length) pause(true, history_.before(time));
  else redraw();
};
$("moment").onfocus = () => $("moment").select();
$("moment").onblur = redraw;
$("scale").onclick = toggleScale;
for (const it of document.querySelectorAll(".legend button")) {
  const show = () => it.setAttribute("aria-pressed", String(!state.hidden.has(it.dataset.layer)));
  it.onclick = () => {
    if (!state.hidden.delete(it.dataset.layer)) state.hidden.add(it.dataset.layer);
    save("hidden", JSON.stringify([...state.hidden])); show(); redraw();
  };
  show();
}
$("closer").onclick = () => zoom(1.5);
$("farther").onclick = () => zoom(1 / 1.5);
$("whole").onclick = whole;
$("map").addEventListener("wheel", (event) => { event.preventDefault(); zoom(1.0015 ** -event.deltaY, event); }, { passive: false });
$("map").onpointerdown = (event) => {
  const { cx, cy } = map || {}, from = [event.clientX, event.clientY];
  dragged = false;
  $("map").onpointermove = (now) => {
    if (!map || Math.hypot(now.clientX - from[0], now.clientY - from[1]) < 4) return;
    dragged = true;
    if (state.zoom > 1) shift(cx - (now.clientX - from[0]) / map.to.scale, cy + (now.clientY - from[1]) / map.to.scale);
  };
};
for (const end of ["pointerup", "pointerleave"]) $("map").addEventListener(end, () => { $("map").onpointermove = null; });
$("important").onclick = () => { state.important = !state.important; save("events", state.important ? "important" : "everything"); redraw(); };
$("theme").onclick = toggleTheme;
$("link").onclick = copyLink;
$("help").onclick = () => $("keys").showModal();
addEventListener("resize", redraw);
addEventListener("hashchange", () => location.reload());
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $("keys").open) return;
  const far = event.shiftKey ? 10 : 1;
  const act = {
    " ": toggle, "+": () => faster(1), "-": () => faster(-1), ArrowLeft: () => step(-far), ArrowRight: () => step(far), Home: () => pause(true, 0), End: () => pause(false, history_.moments.length - 1),
    "[": () => next(-1), "]": () => next(1), l: toggleScale, z: () => zoom(1.5), x: () => zoom(1 / 1.5), a: whole, t: toggleTheme, c: copyLink, "?": () => $("keys").showModal(),
  }[event.key];
  if (!act || (event.key === " " && event.target.tagName === "BUTTON")) return;
  event.preventDefault();
  act();
});
setInterval(askPast, POLL);
connect();
redraw();

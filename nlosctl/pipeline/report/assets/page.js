// The page of `nlosctl report`: its data is in the element "data". Names are written as text, never as markup.
(() => {
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const get = (id) => document.getElementById(id);
const PER_PAGE = 50, MOST_CLICKABLE = 3000, MOST_ELLIPSES = 60, MOST_NAMED = 15, MOST_MARKERS = 500, MOST_LISTED = 2000;
const LOOKS = [
  { color: "--direct", dash: null, word: "direct" },
  { color: "--reflected", dash: "10 4", word: "by a mirror" },
  { color: "--flagged", dash: "2 6", word: "outlier or indirect" },
  { color: "--unused", dash: "7 6", word: "not used" },
];
const NOUNS = { bearings: "bearing", ranges: "range", arrivals: "difference", triplets: "path" };
const CURVES = { bearings: "ray", ranges: "circle", arrivals: "hyperbola", triplets: "rays and ellipse" };
const plane = data.map, origin = plane.origin, sensors = plane.sensors;
sensors.name = sensors.name.map((number) => sensors.names[number]);
let chosen = 0;

function element(tag, text, attributes) {
  const made = document.createElement(tag);
  if (text !== undefined && text !== null) made.textContent = text;
  for (const [name, value] of Object.entries(attributes || {})) made.setAttribute(name, value);
  return made;
}
const color = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const fixed = (value, decimals) => (value === null || value === undefined ? "" : value.toFixed(decimals));
const plural = (count, noun) => `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;

// Every estimate as [block, row]; the groups of all blocks have one list of colours.
const all = [], groups = [], ofSnapshot = new Map();
data.estimates.forEach((block) => {
  block.first = groups.length;
  groups.push(...block.groups);
  block.snapshot.forEach((snapshot, row) => {
    if (!ofSnapshot.has(snapshot)) ofSnapshot.set(snapshot, []);
    ofSnapshot.get(snapshot).push(all.length);
    all.push([block, row]);
  });
});
const groupOf = ([block, row]) => block.first + block.group[row];
const groupColor = (group) => color(`--group${group % 6}`);
data.measured.forEach((block) => {
  block.rows = new Map();
  let start = 0;
  block.snapshot.forEach((snapshot, number) => {
    block.rows.set(snapshot, [start, start + block.size[number]]);
    start += block.size[number];
  });
});

// The map, in metres about the origin.
const at = (x, y) => L.latLng(y, x);
const map = L.map("map", { crs: L.CRS.Simple, attributionControl: false, zoomSnap: 0.25, zoomDelta: 0.5, minZoom: -40, maxZoom: 40, zoomAnimation: false, fadeAnimation: false, inertia: false });
// Without the rounding to whole pixels, which makes curves uneven.
map.latLngToLayerPoint = (place) => map.project(L.latLng(place)).subtract(map.getPixelOrigin());
L.control.scale({ imperial: false }).addTo(map);
for (const [name, level] of [["regions", 405], ["base", 410], ["chosen", 420]]) map.createPane(name).style.zIndex = level;
map.getPane("chosen").style.pointerEvents = "none";
const base = L.canvas({ pane: "base", padding: 0.3 }), top = L.canvas({ pane: "chosen", padding: 0.3 });
const regionLayer = L.layerGroup().addTo(map), baseLayer = L.layerGroup().addTo(map), chosenLayer = L.layerGroup().addTo(map);
const bounds = L.latLngBounds(at(plane.low[0], plane.low[1]), at(plane.high[0], plane.high[1]));
map.fitBounds(bounds);
const reach = 3 * Math.max(plane.high[0] - plane.low[0], plane.high[1] - plane.low[1], 1);
const tip = (words) => element("span", words);

function ellipse(x, y, major, minor, turn) {
  const points = [], cosine = Math.cos(turn), sine = Math.sin(turn);
  for (let k = 0; k < 120; k++) {
    const u = major * Math.cos((k * Math.PI) / 60), v = minor * Math.sin((k * Math.PI) / 60);
    points.push(at(x + cosine * u - sine * v, y + sine * u + cosine * v));
  }
  return points;
}
function hyperbola(from, reference, difference) {
  const [sx, sy, rx, ry] = [sensors.x[from], sensors.y[from], sensors.x[reference], sensors.y[reference]];
  const length = Math.hypot(rx - sx, ry - sy), a = Math.abs(difference) / 2, b2 = (length * length) / 4 - a * a;
  if (!(b2 > 0)) return null;
  const b = Math.sqrt(b2), side = difference > 0 ? 1 : -1, ux = (rx - sx) / length, uy = (ry - sy) / length;
  const last = Math.acosh(1 + reach / Math.max(a, b)), points = [];
  for (let k = -80; k <= 80; k++) {
    const along = side * a * Math.cosh((last * k) / 80), across = b * Math.sinh((last * k) / 80);
    points.push(at((sx + rx) / 2 + along * ux - across * uy, (sy + ry) / 2 + along * uy + across * ux));
  }
  return points;
}
function arc(x, y, radius, from, to) {
  const points = [], count = Math.ceil(Math.min(5000, 240 * Math.max(1, radius / reach)));
  for (let k = 0; k <= count; k++) {
    const turn = from + ((to - from) * k) / count;
    points.push(at(x + radius * Math.cos(turn), y + radius * Math.sin(turn)));
  }
  return points;
}
function split(flat) {
  const parts = [[]];
  for (let k = 0; k < flat.length; k += 2) {
    if (flat[k] === null) parts.push([]);
    else parts[parts.length - 1].push(at(flat[k], flat[k + 1]));
  }
  return parts.filter((part) => part.length > 1);
}
// The curves of a row as lists of points.
function curvesOf(block, row) {
  const from = block.sensor[row], x = sensors.x[from], y = sensors.y[from];
  const known = (name) => block[name] && block[name][row] !== null;
  if (block.kind === "bearings") {
    if (!known("end_x")) return [];
    const path = [at(x, y)];
    if (known("hit_x")) path.push(at(block.hit_x[row], block.hit_y[row]));
    return [[...path, at(block.end_x[row], block.end_y[row])]];
  }
  if (block.kind === "ranges") {
    if (!known("from")) return [arc(x, y, block.value[row], 0, 2 * Math.PI)];
    if (block.curves[row]) return split(block.curves[row]);
    if (block.from[row] === block.to[row]) return [];
    return [arc(block.image_x[row], block.image_y[row], block.value[row], block.from[row], block.to[row])];
  }
  if (block.kind === "arrivals") {
    const curve = block.drawn ? hyperbola(from, block.reference[row], block.value[row]) : null;
    return curve ? [curve] : [];
  }
  const other = block.reference[row], ox = sensors.x[other], oy = sensors.y[other], curves = [];
  const ray = (fromX, fromY, turn) => [at(fromX, fromY), at(fromX + reach * Math.cos(turn), fromY + reach * Math.sin(turn))];
  curves.push(ray(x, y, (block.departing[row] * Math.PI) / 180), ray(ox, oy, (block.arriving[row] * Math.PI) / 180));
  const minor2 = block.value[row] ** 2 - (ox - x) ** 2 - (oy - y) ** 2;
  if (block.ellipses && minor2 > 0) {
    const outline = ellipse((x + ox) / 2, (y + oy) / 2, block.value[row] / 2, Math.sqrt(minor2) / 2, Math.atan2(oy - y, ox - x));
    curves.push([...outline, outline[0]]);
  }
  return curves;
}

function drawBase() {
  baseLayer.clearLayers();
  for (const mirror of plane.reflectors) {
    const opaque = mirror.kind === "opaque";
    const look = { renderer: base, pane: "base", color: color("--mirror"), weight: opaque ? 1 : 3, fill: opaque, fillOpacity: 0.25 };
    const shape = mirror.points
      ? L.polyline(mirror.points.map(([x, y]) => at(x, y)), look)
      : L.circle(at(mirror.x, mirror.y), { ...look, radius: mirror.radius });
    shape.bindTooltip(tip(`reflector ${mirror.name}`), { sticky: true }).addTo(baseLayer);
  }
  if (get("everything").checked) {
    const clickable = all.length <= MOST_CLICKABLE;
    all.forEach(([block, row], number) => {
      if (block.x[row] === null || block.y[row] === null) return;
      const own = groupColor(groupOf(all[number]));
      if (all.length <= MOST_ELLIPSES && block.major[row] !== null) {
        L.polygon(ellipse(block.x[row], block.y[row], block.major[row], block.minor[row], block.turn[row]),
          { renderer: base, pane: "base", color: own, weight: 1, fill: false, interactive: false, smoothFactor: 0 }).addTo(baseLayer);
      }
      const dot = L.circleMarker(at(block.x[row], block.y[row]), { renderer: base, pane: "base", radius: all.length > 300 ? 2 : 3.5, stroke: false, fillColor: own, fillOpacity: 0.75, interactive: clickable });
      if (clickable) dot.bindTooltip(() => tip(describe(number))).on("click", () => choose(block.snapshot[row]));
      dot.addTo(baseLayer);
    });
  }
  sensors.name.forEach((name, number) => {
    const place = at(sensors.x[number], sensors.y[number]);
    const few = sensors.name.length <= MOST_MARKERS;
    const marker = few
      ? L.marker(place, { icon: L.divIcon({ className: "", html: triangle(), iconSize: [14, 14] }), keyboard: false, alt: "" })
      : L.circleMarker(place, { renderer: base, pane: "base", radius: 2, stroke: false, fillColor: color("--sensor"), fillOpacity: 1 });
    const named = sensors.name.length <= MOST_NAMED;
    marker.bindTooltip(tip(name), { permanent: named, direction: "right", offset: [6, 0], opacity: 0.85 }).addTo(baseLayer);
  });
}
function svg(tag, attributes) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}
function triangle() {
  const drawing = svg("svg", { width: 14, height: 14, viewBox: "0 0 14 14", "aria-hidden": "true" });
  drawing.append(svg("polygon", { points: "7,1 13,13 1,13", fill: "var(--sensor)", stroke: "var(--paper)" }));
  return drawing;
}
function describe(number) {
  const [block, row] = all[number];
  const words = [`snapshot ${data.snapshots[block.snapshot[row]]}`, groups[groupOf(all[number])], block.statuses[block.status[row]]];
  for (const { head, text } of columns.slice(2)) {
    const shown = text(block, row);
    if (shown && head !== "Status") words.push(`${head}: ${shown}`);
  }
  return words.join("\n");
}

function drawChosen() {
  chosenLayer.clearLayers();
  const common = { renderer: top, pane: "chosen", interactive: false };
  for (const block of data.measured) {
    const [start, stop] = block.rows.get(chosen) || [0, 0];
    const weight = stop - start > 60 ? 1 : 1.8, opacity = Math.max(0.15, Math.min(0.95, 30 / Math.max(stop - start, 1)));
    for (let row = start; row < stop; row++) {
      const look = LOOKS[block.look[row]];
      for (const curve of curvesOf(block, row)) {
        L.polyline(curve, { ...common, color: color(look.color), dashArray: look.dash, weight, opacity, smoothFactor: 0 }).addTo(chosenLayer);
      }
    }
  }
  for (const number of ofSnapshot.get(chosen) || []) {
    const [block, row] = all[number];
    const own = groupColor(groupOf(all[number]));
    if (block.x[row] !== null && block.y[row] !== null) {
      if (block.major[row] !== null) {
        L.polygon(ellipse(block.x[row], block.y[row], block.major[row], block.minor[row], block.turn[row]),
          { ...common, color: own, weight: 2, fillOpacity: 0.12, smoothFactor: 0 }).addTo(chosenLayer);
      }
      L.circleMarker(at(block.x[row], block.y[row]), { ...common, radius: 6, color: color("--paper"), weight: 1.5, fillColor: own, fillOpacity: 1 }).addTo(chosenLayer);
    }
    if (block.truth_x && block.truth_x[row] !== null) {
      L.circleMarker(at(block.truth_x[row], block.truth_y[row]), { ...common, radius: 7, color: color("--truth"), weight: 2, fill: false }).addTo(chosenLayer);
    }
  }
}

// The regions of 50, 90 and 95 % of the posterior of the chosen snapshot, and of maps of no snapshot.
function drawRegions() {
  regionLayer.clearLayers();
  const probe = document.createElement("canvas").getContext("2d");
  probe.fillStyle = color("--region");
  const shade = [1, 3, 5].map((k) => parseInt(probe.fillStyle.slice(k, k + 2), 16)), opacities = [0, 200, 110, 55];
  for (const posterior of data.posterior) {
    if (posterior.snapshot !== chosen && posterior.snapshot !== -1) continue;
    const [height, width] = posterior.shape, levels = atob(posterior.levels);
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    const context = canvas.getContext("2d"), picture = context.createImageData(width, height);
    for (let k = 0; k < levels.length; k++) picture.data.set([...shade, opacities[levels.charCodeAt(k)]], 4 * k);
    context.putImageData(picture, 0, 0);
    const place = L.latLngBounds(at(...posterior.low), at(...posterior.high));
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", "Regions of 50, 90 and 95 % of the posterior");
    L.svgOverlay(canvas, place, { pane: "regions", className: "region" }).addTo(regionLayer); // takes any element
  }
}

// The rows and the estimates of the chosen snapshot as text.
function listChosen() {
  const rows = get("rows"), parts = [];
  rows.replaceChildren();
  for (const block of data.measured) {
    const [start, stop] = block.rows.get(chosen) || [0, 0];
    if (stop === start) continue;
    const outliers = block.look.slice(start, stop).filter((look) => look === 2).length;
    parts.push(`${plural(stop - start, NOUNS[block.kind])}, ${outliers} flagged`);
    const unit = block.kind === "bearings" ? "deg" : "m", body = element("tbody"), head = element("tr");
    for (const word of [block.kind === "triplets" ? "Path" : "Sensor", `${NOUNS[block.kind]}, ${unit}`, "Row"]) head.append(element("th", word, { scope: "col" }));
    for (let row = start; row < Math.min(stop, start + 500); row++) {
      const line = element("tr", null, block.look[row] === 2 ? { class: "flagged" } : {});
      const reference = block.reference && block.kind === "arrivals" ? ` \u2212 ${sensors.name[block.reference[row]]}` : "";
      const name = block.kind === "triplets" ? row - start + 1 : sensors.name[block.sensor[row]] + reference;
      line.append(element("td", name), element("td", block.value[row], { class: "number" }), element("td", LOOKS[block.look[row]].word));
      body.append(line);
    }
    if (stop - start > 500) {
      const line = element("tr");
      line.append(element("td", `and ${stop - start - 500} more`, { colspan: "3" }));
      body.append(line);
    }
    const top = element("thead");
    top.append(head);
    rows.append(top, body);
  }
  const fixes = get("fixes"), body = element("tbody");
  fixes.replaceChildren(body);
  for (const number of ofSnapshot.get(chosen) || []) {
    for (const word of describe(number).split("\n").slice(1)) {
      const line = element("tr"), [name, value] = word.includes(": ") ? word.split(/: (.*)/s) : [word, ""];
      line.append(element("td", name), element("td", value, { class: "number" }));
      body.append(line);
    }
  }
  const id = data.snapshots[chosen];
  get("chosen-title").textContent = id === undefined ? "No snapshots" : `Snapshot ${id}${parts.length ? ": " + parts.join("; ") : ""}`;
  get("position").textContent = data.snapshots.length ? `${chosen + 1} of ${data.snapshots.length}` : "";
  get("snapshot").value = chosen;
  get("snapshot").setAttribute("aria-valuetext", id === undefined ? "none" : id);
  get("identifier").value = id === undefined ? "" : id;
  get("previous").disabled = chosen <= 0;
  get("next").disabled = chosen >= data.snapshots.length - 1;
}
function choose(snapshot) {
  chosen = Math.max(0, Math.min(data.snapshots.length - 1, snapshot));
  drawRegions();
  drawChosen();
  listChosen();
  for (const line of get("table").querySelectorAll("tbody tr")) line.classList.toggle("chosen", line.dataset.snapshot === String(chosen));
}

// The table of estimates.
const some = (name) => data.estimates.some((block) => block[name]);
const column = (head, text, value) => ({ head, text, value: value || text, isNumber: Boolean(value) });
const numbers = (head, name, decimals, shift) => column(head,
  (block, row) => (block[name] ? fixed(block[name][row] === null ? null : block[name][row] + (shift || 0), decimals === undefined ? block.decimals : decimals) : ""),
  (block, row) => (block[name] && block[name][row] !== null ? block[name][row] : Infinity));
const plain = (head, name) => column(head, (block, row) => (block[name] ? String(block[name][row]) : ""), (block, row) => (block[name] ? block[name][row] : 0));
const collator = new Intl.Collator("en", { numeric: true });
const columns = [
  column("Snapshot", (block, row) => data.snapshots[block.snapshot[row]]),
  column("Estimate", (block, row) => groups[block.first + block.group[row]]),
  ...(some("target") ? [plain("Target", "target")] : []),
  ...(some("alternative") ? [plain("Alternative", "alternative")] : []),
  numbers("x, m", "x", undefined, origin[0]),
  numbers("y, m", "y", undefined, origin[1]),
  ...(some("z_m") ? [numbers("z, m", "z_m")] : []),
  ...(some("lat_deg") ? [numbers("Latitude", "lat_deg", 6), numbers("Longitude", "lon_deg", 6)] : []),
  column("95 % ellipse, m", (block, row) => (block.major[row] === null ? "" : `${block.major[row]} \u00d7 ${block.minor[row]}`), (block, row) => (block.major[row] === null ? Infinity : block.major[row])),
  ...(some("error") ? [numbers("Error, m", "error")] : []),
  column("Status", (block, row) => block.statuses[block.status[row]]),
  ...(some("fit_p_value") ? [numbers("Fit p-value", "fit_p_value", 4)] : []),
];
let shown = all.map((_, number) => number), sorted = null, firstRow = 0, texts = null;

function makeTable() {
  if (!all.length) {
    get("estimates").hidden = true;
    return;
  }
  const head = element("tr");
  columns.forEach((column, number) => {
    const cell = element("th", null, { scope: "col", "aria-sort": "none", class: column.isNumber ? "number" : "" });
    const button = element("button", column.head, { type: "button" });
    button.addEventListener("click", () => sortBy(number));
    cell.append(button);
    head.append(cell);
  });
  const top = element("thead");
  top.append(head);
  get("table").append(element("caption", "Estimates; the first column chooses the snapshot on the map"), top, element("tbody"));
  fillTable();
}
function sortBy(number) {
  const down = sorted && sorted.number === number && !sorted.down;
  sorted = { number, down };
  get("table").querySelectorAll("th").forEach((cell, k) => cell.setAttribute("aria-sort", k === number ? (down ? "descending" : "ascending") : "none"));
  filter();
}
function filter() {
  const wanted = get("filter").value.trim().toLowerCase();
  if (wanted && !texts) texts = all.map(([block, row]) => columns.map(({ text }) => text(block, row)).join("\n").toLowerCase());
  shown = all.map((_, number) => number).filter((number) => !wanted || texts[number].includes(wanted));
  if (sorted) {
    const { value, isNumber } = columns[sorted.number], keys = all.map(([block, row]) => value(block, row));
    const sign = sorted.down ? -1 : 1;
    shown.sort((a, b) => {
      const [p, q] = [keys[a], keys[b]];
      if (!isNumber) return sign * collator.compare(p, q) || a - b;
      if (p === Infinity || q === Infinity) return (p === Infinity) - (q === Infinity) || a - b;
      return sign * (p - q) || a - b;
    });
  }
  firstRow = 0;
  fillTable();
}
function fillTable() {
  const body = element("tbody");
  for (const number of shown.slice(firstRow, firstRow + PER_PAGE)) {
    const [block, row] = all[number], line = element("tr", null, { "data-snapshot": block.snapshot[row] });
    if (block.snapshot[row] === chosen) line.classList.add("chosen");
    columns.forEach(({ text, isNumber }, k) => {
      const words = text(block, row), cell = element("td", k ? words : null, isNumber ? { class: "number" } : {});
      if (!k) {
        const button = element("button", words, { type: "button" });
        button.addEventListener("click", () => choose(block.snapshot[row]));
        cell.append(button);
      }
      line.append(cell);
    });
    body.append(line);
  }
  get("table").querySelector("tbody").replaceWith(body);
  const last = Math.min(firstRow + PER_PAGE, shown.length);
  get("matches").textContent = `${plural(shown.length, "row")} of ${all.length.toLocaleString("en")}`;
  get("page-position").textContent = shown.length ? `Rows ${firstRow + 1} to ${last} of ${shown.length}` : "No rows";
  get("page-previous").disabled = firstRow === 0;
  get("page-next").disabled = last >= shown.length;
}
function turnPage(step) {
  firstRow += step * PER_PAGE;
  fillTable();
}

// What does not change: header, legend, statistics, provenance.
function sample(look) {
  const drawing = svg("svg", { width: 34, height: 14, viewBox: "0 0 34 14", "aria-hidden": "true" });
  if (look.dot) drawing.append(svg("circle", { cx: 17, cy: 7, r: 5, fill: look.hollow ? "none" : `var(${look.color})`, stroke: `var(${look.color})`, "stroke-width": 2, opacity: look.opacity || 1 }));
  else drawing.append(svg("line", { x1: 0, x2: 34, y1: 7, y2: 7, stroke: `var(${look.color})`, "stroke-width": look.width || 2, "stroke-dasharray": look.dash || "none" }));
  return drawing;
}
function legend() {
  const add = (picture, words) => {
    const item = element("li");
    item.append(picture, element("span", words));
    get("legend").append(item);
  };
  if (sensors.name.length) add(triangle(), "sensor");
  if (plane.reflectors.length) add(sample({ color: "--mirror", width: 4 }), "reflector");
  for (const block of data.measured) {
    LOOKS.forEach((look, number) => {
      if (block.look.includes(number)) add(sample(look), `${CURVES[block.kind]}, ${look.word}`);
    });
  }
  groups.forEach((title, number) => add(sample({ dot: true, color: `--group${number % 6}` }), `${title}, with its 95 % ellipse`));
  for (const [opacity, share] of data.posterior.length ? [[0.78, 50], [0.43, 90], [0.22, 95]] : []) add(sample({ dot: true, color: "--region", opacity }), `${share} % of the posterior`);
  if (some("truth_x")) add(sample({ dot: true, hollow: true, color: "--truth" }), "truth");
}
function table(content) {
  const made = element("table"), head = element("tr"), top = element("thead"), body = element("tbody");
  const isNumber = content.head.map((_, k) => content.rows.every((row) => row[k] === null || typeof row[k] === "number"));
  content.head.forEach((word, k) => head.append(element("th", word, { scope: "col", class: isNumber[k] ? "number" : "" })));
  for (const row of content.rows) {
    const line = element("tr");
    row.forEach((cell, k) => line.append(element("td", cell === null ? "\u2013" : cell, isNumber[k] ? { class: "number" } : {})));
    body.append(line);
  }
  top.append(head);
  made.append(element("caption", content.title), top, body);
  const wide = element("div", null, { class: "wide", tabindex: "0", role: "region", "aria-label": content.title });
  wide.append(made);
  return wide;
}
function describeFiles() {
  const counts = data.files.map((file) => {
    const parts = [file.kind ? `${file.content} of ${file.kind}` : file.content];
    if (file.snapshots !== null) parts.push(plural(file.snapshots, "snapshot"));
    if (file.rows !== null) parts.push(plural(file.rows, "row"));
    return `${file.name}: ${parts.join(", ")}`;
  });
  get("summary").textContent = counts.join("; ") + (data.frame ? `. Places on earth: ${data.frame}` : "");
  for (const note of data.notes) get("notes").append(element("li", note));
  data.tables.forEach((content) => {
    get("statistics").append(table(content));
    if (content.note) get("statistics").append(element("p", content.note, { class: "note" }));
  });
  get("statistics").hidden = !data.tables.length;
  data.files.forEach((file, number) => {
    const list = element("dl");
    get("provenance").append(element("h3", counts[number]));
    for (const [name, value] of file.provenance) list.append(element("dt", name), element("dd", value));
    get("provenance").append(file.provenance.length ? list : element("p", "No provenance: the file has no metadata.", { class: "note" }));
  });
}

get("control").addEventListener("submit", (event) => event.preventDefault());
get("snapshot").max = Math.max(data.snapshots.length - 1, 0);
get("snapshot").addEventListener("input", (event) => choose(Number(event.target.value)));
get("previous").addEventListener("click", () => choose(chosen - 1));
get("next").addEventListener("click", () => choose(chosen + 1));
function goTo() {
  const found = data.snapshots.indexOf(get("identifier").value.trim());
  get("identifier").setAttribute("aria-invalid", found < 0);
  if (found >= 0) choose(found);
}
get("identifier").addEventListener("change", goTo);
get("identifier").addEventListener("keydown", (event) => {
  if (event.key === "Enter") goTo();
});
for (const id of data.snapshots.slice(0, MOST_LISTED)) get("identifiers").append(element("option", null, { value: id }));
get("whole").addEventListener("click", () => map.fitBounds(bounds));
get("everything").addEventListener("change", drawBase);
get("filter").addEventListener("input", filter);
get("page-previous").addEventListener("click", () => turnPage(-1));
get("page-next").addEventListener("click", () => turnPage(1));
if (!sensors.name.length && !all.length && !data.measured.length && !data.posterior.length) get("picture").hidden = true;
describeFiles();
legend();
makeTable();
drawBase();
choose(0);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  drawRegions();
  drawBase();
  drawChosen();
});
addEventListener("beforeprint", () => map.invalidateSize());
})();

"use strict";
// The interactive map of a report: loops drawn on a canvas, found by a grid under the pointer.

function decoded(array) {
  const text = atob(array.data);
  const bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  const kinds = { f4: Float32Array, f8: Float64Array, i4: Int32Array, i8: BigInt64Array };
  return new kinds[array.type](bytes.buffer);
}

function readLoops(text) {
  const raw = JSON.parse(text);
  const loops = { ...raw, columns: {}, words: {} };
  for (const name of ["offsets", "corners", "grains", "links"]) loops[name] = decoded(raw[name]);
  for (const name of Object.keys(raw.columns)) {
    loops.columns[name] = decoded(raw.columns[name]);
    loops.words[name] = raw.columns[name].words;
  }
  loops.boxes = boxesOf(loops);
  loops.grid = gridOf(loops);
  return loops;
}

// Bounding boxes: low x, low y, high x, high y of each loop.
function boxesOf(loops) {
  const boxes = new Float32Array(4 * loops.count);
  for (let k = 0; k < loops.count; k++) {
    let a = Infinity, b = Infinity, c = -Infinity, d = -Infinity;
    for (let h = loops.offsets[k]; h < loops.offsets[k + 1]; h++) {
      const x = loops.corners[2 * h], y = loops.corners[2 * h + 1];
      if (x < a) a = x;
      if (x > c) c = x;
      if (y < b) b = y;
      if (y > d) d = y;
    }
    boxes.set([a, b, c, d], 4 * k);
  }
  return boxes;
}

function extentOf(boxes) {
  const all = [Infinity, Infinity, -Infinity, -Infinity];
  for (let k = 0; k < boxes.length; k += 4) {
    all[0] = Math.min(all[0], boxes[k]);
    all[1] = Math.min(all[1], boxes[k + 1]);
    all[2] = Math.max(all[2], boxes[k + 2]);
    all[3] = Math.max(all[3], boxes[k + 3]);
  }
  return all;
}

// About one bin a loop; each bin lists the loops whose box meets it.
function gridOf(loops) {
  const [x0, y0, x1, y1] = extentOf(loops.boxes);
  const size = Math.sqrt(Math.max(x1 - x0, 1e-30) * Math.max(y1 - y0, 1e-30) / Math.max(loops.count, 1));
  const columns = Math.max(1, Math.min(1000, Math.ceil((x1 - x0) / size)));
  const rows = Math.max(1, Math.min(1000, Math.ceil((y1 - y0) / size)));
  const grid = { x0, y0, size, columns, rows, bins: new Map() };
  for (let k = 0; k < loops.count; k++) {
    const [a, b] = binAt(grid, loops.boxes[4 * k], loops.boxes[4 * k + 1]);
    const [c, d] = binAt(grid, loops.boxes[4 * k + 2], loops.boxes[4 * k + 3]);
    for (let row = b; row <= d; row++) {
      for (let column = a; column <= c; column++) {
        const bin = row * columns + column;
        if (grid.bins.has(bin)) grid.bins.get(bin).push(k);
        else grid.bins.set(bin, [k]);
      }
    }
  }
  return grid;
}

function binAt(grid, x, y) {
  const within = (value, count) => Math.max(0, Math.min(count - 1, Math.floor(value)));
  return [within((x - grid.x0) / grid.size, grid.columns), within((y - grid.y0) / grid.size, grid.rows)];
}

// The loop under a point, -1 for none: the smallest one where several overlap.
function loopAt(loops, x, y) {
  const [column, row] = binAt(loops.grid, x, y);
  const near = loops.grid.bins.get(row * loops.grid.columns + column) || [];
  let found = -1, smallest = Infinity;
  for (const k of near) {
    const [a, b, c, d] = loops.boxes.subarray(4 * k, 4 * k + 4);
    if (x < a || x > c || y < b || y > d) continue;
    if ((c - a) * (d - b) < smallest && contains(loops, k, x, y)) {
      found = k;
      smallest = (c - a) * (d - b);
    }
  }
  return found;
}

function contains(loops, k, x, y) {
  const first = loops.offsets[k], end = loops.offsets[k + 1];
  let inside = false;
  for (let h = first, g = end - 1; h < end; g = h++) {
    const ax = loops.corners[2 * h], ay = loops.corners[2 * h + 1];
    const bx = loops.corners[2 * g], by = loops.corners[2 * g + 1];
    if (ay > y !== by > y && x < (bx - ax) * (y - ay) / (by - ay) + ax) inside = !inside;
  }
  return inside;
}

// A word has one colour on all maps of a page.
const hues = new Map();
function hueOf(word, palette) {
  if (!hues.has(word)) hues.set(word, hues.size % palette.length);
  return hues.get(word);
}

// Colour number of each loop (-1: not known), the palette and the ends of the scale.
function colouring(loops, name) {
  const values = loops.columns[name];
  const shade = new Int16Array(loops.count).fill(-1);
  if (name === "order") {
    const palette = loops.palettes.order, last = palette.length - 1;
    for (let k = 0; k < loops.count; k++) shade[k] = Math.min(values[k] - 3, last);
    return { shade, palette, low: "3", high: `${3 + last}+` };
  }
  const words = loops.words[name];
  if (words) {
    const palette = loops.palettes.order;
    for (let k = 0; k < loops.count; k++) if (words[values[k]]) shade[k] = hueOf(words[values[k]], palette);
    const named = words.filter((word) => word).map((word) => [word, palette[hueOf(word, palette)]]);
    return { shade, palette, named };
  }
  const known = Array.from(values).filter(Number.isFinite).sort((a, b) => a - b);
  if (known.length === 0) return { shade, palette: loops.palettes.sequential, low: "", high: "" };
  const at = (q) => known[Math.round(q * (known.length - 1))];
  let low = at(0.01), high = at(0.99);
  if (high <= low) [low, high] = [known[0], known[known.length - 1]];
  const signed = known[0] < 0 && known[known.length - 1] > 0;
  // Zero in the middle; each side has its own reach, so that few show as well.
  if (signed) {
    low = Math.min(low, known[0] / 4);
    high = Math.max(high, known[known.length - 1] / 4);
  }
  const palette = signed ? loops.palettes.diverging : loops.palettes.sequential;
  for (let k = 0; k < loops.count; k++) {
    const value = values[k];
    if (!Number.isFinite(value)) continue;
    let t = high > low ? (value - low) / (high - low) : 0;
    if (signed) t = value < 0 ? 0.5 - 0.5 * value / low : 0.5 + 0.5 * value / high;
    shade[k] = Math.max(0, Math.min(palette.length - 1, Math.floor(t * palette.length)));
  }
  return { shade, palette, low: shown(low), high: shown(high) };
}

function shown(value) {
  if (!Number.isFinite(value)) return "–";
  return Number.isInteger(value) ? String(value) : String(Number(value.toPrecision(6)));
}

function rowOf(loops, k) {
  const said = (name, value) => (loops.words[name] ? loops.words[name][value] || "–" : shown(value));
  const row = Object.keys(loops.columns).map((name) => [name, said(name, loops.columns[name][k])]);
  const ids = Array.from(loops.grains.subarray(loops.offsets[k], loops.offsets[k + 1]));
  return [...row, ["grains", ids.join(" ")]];
}

// A link to a loop of this page: #loop=17, of a series #snapshot=3&loop=17.
function linked(hash) {
  const given = new URLSearchParams(hash.replace(/^#/, ""));
  return { snapshot: given.get("snapshot"), loop: given.get("loop") };
}

// The row of a loop's number, -1 and what is wrong with it if there is none.
function rowOfNumber(loops, text) {
  const numbers = Array.from(loops.columns.loop || []), k = numbers.indexOf(Number(text));
  if (k >= 0 && text.trim() !== "") return [k, ""];
  const range = numbers.length ? `they are numbered ${numbers[0]} to ${numbers[numbers.length - 1]}` : "it has none";
  return [-1, `No loop "${text}" in ${loops.name ? `snapshot ${loops.name}` : "this snapshot"}: ${range}.`];
}

// `sources` are texts of maps, each read when it is first shown.
function startMap(sources, part) {
  const read = [], canvas = part.canvas, context = canvas.getContext("2d");
  const view = { scale: 1, x: 0, y: 0 };
  let loops, colours, hovered = -1, pinned = -1, waiting = false;

  function fit() {
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    const [x0, y0, x1, y1] = extentOf(loops.boxes);
    view.scale = 0.97 * Math.min(canvas.width / (x1 - x0), canvas.height / (y1 - y0));
    view.x = 0.5 * (x0 + x1);
    view.y = 0.5 * (y0 + y1);
    redraw();
  }
  const across = (x) => (x - view.x) * view.scale + 0.5 * canvas.width;
  const down = (y) => 0.5 * canvas.height - (y - view.y) * view.scale;
  const place = (event) => {
    const box = canvas.getBoundingClientRect(), ratio = canvas.width / box.width;
    const px = (event.clientX - box.left) * ratio, py = (event.clientY - box.top) * ratio;
    return [(px - 0.5 * canvas.width) / view.scale + view.x, (0.5 * canvas.height - py) / view.scale + view.y];
  };
  function trace(path, k) {
    for (let h = loops.offsets[k]; h < loops.offsets[k + 1]; h++) {
      const x = across(loops.corners[2 * h]), y = down(loops.corners[2 * h + 1]);
      if (h === loops.offsets[k]) path.moveTo(x, y);
      else path.lineTo(x, y);
    }
    path.closePath();
  }
  function visible(k) {
    const [a, b, c, d] = loops.boxes.subarray(4 * k, 4 * k + 4);
    return across(c) >= 0 && across(a) <= canvas.width && down(b) >= 0 && down(d) <= canvas.height;
  }
  // One path a colour: thousands of polygons in a few strokes.
  function draw() {
    waiting = false;
    context.fillStyle = "#ffffff";
    context.fillRect(0, 0, canvas.width, canvas.height);
    const paths = new Map();
    let seen = 0;
    for (let k = 0; k < loops.count; k++) {
      if (!visible(k)) continue;
      seen += 1;
      if (!paths.has(colours.shade[k])) paths.set(colours.shade[k], new Path2D());
      trace(paths.get(colours.shade[k]), k);
    }
    context.lineWidth = 1;
    for (const [shade, path] of paths) {
      context.fillStyle = shade < 0 ? "#d9d9d9" : colours.palette[shade];
      context.fill(path, "evenodd");
      context.strokeStyle = seen < 8000 ? "#ffffff" : context.fillStyle;
      context.stroke(path);
    }
    if (part.links.checked) chains();
    for (const k of new Set([pinned, hovered])) if (k >= 0) outline(k);
  }
  // Force chains: their links, black on white so that any colour lets them show.
  function chains() {
    const path = new Path2D(), ends = loops.links;
    for (let k = 0; k < ends.length; k += 4) {
      path.moveTo(across(ends[k]), down(ends[k + 1]));
      path.lineTo(across(ends[k + 2]), down(ends[k + 3]));
    }
    context.lineCap = "round";
    for (const [colour, width] of [["#ffffff", 5], ["#000000", 2.5]]) {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.stroke(path);
    }
  }
  function outline(k) {
    const path = new Path2D();
    trace(path, k);
    context.strokeStyle = "#000000";
    context.lineWidth = 3;
    context.stroke(path);
  }
  function redraw() {
    if (!waiting) window.requestAnimationFrame(draw);
    waiting = true;
  }
  function show(k) {
    part.row.replaceChildren();
    if (k < 0) {
      part.row.textContent = "Point at a loop. Click to pin its data.";
      return;
    }
    const table = document.createElement("table");
    for (const [name, value] of rowOf(loops, k)) {
      const line = table.insertRow();
      line.insertCell().textContent = name;
      line.insertCell().textContent = value;
    }
    part.row.append(table);
  }
  function choose(name) {
    colours = colouring(loops, name);
    part.bar.hidden = Boolean(colours.named);
    part.high.replaceChildren();
    if (colours.named) {
      part.low.textContent = "";
      for (const [word, colour] of colours.named) {
        const patch = document.createElement("span");
        patch.className = "patch";
        patch.style.background = colour;
        part.high.append(patch, `${word} `);
      }
      redraw();
      return;
    }
    const few = colours.palette.length < 10, step = 100 / colours.palette.length;
    const stops = few ? colours.palette.map((c, k) => `${c} ${k * step}% ${(k + 1) * step}%`) : colours.palette;
    part.bar.style.background = `linear-gradient(to right, ${stops.join(", ")})`;
    part.low.textContent = colours.low;
    part.high.textContent = colours.high;
    redraw();
  }
  function zoom(factor, x, y) {
    view.x = x + (view.x - x) / factor;
    view.y = y + (view.y - y) / factor;
    view.scale *= factor;
    redraw();
  }
  function pin(k) {
    pinned = k;
    show(k);
    redraw();
    if (k < 0 || !loops.columns.loop) return;
    part.find.value = loops.columns.loop[k];
    const at = sources.length > 1 ? `snapshot=${loops.snapshot}&` : "";
    window.history.replaceState(null, "", `#${at}loop=${part.find.value}`);
  }
  function find(text) {
    const [k, wrong] = rowOfNumber(loops, text);
    if (k >= 0) {
      view.x = 0.5 * (loops.boxes[4 * k] + loops.boxes[4 * k + 2]);
      view.y = 0.5 * (loops.boxes[4 * k + 1] + loops.boxes[4 * k + 3]);
    }
    pin(k);
    if (k < 0) part.row.textContent = wrong;
  }
  // Place and colours stay when another snapshot is shown.
  function take(k) {
    read[k] = read[k] || readLoops(sources[k]);
    loops = read[k];
    hovered = -1;
    const before = part.colour.value;
    part.colour.replaceChildren();
    for (const name of loops.colour_by) part.colour.add(new Option(name.replaceAll("_", " "), name));
    if (loops.colour_by.includes(before)) part.colour.value = before;
    choose(part.colour.value);
    pin(-1);
  }
  function follow() {
    const { snapshot, loop } = linked(window.location.hash);
    if (loop === null) return;
    const k = snapshot === null ? Number(part.snapshot.value) : part.numbers.indexOf(snapshot);
    if (k < 0) {
      part.row.textContent = `No map of snapshot "${snapshot}" on this page: it has ${part.numbers.join(", ")}.`;
      return;
    }
    part.snapshot.value = String(k);
    take(k);
    find(loop);
  }

  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = { x: event.clientX, y: event.clientY, moved: false };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (held) {
      const ratio = canvas.width / canvas.clientWidth / view.scale;
      if (Math.hypot(event.clientX - held.x, event.clientY - held.y) > 3 || held.moved) {
        view.x -= (event.clientX - held.x) * ratio;
        view.y += (event.clientY - held.y) * ratio;
        held = { x: event.clientX, y: event.clientY, moved: true };
        redraw();
      }
      return;
    }
    const k = loopAt(loops, ...place(event));
    if (k !== hovered) {
      hovered = k;
      show(k >= 0 ? k : pinned);
      redraw();
    }
  });
  canvas.addEventListener("pointerup", (event) => {
    if (held && !held.moved) pin(loopAt(loops, ...place(event)));
    held = null;
  });
  canvas.addEventListener("pointercancel", () => { held = null; });
  canvas.addEventListener("pointerleave", () => {
    hovered = -1;
    show(pinned);
    redraw();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY), ...place(event));
  }, { passive: false });
  part.reset.addEventListener("click", fit);
  part.closer.addEventListener("click", () => zoom(1.5, view.x, view.y));
  part.farther.addEventListener("click", () => zoom(1 / 1.5, view.x, view.y));
  part.find.addEventListener("change", () => find(part.find.value));
  part.links.addEventListener("change", redraw);
  part.colour.addEventListener("change", () => choose(part.colour.value));
  part.snapshot.addEventListener("change", () => take(Number(part.snapshot.value)));
  window.addEventListener("resize", fit);
  window.addEventListener("hashchange", follow);
  take(Number(part.snapshot.value));
  fit();
  follow();
}

if (typeof document !== "undefined") {
  const named = (id) => document.getElementById(id);
  const parts = ["canvas", "row", "colour", "bar", "low", "high", "reset", "closer", "farther", "find", "links"];
  const part = Object.fromEntries([...parts, "snapshot"].map((name) => [name, named(`map-${name}`)]));
  part.numbers = Array.from(part.snapshot.options, (option) => option.dataset.number);
  startMap(part.numbers.map((_, k) => named(`map-data-${k}`).textContent), part);
}
if (typeof module !== "undefined") {
  module.exports = { readLoops, loopAt, colouring, rowOf, shown, linked, rowOfNumber };
}

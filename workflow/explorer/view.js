// The drawing part of the explorer: numbers as text, charts, the map and the replay. It computes nothing.
"use strict";

const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
const element = (id) => document.getElementById(id);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
const escaped = (text) => text.replace(/[&<>"]/g, (sign) => `&#${sign.charCodeAt(0)};`);

const capital = (text) => text[0].toUpperCase() + text.slice(1);

// An exponent in raised digits.
const raised = (power) => String(power).replace("-", "⁻").replace(/\d/g, (digit) => SUPERSCRIPTS[digit]);

// A number as in the tables of the book, with two significant digits, such as 3.2 × 10⁻⁶, 0.032 or 7,840.
function readable(value, digits = 2) {
  if (value === null || Number.isNaN(value)) return "–";
  const size = Math.abs(value);
  if (size === Infinity) return "∞";
  if (size === 0 || (size >= 0.001 && size < 1e6)) {
    const decimals = Number.isInteger(value) ? 0 : Math.max(digits - 1 - Math.floor(Math.log10(size)), 0);
    return value.toLocaleString("en-US", { minimumFractionDigits: decimals, maximumFractionDigits: decimals });
  }
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const short = mantissa.includes(".") ? mantissa.replace(/\.?0+$/, "") : mantissa;
  return `${short}\u00a0×\u00a010${raised(Number(exponent))}`; // never broken into two lines
}

// Two ends of an interval; the power of ten of the larger one is written once where both share it.
function interval(low, high) {
  const digits = high < 1.2 * low ? 3 : 2, [first, last] = [readable(low, digits), readable(high, digits)];
  const power = /\u00a0×\u00a010.*$/.exec(last), isShared = power && first.endsWith(power[0]);
  return `${isShared ? first.replace(power[0], "") : first} – ${last}`;
}

// The number of encounters with one event on average, such as 170,000, with two significant digits.
const oneIn = (value) => (1 / value).toLocaleString("en-US", { maximumSignificantDigits: 2 });

function percent(value) {
  const rounded = Math.round(100 * value); // 0 or 100 only if the share is 0 or 1
  if (rounded === 100 && value < 1) return "more than 99 %";
  return rounded === 0 && value > 0 ? "less than 1 %" : `${rounded} %`;
}

// Intervals of 50, 80 and 95 % with the median, one row for each {name, colour, quantiles}, on a logarithmic axis.
function drawIntervals(rows, width) {
  const shown = rows.filter((row) => row.quantiles[6] > 0), height = 44 * rows.length + 30;
  if (!shown.length) return "";
  const least = Math.min(...shown.map((row) => Math.max(row.quantiles[0], row.quantiles[6] * 1e-4)));
  const [low, high] = [Math.floor(Math.log10(least)), Math.ceil(Math.log10(Math.max(...shown.map((row) => row.quantiles[6]))))];
  const x = (value) => 8 + (width - 16) * Math.min(Math.max((Math.log10(Math.max(value, 1e-300)) - low) / Math.max(high - low, 1), 0), 1);
  const parts = [];
  const every = Math.ceil((high - low + 1) * 58 / width);
  for (let power = low; power <= high; power++) {
    const at = x(10 ** power), anchor = power === low ? "start" : power === high ? "end" : "middle";
    parts.push(`<line x1="${at}" x2="${at}" y1="0" y2="${height - 24}" stroke="var(--line)"/>`);
    if ((power - low) % every === 0) {
      const label = power === 0 ? "1" : `10${raised(power)}`;
      parts.push(`<text class="quiet" x="${at}" y="${height - 6}" text-anchor="${anchor}">${label}</text>`);
    }
  }
  rows.forEach((row, place) => {
    const y = 44 * place + 32;
    parts.push(`<text x="8" y="${y - 14}" style="fill:var(--${row.colour});font-weight:600">${escaped(row.name)}</text>`);
    if (!(row.quantiles[6] > 0)) return;
    [[0, 6, 2], [1, 5, 6], [2, 4, 12]].forEach(([from, to, thick]) => {
      const [a, b] = [x(row.quantiles[from]), x(row.quantiles[to])];
      const opacity = thick === 12 ? 1 : 0.55;
      parts.push(`<line x1="${a}" x2="${Math.max(b, a + 1)}" y1="${y}" y2="${y}" stroke="var(--${row.colour})"
        stroke-width="${thick}" stroke-opacity="${opacity}"/>`);
    });
    parts.push(`<circle cx="${x(row.quantiles[3])}" cy="${y}" r="4.5" fill="var(--page)" stroke="var(--${row.colour})" stroke-width="2.5"/>`);
  });
  const words = rows.map((row) => `${row.name}: median ${readable(row.quantiles[3])}, 80 % interval ${readable(row.quantiles[1])} to ${readable(row.quantiles[5])}`);
  return `<svg height="${height}" viewBox="0 0 ${width} ${height}" role="img" aria-label="${escaped(words.join(". "))}">${parts.join("")}</svg>`;
}

function fillTable(table, head, rows) {
  const cell = (kind, text) => `<${kind}${kind === "th" ? ' scope="col"' : ""}>${text}</${kind}>`;
  table.innerHTML = `<thead><tr>${head.map((text) => cell("th", text)).join("")}</tr></thead>
    <tbody>${rows.map((row) => `<tr>${row.map((text) => cell("td", text)).join("")}</tr>`).join("")}</tbody>`;
}

// The map at one value of the slider: crashes by impact speed, records, the replayed and the likeliest encounter.
class MapView {
  constructor(canvas, [, horizontal, vertical]) {
    Object.assign(this, { canvas, horizontal, vertical, margin: { left: 44, right: 10, top: 8, bottom: 38 } });
  }

  get box() {
    const { left, right, top, bottom } = this.margin;
    return { x: left, y: top, w: this.canvas.clientWidth - left - right, h: this.canvas.clientHeight - top - bottom };
  }

  place(across, up) {
    const { x, y, w, h } = this.box;
    return [x + (across / this.horizontal.high) * w, y + h - (up / this.vertical.high) * h];
  }

  encounter(px, py) {
    const { x, y, w, h } = this.box;
    const across = Math.min(Math.max((px - x) / w, 0.001), 1) * this.horizontal.high;
    return [across, Math.min(Math.max((y + h - py) / h, 0), 1) * this.vertical.high];
  }

  // Values of the middles of the cells on both axes.
  cells() {
    const { w, h } = this.box, columns = Math.max(Math.round(w / 6), 20), rows = Math.max(Math.round(h / 5), 20);
    const across = new Float64Array(columns * rows), up = new Float64Array(columns * rows);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        across[row * columns + column] = ((column + 0.5) / columns) * this.horizontal.high;
        up[row * columns + column] = ((row + 0.5) / rows) * this.vertical.high;
      }
    }
    return { columns, rows, across, up };
  }

  // Draw {cells, found} of a simulated vehicle, or the lines of a map, [across, start, end]; then records, runs and marks.
  draw({ cells, found, lines, records, runs, marks }) {
    const ratio = window.devicePixelRatio || 1, { canvas } = this, pen = canvas.getContext("2d");
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    pen.scale(ratio, ratio);
    if (cells) this.drawCells(pen, cells, found);
    if (lines) this.drawLines(pen, lines);
    this.drawAxes(pen);
    pen.globalAlpha = 0.55;
    records.forEach(([across, up]) => this.drawDot(pen, across, up, "record", 1.8));
    pen.globalAlpha = 1;
    (runs || []).forEach(([across, up, crash]) => this.drawDot(pen, across, Math.min(up, this.vertical.high), crash ? "fast" : "study", 4));
    marks.forEach((mark) => this.drawMark(pen, mark));
  }

  drawDot(pen, across, up, shade, radius) {
    if (across > this.horizontal.high || up > this.vertical.high) return;
    const [px, py] = this.place(across, up);
    pen.fillStyle = colour(shade);
    pen.beginPath();
    pen.arc(px, py, radius, 0, 7);
    pen.fill();
  }

  drawCells(pen, { columns, rows }, { crash, impactSpeed }) {
    const { x, y, w, h } = this.box, shades = [colour("slow"), colour("middle"), colour("fast")];
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const place = row * columns + column;
        if (!crash[place]) continue;
        pen.fillStyle = shades[impactSpeed[place] > 10 ? 2 : impactSpeed[place] > 5 ? 1 : 0];
        const left = Math.floor(x + (column * w) / columns), bottom = Math.ceil(y + h - (row * h) / rows);
        const top = Math.floor(y + h - ((row + 1) * h) / rows);
        pen.fillRect(left, top, Math.ceil(x + ((column + 1) * w) / columns) - left, bottom - top);
      }
    }
  }

  drawLines(pen, lines) {
    pen.strokeStyle = colour("middle");
    pen.lineWidth = 2;
    lines.forEach(([across, start, end]) => {
      const [px, low] = this.place(across, start), high = this.place(across, Math.min(end, this.vertical.high))[1];
      pen.beginPath();
      pen.moveTo(px, low);
      pen.lineTo(px, high);
      pen.stroke();
    });
  }

  drawAxes(pen) {
    const { x, y, w, h } = this.box;
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = colour("quiet");
    pen.strokeStyle = colour("strong");
    pen.lineWidth = 1;
    pen.strokeRect(x + 0.5, y + 0.5, w, h);
    const ticks = (top, count) => {
      const step = [1, 2, 5, 10, 20, 50].find((size) => top / size <= count);
      return Array.from({ length: Math.floor(top / step) + 1 }, (_, k) => k * step);
    };
    pen.textAlign = "center";
    const title = ({ name, unit }) => `${capital(name)} [${unit}]`;
    ticks(this.horizontal.high, w / 60).forEach((across) => {
      const px = this.place(across, 0)[0];
      pen.fillText(across, px, y + h + 15);
      pen.fillRect(px, y + h, 1, 4);
    });
    pen.fillText(title(this.horizontal), x + w / 2, y + h + 32);
    pen.textAlign = "right";
    ticks(this.vertical.high, h / 40).forEach((up) => {
      const py = this.place(0, up)[1];
      pen.fillText(up, x - 7, py + 4);
      pen.fillRect(x - 4, py, 4, 1);
    });
    pen.save();
    pen.translate(12, y + h / 2);
    pen.rotate(-Math.PI / 2);
    pen.textAlign = "center";
    pen.fillText(title(this.vertical), 0, 0);
    pen.restore();
  }

  drawMark(pen, { across, up, kind }) {
    if (across > this.horizontal.high || up > this.vertical.high) return;
    const [px, py] = this.place(across, up);
    const strokes = kind === "cross" ? [[-9, 0, 9, 0], [0, -9, 0, 9]] : [[-6, -6, 6, 6], [-6, 6, 6, -6]];
    [[colour("page"), 6], [colour(kind === "cross" ? "own" : "text"), 2.5]].forEach(([shade, thick]) => {
      pen.strokeStyle = shade;
      pen.lineWidth = thick;
      strokes.forEach(([a, b, c, d]) => {
        pen.beginPath();
        pen.moveTo(px + a, py + b);
        pen.lineTo(px + c, py + d);
        pen.stroke();
      });
    });
  }
}

// A line chart over time; each line is {name, colour, values}; a vertical line marks the time now.
function drawChart(title, times, lines, now, width) {
  const height = 150, [left, right, top, bottom] = [34, 6, 26, 22], last = times[times.length - 1] || 1;
  const values = lines.flatMap((line) => line.values), low = Math.min(0, ...values), high = Math.max(...values, low + 1);
  const x = (time) => left + ((width - left - right) * time) / last;
  const y = (value) => height - bottom - ((height - top - bottom) * (value - low)) / (high - low);
  const parts = [`<text x="0" y="12" style="font-weight:600">${escaped(title)}</text>`];
  const ticks = [low, 0, high].filter((value, k, all) => value === 0 || Math.abs(y(value) - y(0)) > 14);
  [...new Set(ticks)].forEach((value) => {
    parts.push(`<line x1="${left}" x2="${width - right}" y1="${y(value)}" y2="${y(value)}" stroke="var(--line)"/>
      <text class="quiet" x="${left - 5}" y="${y(value) + 4}" text-anchor="end">${readable(value)}</text>`);
  });
  lines.forEach((line) => {
    const points = line.values.map((value, k) => `${x(times[k]).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
    const dashes = line.dashed ? ' stroke-dasharray="5 3"' : "";
    parts.push(`<polyline points="${points}" fill="none" stroke="var(--${line.colour})" stroke-width="2"${dashes}/>`);
  });
  const words = lines.map((line) => `${line.name} from ${readable(Math.abs(line.values[0]))} to ${readable(Math.abs(line.values[line.values.length - 1]))}`);
  parts.push(`<line x1="${x(now)}" x2="${x(now)}" y1="${top - 4}" y2="${height - bottom}" stroke="var(--text)" stroke-width="1"/>
    <text class="quiet" x="${left}" y="${height - 5}">0 s</text>
    <text class="quiet" x="${width - right}" y="${height - 5}" text-anchor="end">${last.toFixed(1)} s</text>`);
  return `<svg height="${height}" viewBox="0 0 ${width} ${height}" role="img" aria-label="${escaped(`${title}: ${words.join(", ")}`)}">${parts.join("")}</svg>`;
}

// The two cars on the road at one state of a cut-in, seen from above.
function drawFollowing(state, states, width) {
  const furthest = Math.max(...states.map(({ range }) => range));
  const height = 60, car = Math.max(width * 0.06, 26), metre = (width - 2 * car - 12) / Math.max(furthest, 1);
  const host = 4, lead = host + car + Math.max(state.range, -2) * metre;
  const box = (left, shade) => `<rect x="${left}" y="20" width="${car}" height="20" rx="5" fill="var(--${shade})"/>`;
  const brake = state.acceleration < -0.5 ? `<rect x="${host - 3}" y="22" width="4" height="16" rx="2" fill="var(--fast)"/>` : "";
  return `<svg height="${height}" viewBox="0 0 ${width} ${height}" role="img" aria-label="The vehicle ${readable(Math.max(state.range, 0))} m behind the other car">
    <rect y="10" width="${width}" height="40" fill="var(--road)"/>${box(lead, "study")}${box(host, "own")}${brake}
    <text class="quiet" x="${host + car / 2}" y="8" text-anchor="middle">vehicle</text>
    <text class="quiet" x="${Math.max(lead + car / 2, host + car + 40)}" y="58" text-anchor="middle">other car</text></svg>`;
}

// The paths of both cars at one state of a left turn, seen from above: the host drives to the right.
function drawTurning(state, states, width) {
  const longest = Math.max(...states.map(({ ahead }) => ahead), 10), widest = Math.max(...states.map(({ aside }) => Math.abs(aside)), 4);
  const height = 110, metre = Math.min((width - 60) / (longest + 8), 14), host = Math.max(24, width - 30 - (longest + 4) * metre), road = 70;
  const up = Math.min(metre, 46 / widest), x = host + state.ahead * metre, y = road - state.aside * up;
  const box = (left, top, shade) => `<rect x="${left - 13}" y="${top - 7}" width="26" height="14" rx="4" fill="var(--${shade})"/>`;
  const brake = state.acceleration < -0.5 ? `<rect x="${host - 17}" y="${road - 6}" width="4" height="12" rx="2" fill="var(--fast)"/>` : "";
  return `<svg height="${height}" viewBox="0 0 ${width} ${height}" role="img" aria-label="The turning car ${readable(Math.abs(state.ahead))} m ${state.ahead < 0 ? "behind" : "ahead"} and ${readable(Math.abs(state.aside))} m aside">
    <rect y="${road - 12}" width="${width}" height="24" fill="var(--road)"/>${box(x, Math.min(Math.max(y, 8), height - 8), "study")}${box(host, road, "own")}${brake}
    <text class="quiet" x="${host}" y="${road + 26}" text-anchor="middle">vehicle</text>
    <text class="quiet" x="${Math.min(Math.max(x, 40), width - 40)}" y="${Math.min(Math.max(y, 8), height - 8) - 11}" text-anchor="middle">turning car</text></svg>`;
}

// What a replay shows of each kind of simulation: a scene, charts over time, the columns of the table, and words.
const fixed = (digits, name) => (state) => (Number.isFinite(state[name]) ? state[name].toFixed(digits) : "–");
const yes = ({ emergency }) => (emergency ? "yes" : "no");
const ACCELERATION = { title: "Acceleration [m/s²]", lines: [["acceleration", "own", "acceleration"]] };
const FOLLOWING = {
  scene: drawFollowing,
  charts: [
    { title: "Range [m]", lines: [["range", "own", "range"]] },
    { title: "Speed [m/s], other car dashed", lines: [["vehicle", "own", "speed"], ["other car", "study", "lead", true]] },
    ACCELERATION,
  ],
  columns: [["time [s]", fixed(1, "time")], ["range [m]", fixed(2, "range")], ["vehicle [m/s]", fixed(2, "speed")],
    ["other car [m/s]", fixed(2, "lead")], ["acceleration [m/s²]", fixed(2, "acceleration")], ["TTC [s]", fixed(2, "ttc")], ["emergency", yes]],
  now: (state) => `Range ${state.range.toFixed(1)} m; vehicle ${state.speed.toFixed(1)} m/s, other car ${state.lead.toFixed(1)} m/s`,
  closest: "the smallest range is", ends: (states) => states[states.length - 1].time,
  map: "White areas at large closing speeds have a reason: a car that limits its own speed begins no cut-in faster than this limit.",
};
const TURNING = {
  scene: drawTurning,
  charts: [
    { title: "Turning car [m], aside dashed", lines: [["ahead", "own", "ahead"], ["aside", "study", "aside", true]] },
    { title: "Speed of the vehicle [m/s]", lines: [["vehicle", "own", "speed"]] },
    ACCELERATION,
  ],
  columns: [["time [s]", fixed(1, "time")], ["ahead [m]", fixed(2, "ahead")], ["aside [m]", fixed(2, "aside")],
    ["vehicle [m/s]", fixed(2, "speed")], ["acceleration [m/s²]", fixed(2, "acceleration")], ["emergency", yes]],
  now: (state) => `The turning car is ${Math.abs(state.ahead).toFixed(1)} m ${state.ahead < 0 ? "behind" : "ahead"} and ${Math.abs(state.aside).toFixed(1)} m ${state.aside < 0 ? "beyond the path" : "aside"}; vehicle ${state.speed.toFixed(1)} m/s`,
  closest: "the smallest distance of the centres is", ends: (states, contact) => (states.find((s) => Math.hypot(s.ahead, s.aside) < contact) || states[states.length - 1]).time,
  map: "",
};
const SHOWN = { car: FOLLOWING, driver: FOLLOWING, turn: TURNING };

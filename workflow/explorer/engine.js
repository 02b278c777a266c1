// The answer of the explorer: sums over the lines of the laws, for the base law and for every draw.
"use strict";

const TYPES = { f4: Float32Array, u2: Uint16Array, u1: Uint8Array };
// How a first result and the settled one are computed: on every how many lines, in strata of which width of the
// cumulative hazard, and for how wide a run of an event that is an upper set nothing beyond it is simulated.
const QUICK = { every: 6, step: 0.5, enough: 3 }, SETTLED = { every: 1, step: 0.25, enough: 6 };
const LEAST = 1024; // lines of a first result, if the page has so many
const BLOCK = 128; // lines that are simulated between two pauses

// The four weights of cubic interpolation at place x between n nodes, and the first of the four nodes.
function cubic(x, n) {
  const first = Math.min(Math.max(Math.floor(x) - 1, 0), n - 4), t = x - first;
  return [first, [
    -(t - 1) * (t - 2) * (t - 3) / 6, t * (t - 2) * (t - 3) / 2, -t * (t - 1) * (t - 3) / 2, t * (t - 1) * (t - 2) / 6,
  ]];
}

// The point of a stratum of cumulative hazards below which a share of its probability lies.
const inside = (low, width, share) => low - Math.log1p(share * Math.expm1(-width));

class Engine {
  static async load(text, block) {
    const packed = Uint8Array.from(atob(block), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Engine(JSON.parse(text), new Uint8Array(await new Response(stream).arrayBuffer()));
  }

  constructor(meta, bytes) {
    Object.assign(this, { meta, data: {} });
    for (const [name, place] of Object.entries(meta.arrays)) this.data[name] = unpacked(bytes, place);
    this.prepareLines();
    this.prepareRatios();
  }

  // Vehicles

  vehicle(name) {
    return this.meta.vehicles.find((vehicle) => vehicle.name === name);
  }

  // The numbers of a vehicle by name, with each of its sliders at a stop.
  numbers(vehicle, stops) {
    const texts = Object.assign({}, vehicle.numbers, ...vehicle.sliders.map((slider, k) => slider.stops[stops[k]].changes));
    return Object.fromEntries(Object.entries(texts).map(([name, text]) => [name, Number(text)]));
  }

  // Laws

  prepareLines() {
    const { depth, origin, step } = this.meta.lines, count = this.data.line_first.length;
    const levels = this.data.along, values = new Float32Array(levels.length);
    for (let level = 0; level <= depth; level++) {
      for (let line = 0; line < count; line++) {
        const place = level * count + line;
        values[place] = levels[place] * step + (level ? values[place - count] : origin);
      }
    }
    this.values = values;
    this.lines = count;
    const { fine: [vn, rn], by_line: byLine } = this.meta.laws;
    this.corner = [];
    for (let line = 0; line < count && !byLine; line++) {
      this.corner.push([...cubic(this.data.line_first_node[line], vn), ...cubic(this.data.line_second_node[line], rn)]);
    }
  }

  // Ratios at the fine nodes from the stored logarithms at the coarse ones, shape (draws, nodes). If they are stored by
  // line, the nodes are the lines.
  prepareRatios() {
    const { laws } = this.meta, [v0, r0, l0] = laws.coarse, [v1, r1, l1] = laws.fine;
    const draws = laws.order.length, size = v0 * r0 * l0, stored = this.data.ratios;
    const sums = new Uint16Array(size), own = new Float32Array(size);
    this.draws = draws;
    this.ratios = new Float32Array(draws * v1 * r1 * l1);
    for (let k = 0; k < draws; k++) {
      for (let node = 0; node < size; node++) sums[node] += stored[k * size + node];
      for (let node = 0; node < size; node += l0) {
        for (let level = 0, sum = 0; level < l0; level++) {
          sum = (sum + sums[node + level]) & 0xffff;
          own[node + level] = sum * laws.ratio_step + laws.ratio_low;
        }
      }
      const alongRoot = laws.by_line ? own : spread(own, this.data.refine_second, v0, r1, r0, l0);
      const alongBoth = laws.by_line ? own : spread(alongRoot, this.data.refine_first, 1, v1, v0, r1 * l0);
      const fine = spread(alongBoth, this.data.refine_level, v1 * r1, l1, l0, 1);
      const start = laws.order[k] * fine.length;
      for (let node = 0; node < fine.length; node++) this.ratios[start + node] = Math.exp(fine[node]);
    }
  }

  // Values of the variable along lines at cumulative hazards under the base law.
  along(lines, hazards) {
    const { depth, limits: [low, high] } = this.meta.lines, values = new Float64Array(lines.length);
    for (let k = 0; k < lines.length; k++) {
      const [first, weight] = cubic(Math.sqrt(hazards[k] * depth), depth + 1);
      let value = 0;
      for (let j = 0; j < 4; j++) value += weight[j] * this.values[(first + j) * this.lines + lines[k]];
      values[k] = Math.min(Math.max(value, low), high);
    }
    return values;
  }

  // The columns of encounters in the order of the scenario's variables, from those of the axes.
  columns(first, second, along) {
    const columns = [first, second];
    columns.splice(this.meta.scanned, 0, along);
    return columns;
  }

  happens(vehicle, numbers, threshold, lines, hazards) {
    const first = new Float64Array(lines.length), second = new Float64Array(lines.length);
    for (let k = 0; k < lines.length; k++) {
      first[k] = this.data.line_first[lines[k]];
      second[k] = this.data.line_second[lines[k]];
    }
    const found = simulate(vehicle.kernel, numbers, ...this.columns(first, second, this.along(lines, hazards)));
    return threshold === null ? found.crash : found.impactSpeed.map((speed) => (speed > threshold ? 1 : 0));
  }

  // Whether the event happens at a point of each stratum of each line, shape (lines, strata). Pauses between blocks.
  *scan(vehicle, numbers, threshold, { every, step, enough }) {
    const strata = this.meta.lines.depth / step, flags = new Uint8Array(Math.ceil(this.lines / every) * strata);
    for (let first = 0; first < this.lines; first += BLOCK * every) {
      let active = [];
      for (let line = first; line < Math.min(first + BLOCK * every, this.lines); line += every) active.push(line);
      const run = new Uint8Array(BLOCK);
      for (let k = 0; k < strata && active.length; k++) {
        const share = (line) => (0.5 + line * 0.5497004779019703 + k * 0.7548776662466927) % 1;
        const points = active.map((line) => inside(k * step, step, share(line)));
        const happened = this.happens(vehicle, numbers, threshold, active, points);
        active = active.filter((line, place) => {
          const own = (line - first) / every, row = line / every * strata;
          flags[row + k] = happened[place];
          run[own] = happened[place] ? run[own] + 1 : 0;
          if (!this.meta.lines.upper_set || run[own] * step < enough) return true;
          flags.fill(1, row + k, row + strata);
          return false;
        });
      }
      yield;
    }
    return flags;
  }

  // A first result at once, and the settled one.
  quick(...asked) {
    const every = Math.max(Math.min(Math.floor(this.lines / LEAST), QUICK.every), 1);
    return finished(this.exploring(...asked, { ...QUICK, every }));
  }

  explore(...asked) {
    return finished(this.exploring(...asked, SETTLED));
  }

  // The probability of an event under every draw of the law, and the likeliest encounter in which it happens.
  *exploring(vehicle, numbers, threshold, effort) {
    const flags = yield* this.scan(vehicle, numbers, threshold, effort), { every, step } = effort;
    const strata = this.meta.lines.depth / step, [vn, rn, ln] = this.meta.laws.fine;
    const nodes = new Float64Array(vn * rn * ln), own = new Float64Array(ln);
    const places = Array.from({ length: strata }, (_, k) => cubic(k * step, ln));
    let mean = 0, likeliest = null;
    for (let line = 0, row = 0; line < this.lines; line += every, row += strata) {
      own.fill(0);
      let total = 0;
      for (let k = 0, before = 0; k < strata; k++) {
        const flag = flags[row + k];
        if (flag === before) continue;
        const mass = (flag - before) * every * this.data.line_probability[line] * Math.exp(-k * step);
        const [first, weight] = places[k];
        for (let j = 0; j < 4; j++) own[first + j] += mass * weight[j];
        total += mass;
        if (flag && !before) likeliest = this.likelier(likeliest, line, k * step);
        before = flag;
      }
      mean += total;
      if (total && this.meta.laws.by_line) nodes.set(own, line * ln);
      else if (total) addTo(nodes, own, this.corner[line], rn, ln);
    }
    const asked = [vehicle, numbers, threshold];
    return { draws: this.underDraws(nodes), mean, likeliest: likeliest && this.refined(likeliest, step, ...asked) };
  }

  // The design point of reliability analysis: the encounter nearest to the median in normal scores.
  likelier(known, line, hazard) {
    const distance = this.data.line_distance[line] + this.data.distance_at[Math.round(4 * hazard)];
    return known && known.distance <= distance ? known : { line, hazard, distance };
  }

  // Where on its line the likeliest encounter with the event begins, by halving.
  refined({ line, hazard }, step, vehicle, numbers, threshold) {
    let high = hazard + step, low = Math.max(hazard - step, 0);
    const does = (point) => this.happens(vehicle, numbers, threshold, [line], [point])[0];
    for (let k = 0; !does(high) && k < 8; k++) high += step;
    for (let k = 0; k < 12; k++) {
      const middle = (low + high) / 2;
      if (does(middle)) high = middle;
      else low = middle;
    }
    return [this.data.line_first[line], this.data.line_second[line], this.along([line], [high])[0]];
  }

  underDraws(nodes) {
    const used = [], draws = new Float64Array(this.draws), size = nodes.length;
    nodes.forEach((mass, node) => { if (mass) used.push(node); });
    const at = Int32Array.from(used), mass = Float64Array.from(used, (node) => nodes[node]);
    for (let k = 0; k < this.draws; k++) {
      let sum = 0;
      for (let j = 0; j < at.length; j++) sum += mass[j] * this.ratios[k * size + at[j]];
      draws[k] = Math.max(sum, 0);
    }
    return draws;
  }

  // Weights of the draws for a choice of the law: "all" or a family.
  weightsOf(choice) {
    const { laws } = this.meta, member = this.data.member, weights = new Float64Array(this.draws);
    if (choice === "all") return weights.fill(1, 0, laws.answered);
    // The weights of the models of one family, or equal ones if the answer gives none of them a weight.
    const own = laws.members.map(({ family }, k) => (family === choice ? laws.weights[k] : 0));
    const wanted = own.some((weight) => weight > 0) ? own : laws.members.map(({ family }) => Number(family === choice));
    const counts = new Float64Array(laws.members.length);
    member.forEach((place) => { counts[place] += 1; });
    return weights.map((_, k) => wanted[member[k]] / counts[member[k]]);
  }
}

// What a generator returns, without pauses.
function finished(work) {
  let step = work.next();
  while (!step.done) step = work.next();
  return step.value;
}

function unpacked(bytes, { type, start, shape }) {
  const array = new TYPES[type](shape.reduce((product, size) => product * size, 1));
  const width = array.BYTES_PER_ELEMENT, whole = new Uint8Array(array.buffer), count = array.length;
  for (let byte = 0; byte < width; byte++) {
    for (let k = 0; k < count; k++) whole[k * width + byte] = bytes[start + byte * count + k];
  }
  return array;
}

// Multiply by a matrix of shape (to, from) along the middle of three dimensions.
function spread(values, matrix, before, to, from, after) {
  const result = new Float32Array(before * to * after);
  for (let i = 0; i < before; i++) {
    for (let row = 0; row < to; row++) {
      for (let column = 0; column < from; column++) {
        const factor = matrix[row * from + column];
        if (Math.abs(factor) < 1e-7) continue;
        const source = (i * from + column) * after, target = (i * to + row) * after;
        for (let k = 0; k < after; k++) result[target + k] += factor * values[source + k];
      }
    }
  }
  return result;
}

// Distribute what a line has at its levels among the nodes around it.
function addTo(nodes, own, [v, vw, r, rw], rn, ln) {
  for (let level = 0; level < ln; level++) {
    if (!own[level]) continue;
    for (let i = 0; i < 4; i++) {
      for (let j = 0; j < 4; j++) nodes[((v + i) * rn + r + j) * ln + level] += own[level] * vw[i] * rw[j];
    }
  }
}

// Quantiles of weighted values; with equal weights those that Python's numpy.quantile returns.
function quantiles(values, weights, levels) {
  const order = [];
  for (let k = 0; k < values.length; k++) if (weights[k] > 0) order.push(k);
  order.sort((a, b) => values[a] - values[b]);
  const places = new Float64Array(order.length);
  for (let k = 1; k < order.length; k++) places[k] = places[k - 1] + (weights[order[k - 1]] + weights[order[k]]) / 2;
  const total = places[order.length - 1];
  return levels.map((level) => {
    let low = 0, high = order.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (places[middle] <= level * total) low = middle;
      else high = middle;
    }
    const share = high > low ? (level * total - places[low]) / (places[high] - places[low]) : 0;
    return values[order[low]] + share * (values[order[high]] - values[order[low]]);
  });
}

const LEVELS = [0.025, 0.1, 0.25, 0.5, 0.75, 0.9, 0.975];

// Mean and quantiles at LEVELS of values.
function summary(values, weights) {
  let sum = 0, total = 0;
  values.forEach((value, k) => { sum += value * weights[k]; total += weights[k]; });
  return { mean: sum / total, quantiles: quantiles(values, weights, LEVELS) };
}

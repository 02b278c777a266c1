// What the explorer shows when a setting changes.
"use strict";

const NEAR = 1.5; // how far a shown record may differ in the variable of the slider, in its unit
const REST = 150; // [ms] without a change, after which the result is refined
const SLICE = 12; // [ms] of computing between two pauses
const NEVER = 1e-12; // probabilities below are those of the far ends of the laws, not of the records

const pause = (milliseconds) => new Promise((resume) => { setTimeout(resume, milliseconds); });

class Page extends Settings {
  constructor(engine) {
    super();
    const { meta } = engine, at = meta.vehicles.findIndex((vehicle) => vehicle.name === meta.tested);
    Object.assign(this, { engine, meta, cache: new Map(), rough: new Map(), time: 0 });
    this.vehicles = [...meta.vehicles, ...meta.others];
    if (at < 0) this.vehicles.unshift({ name: meta.tested, title: `Vehicle of the study: ${meta.tested}`, sliders: [] });
    else this.vehicles.unshift(...this.vehicles.splice(at, 1));
    this.map = new MapView(element("map"), meta.axes);
    this.fillControls();
    this.readLink();
    this.listen();
    this.update();
  }

  explored(vehicle, stops) {
    const key = [vehicle.name, stops.join(), this.state.event].join("|");
    if (!this.cache.has(key)) {
      if (this.cache.size > 60) this.cache.clear();
      const asked = [vehicle, this.engine.numbers(vehicle, stops), this.threshold];
      this.cache.set(key, { ...this.engine.quick(...asked), asked });
    }
    const found = this.cache.get(key);
    if (found.asked) this.rough.set(key, found.asked);
    return found;
  }

  usual(name) {
    const vehicle = this.vehicles.find((each) => each.name === name);
    return this.explored(vehicle, vehicle.sliders.map((slider) => slider.start));
  }

  // The study's own numbers of a vehicle that the page does not explore; null where it has none.
  published() {
    const { answer, vehicles } = this.meta.published;
    const row = this.isTested ? answer.find(({ event }) => event === this.state.event)
      : this.state.event === "crash" && vehicles.find(({ vehicle }) => vehicle === this.state.vehicle);
    if (!row || row.median === null) return null;
    return { mean: row.probability, quantiles: ["low95", "low80", "low50", "median", "high50", "high80", "high95"].map((name) => row[name]) };
  }

  // Show a first result at once. When no other change follows, refine it.
  update() {
    this.begin = performance.now();
    this.isSettled = false;
    this.show();
    this.milliseconds = performance.now() - this.begin;
    this.refine();
  }

  // Replace the first results by settled ones, in slices between which the page answers; a new change ends this.
  async refine() {
    const { begin } = this, isOld = () => begin !== this.begin;
    if (this.rough.size) await pause(REST);
    if (isOld()) return;
    for (const [key, asked] of this.rough) {
      const work = this.engine.exploring(...asked, SETTLED);
      let step = work.next();
      for (let from = performance.now(); !step.done; step = work.next()) {
        if (performance.now() - from < SLICE) continue;
        await pause(0);
        if (isOld()) return;
        from = performance.now();
      }
      this.cache.set(key, step.value);
    }
    if (this.rough.size) this.show();
    this.isSettled = true;
    this.settledMilliseconds = performance.now() - begin;
  }

  show() {
    this.rough.clear();
    this.weights = this.engine.weightsOf(this.state.law);
    this.found = this.isExplored ? this.explored(this.vehicle, this.state.stops) : null;
    this.result = this.found ? summary(this.found.draws, this.weights) : this.published();
    this.encounter = this.state.own || (this.found && this.found.mean > NEVER ? this.found.likeliest : null);
    const [{ low, high }] = this.meta.axes, guess = this.encounter ? Math.round(2 * this.encounter[0]) / 2 : low;
    this.lead = this.state.lead ?? Math.min(Math.max(guess, low), high);
    this.showAnswer();
    this.showMap();
    this.showReplay();
    this.writeLink();
    element("refining").textContent = this.rough.size ? "A first result, which is being refined …"
      : this.isExplored || this.meta.reference ? `${this.isExplored ? "The result is" : "The careful human is"} computed from ${this.engine.lines.toLocaleString("en-US")} pairs of ${this.meta.axes[0].name} and ${this.meta.axes[1].name}.` : "";
    element("results").setAttribute("aria-busy", String(this.rough.size > 0)); // a screen reader reads the settled result
  }

  showAnswer() {
    const { result, state } = this, rows = [];
    const reference = this.meta.reference && this.usual(this.meta.reference), human = reference && summary(reference.draws, this.weights);
    const name = this.vehicle.title, event = state.event === "crash" ? "a crash" : `an ${state.event}`;
    const usual = this.isChanged ? this.usual(state.vehicle) : null;
    if (result) rows.push({ name: this.isChanged ? "As set" : name, colour: "own", draws: this.found && this.found.draws, ...result });
    if (usual) rows.push({ name: "As in the study", colour: "study", draws: usual.draws, ...summary(usual.draws, this.weights) });
    if (reference && state.vehicle !== this.meta.reference) rows.push({ name: "Careful human", colour: "human", draws: reference.draws, ...human });
    element("intervals").innerHTML = drawIntervals(rows, element("intervals").clientWidth);
    this.showHeadline(event);
    element("comparison").textContent = reference ? this.comparison(reference.draws, "a careful human") : usual ? this.comparison(usual.draws, "the vehicle of the study") : "";
    const rates = this.meta.exposure.rates, columns = rows.map((row) => this.numbersOf(row));
    const names = ["median", "mean", "50 % interval", "80 % interval", "95 % interval", ...(rates ? ["per million km", "80 % interval"] : [])];
    fillTable(element("numbers"), [`per ${this.meta.noun}`, ...rows.map((row) => escaped(row.name))], names.map((title, k) => [title, ...columns.map((column) => column[k])]));
    element("rates").textContent = rates
      ? `Probabilities are per ${this.meta.noun}. Rates per million km come from ${this.meta.exposure.cut_ins.toLocaleString("en-US")} ${this.meta.noun}s in ${this.meta.exposure.kilometres.toLocaleString("en-US")} km.`
      : `Probabilities are per ${this.meta.noun}. The study has no rates per kilometre, because the distance that was driven is not known.`;
  }

  get isChanged() {
    return this.isExplored && this.vehicle.sliders.some((slider, k) => this.state.stops[k] !== slider.start);
  }

  showHeadline(event) {
    let [text, rest] = [`The study has no probability of ${event} for this vehicle.`, ""];
    if (this.result && !(this.result.mean > NEVER)) text = `Practically never: there is hardly a chance of ${event}.`;
    else if (this.result) {
      const [median, low, high] = [3, 1, 5].map((place) => oneIn(this.result.quantiles[place]));
      text = `One ${this.meta.noun} in ${median} ends in ${event}.`;
      rest = `The 80 % interval is from one in ${low} to one in ${high}.`;
    }
    element("headline").textContent = text;
    element("interval").textContent = rest;
  }

  // The ratio to another vehicle, draw by draw.
  comparison(human, whom) {
    if (!this.found || (this.state.vehicle === this.meta.reference && !this.isChanged)) return "";
    const ratios = this.found.draws.map((value, k) => value / human[k]);
    const weights = this.weights.map((weight, k) => (human[k] > 0 ? weight : 0));
    let [low, median, high] = quantiles(ratios, weights, [0.1, 0.5, 0.9]), safer = 0, total = 0;
    ratios.forEach((ratio, k) => { safer += ratio < 1 ? weights[k] : 0; total += weights[k]; });
    if (!total || !(median > 0)) return "";
    const fewer = median < 1;
    if (fewer) [low, median, high] = [1 / high, 1 / median, 1 / low];
    const rest = `(80 % interval: ${readable(low)} to ${readable(high)}). `;
    return (fewer ? `With ${whom} it happens ${readable(median)} times as often ` : `It happens ${readable(median)} times as often as with ${whom} `) + rest
      + (safer === total ? "It happens less often with this vehicle in every draw of the models."
        : `The probability that it happens less often with this vehicle is ${percent(safer / total)}.`);
  }

  numbersOf({ quantiles: q, mean, draws }) {
    const cells = [readable(q[3]), readable(mean), interval(q[2], q[4]), interval(q[1], q[5]), interval(q[0], q[6])];
    const { rates } = this.meta.exposure, products = [], weights = [];
    if (!rates) return cells;
    if (!draws) return [...cells, "–", "–"];
    draws.forEach((value, k) => rates.forEach((rate) => { products.push(value * rate); weights.push(this.weights[k]); }));
    const [low, median, high] = quantiles(products, weights, [0.1, 0.5, 0.9]);
    return [...cells, readable(median), interval(low, high)];
  }

  showMap() {
    const { engine: { data, meta }, lead } = this, { noun, axes } = meta, records = [], drawn = { records, marks: [] };
    const at = axes.map(({ variable }) => variable), count = data.records.length / 3, { record_step: step } = meta;
    const record = (axis, k) => data.records[at[axis] * count + k] * step;
    element("lead").value = lead;
    element("lead-value").textContent = `${lead.toFixed(1)} ${axes[0].unit}`;
    for (let k = 0; k < count; k++) if (Math.abs(record(0, k) - lead) < NEAR) records.push([record(1, k), record(2, k)]);
    if (this.vehicle.kernel) {
      drawn.cells = this.map.cells();
      const { across, up } = drawn.cells, leads = new Float64Array(across.length).fill(lead);
      drawn.found = simulate(this.vehicle.kernel, this.engine.numbers(this.vehicle, this.state.stops), ...this.engine.columns(leads, across, up));
    } else if (this.isTested && data.map_second) {
      drawn.lines = [...data.map_second.keys()].filter((k) => Math.abs(data.map_first[k] - lead) < NEAR)
        .map((k) => [data.map_second[k], data.map_start[k], data.map_end[k]]);
    } else if (this.isTested && data.run_crash) {
      const runs = data.run_crash.length, run = (axis, k) => data.runs[at[axis] * runs + k];
      drawn.runs = [...data.run_crash.keys()].filter((k) => Math.abs(run(0, k) - lead) < NEAR).map((k) => [run(1, k), run(2, k), data.run_crash[k]]);
    }
    const likeliest = this.found && this.found.mean > NEVER && this.found.likeliest;
    const near = (one) => one && Math.abs(one[0] - lead) < NEAR;
    if (near(likeliest)) drawn.marks.push({ across: likeliest[1], up: likeliest[2], kind: "x" });
    if (near(this.state.own)) drawn.marks.push({ across: this.state.own[1], up: this.state.own[2], kind: "cross" });
    this.map.draw(drawn);
    element("map-more").textContent = this.vehicle.kernel ? SHOWN[this.vehicle.kernel].map : "";
    const patch = (shade, text, kind = "") => `<span><i class="${kind}" style="background:var(--${shade})"></i>${text}</span>`;
    const crashes = this.vehicle.kernel ? [patch("slow", "crash up to 5 m/s"), patch("middle", "5 to 10 m/s"), patch("fast", "above 10 m/s")]
      : drawn.runs ? [patch("fast", "simulated, crash", "dot"), patch("study", "simulated, no crash", "dot")]
        : drawn.lines ? [patch("middle", "crash, from the map of the study")] : [];
    const marks = this.vehicle.kernel ? ["<span>✕ likeliest</span>", "<span>+ replayed</span>"] : [];
    element("legend").innerHTML = [...crashes, patch("record", `recorded ${noun}`, "dot"), ...marks].join("");
    const share = drawn.found ? drawn.found.crash.reduce((sum, flag) => sum + flag, 0) / drawn.found.crash.length : null;
    element("map").setAttribute("aria-label", `Map of ${noun}s at a ${axes[0].name} of ${lead.toFixed(1)} ${axes[0].unit}`
      + (share === null ? "" : `: the vehicle crashes in ${percent(share)} of the shown area`));
  }

  showReplay() {
    const { encounter, vehicle, meta: { noun } } = this, possible = Boolean(encounter && vehicle.kernel);
    element("replayable").hidden = !possible;
    FIELDS.forEach((id, k) => { element(id).value = encounter ? Number(encounter[k].toFixed(2)) : ""; });
    if (!possible) {
      element("outcome").textContent = vehicle.kernel ? "Choose a point on the map to replay it." : "This vehicle's states are not known, so nothing can be replayed.";
      return;
    }
    const numbers = this.engine.numbers(vehicle, this.state.stops), columns = this.engine.columns(...encounter);
    const { columns: shown, closest, ends } = SHOWN[vehicle.kernel];
    this.states = trace(vehicle.kernel, numbers, columns);
    const found = simulate(vehicle.kernel, numbers, ...columns.map((value) => Float64Array.of(value)));
    const which = this.state.own ? `This ${noun}` : `The likeliest ${this.state.event === "crash" ? "crash" : this.state.event}`;
    element("outcome").textContent = found.crash[0]
      ? `${which} ends in a contact after ${ends(this.states, numbers.contact).toFixed(1)} s, at an impact speed of ${found.impactSpeed[0].toFixed(1)} m/s.`
      : `${which} ends without a crash; ${closest} ${found.closest[0].toFixed(1)} m.`;
    this.time = Math.min(this.time, this.states.length - 1);
    Object.assign(element("time"), { max: this.states.length - 1, value: this.time });
    const every = this.states.length > 100 ? 10 : 5, rows = this.states.filter((_, k) => k % every === 0 || k === this.states.length - 1);
    fillTable(element("states"), shown.map(([title]) => title), rows.map((row) => shown.map(([, text]) => text(row))));
    this.showMoment();
  }

  showMoment() {
    const { states } = this, state = states[this.time], times = states.map(({ time }) => time), box = element("charts");
    const { scene, charts, now } = SHOWN[this.vehicle.kernel];
    element("time-value").textContent = `${state.time.toFixed(1)} s`;
    element("now").textContent = `${now(state)}; acceleration ${state.acceleration.toFixed(1)} m/s²${state.emergency ? "; emergency braking" : ""}.`;
    element("scene").innerHTML = scene(state, states, element("scene").clientWidth);
    const columns = Math.max(1, Math.floor((box.clientWidth + 16) / 256)), width = (box.clientWidth - 16 * (Math.min(columns, 3) - 1)) / Math.min(columns, 3);
    const line = ([name, shade, column, dashed]) => ({ name, colour: shade, values: states.map((each) => each[column]), dashed });
    box.innerHTML = charts.map(({ title, lines }) => drawChart(title, times, lines.map(line), state.time, width)).join("");
  }
}

Engine.load(...["data", "arrays"].map((id) => element(id).textContent)).then((engine) => {
  window.explorer = engine;
  window.page = new Page(engine);
}).catch((error) => {
  element("headline").textContent = `The explorer cannot start: ${error.message}. It needs a browser of 2023 or later.`;
});

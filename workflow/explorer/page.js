// What the explorer shows when a setting changes.
"use strict";

const NEAR = 1.5; // [m/s], how far the lead speed of a shown record may differ
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
    this.map = new MapView(element("map"), meta.range_max, 40);
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
    const [low, high] = this.meta.lead_speeds, guess = this.encounter ? Math.round(2 * this.encounter.leadSpeed) / 2 : low;
    this.lead = this.state.lead ?? Math.min(Math.max(guess, low), high);
    this.showAnswer();
    this.showMap();
    this.showReplay();
    this.writeLink();
    element("refining").textContent = this.rough.size ? "A first result, which is being refined …"
      : `${this.isExplored ? "The result is" : "The careful human is"} computed from ${this.engine.lines.toLocaleString("en-US")} pairs of lead speed and range.`;
    element("results").setAttribute("aria-busy", String(this.rough.size > 0)); // a screen reader reads the settled result
  }

  showAnswer() {
    const { result, state } = this, rows = [];
    const reference = this.usual(this.meta.reference), human = summary(reference.draws, this.weights);
    const name = this.vehicle.title, event = state.event === "crash" ? "a crash" : `an ${state.event}`;
    const usual = this.isChanged ? this.usual(state.vehicle) : null;
    if (result) rows.push({ name: this.isChanged ? "As set" : name, colour: "own", draws: this.found && this.found.draws, ...result });
    if (usual) rows.push({ name: "As in the study", colour: "study", draws: usual.draws, ...summary(usual.draws, this.weights) });
    if (state.vehicle !== this.meta.reference) rows.push({ name: "Careful human", colour: "human", draws: reference.draws, ...human });
    element("intervals").innerHTML = drawIntervals(rows, element("intervals").clientWidth);
    this.showHeadline(event);
    element("comparison").textContent = this.comparison(reference.draws);
    const rates = this.meta.exposure.rates, columns = rows.map((row) => this.numbersOf(row));
    const names = ["median", "mean", "50 % interval", "80 % interval", "95 % interval", ...(rates ? ["per million km", "80 % interval"] : [])];
    fillTable(element("numbers"), ["per cut-in", ...rows.map((row) => escaped(row.name))], names.map((title, k) => [title, ...columns.map((column) => column[k])]));
    element("rates").textContent = rates
      ? `Probabilities are per cut-in. Rates per million km come from ${this.meta.exposure.cut_ins.toLocaleString("en-US")} cut-ins in ${this.meta.exposure.kilometres.toLocaleString("en-US")} km.`
      : "Probabilities are per cut-in. The study has no rates per kilometre, because the distance that was driven is not known.";
  }

  get isChanged() {
    return this.isExplored && this.vehicle.sliders.some((slider, k) => this.state.stops[k] !== slider.start);
  }

  showHeadline(event) {
    let [text, rest] = [`The study has no probability of ${event} for this vehicle.`, ""];
    if (this.result && !(this.result.mean > NEVER)) text = `Practically never: there is hardly a chance of ${event}.`;
    else if (this.result) {
      const [median, low, high] = [3, 1, 5].map((place) => oneIn(this.result.quantiles[place]));
      text = `One cut-in in ${median} ends in ${event}.`;
      rest = `The 80 % interval is from one in ${low} to one in ${high}.`;
    }
    element("headline").textContent = text;
    element("interval").textContent = rest;
  }

  comparison(human) {
    if (!this.found || (this.state.vehicle === this.meta.reference && !this.isChanged)) return "";
    const ratios = this.found.draws.map((value, k) => value / human[k]);
    const weights = this.weights.map((weight, k) => (human[k] > 0 ? weight : 0));
    let [low, median, high] = quantiles(ratios, weights, [0.1, 0.5, 0.9]), safer = 0, total = 0;
    ratios.forEach((ratio, k) => { safer += ratio < 1 ? weights[k] : 0; total += weights[k]; });
    if (!total || !(median > 0)) return "";
    const fewer = median < 1;
    if (fewer) [low, median, high] = [1 / high, 1 / median, 1 / low];
    const rest = `(80 % interval: ${readable(low)} to ${readable(high)}). `;
    return (fewer ? `With a careful human it happens ${readable(median)} times as often ` : `It happens ${readable(median)} times as often as with a careful human `) + rest
      + `The probability that it happens less often with this vehicle is ${percent(safer / total)}.`;
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
    const { data } = this.engine, { lead } = this, records = [], drawn = { records, marks: [] };
    element("lead").value = lead;
    element("lead-value").textContent = `${lead.toFixed(1)} m/s`;
    for (let k = 0; k < data.record_range_.length; k++) {
      if (Math.abs(data.record_lead_speed[k] / 256 - lead) < NEAR) records.push([data.record_range_[k] / 256, data.record_closing_speed[k] / 256]);
    }
    if (this.vehicle.kernel) {
      drawn.cells = this.map.cells();
      const leads = new Float64Array(drawn.cells.range.length).fill(lead);
      drawn.found = simulate(this.vehicle.kernel, this.engine.numbers(this.vehicle, this.state.stops), leads, drawn.cells.range, drawn.cells.closing);
    } else if (this.isTested && data.map_range) {
      drawn.lines = [...data.map_range.keys()].filter((k) => Math.abs(data.map_lead_speed[k] - lead) < NEAR)
        .map((k) => [data.map_range[k], data.map_start[k], data.map_end[k]]);
    } else if (this.isTested && data.run_range) {
      drawn.runs = [...data.run_range.keys()].filter((k) => Math.abs(data.run_lead_speed[k] - lead) < NEAR)
        .map((k) => [data.run_range[k], data.run_closing_speed[k], data.run_crash[k]]);
    }
    const likeliest = this.found && this.found.mean > NEVER && this.found.likeliest;
    const near = (one) => one && Math.abs(one.leadSpeed - lead) < NEAR;
    if (near(likeliest)) drawn.marks.push({ range: likeliest.range, closing: likeliest.closingSpeed, kind: "x" });
    if (this.state.own && near(this.state.own)) drawn.marks.push({ range: this.state.own.range, closing: this.state.own.closingSpeed, kind: "cross" });
    this.map.draw(drawn);
    const patch = (shade, text, kind = "") => `<span><i class="${kind}" style="background:var(--${shade})"></i>${text}</span>`;
    const crashes = this.vehicle.kernel ? [patch("slow", "crash up to 5 m/s"), patch("middle", "5 to 10 m/s"), patch("fast", "above 10 m/s")]
      : drawn.runs ? [patch("fast", "simulated, crash", "dot"), patch("study", "simulated, no crash", "dot")]
        : drawn.lines ? [patch("middle", "crash, from the map of the study")] : [];
    const marks = this.vehicle.kernel ? ["<span>✕ likeliest</span>", "<span>+ replayed</span>"] : [];
    element("legend").innerHTML = [...crashes, patch("record", "recorded cut-in", "dot"), ...marks].join("");
    const share = drawn.found ? drawn.found.crash.reduce((sum, flag) => sum + flag, 0) / drawn.found.crash.length : null;
    element("map").setAttribute("aria-label", `Map of cut-ins at a lead speed of ${lead.toFixed(1)} m/s`
      + (share === null ? "" : `: the vehicle crashes in ${percent(share)} of the shown area`));
  }

  showReplay() {
    const { encounter, vehicle } = this, possible = Boolean(encounter && vehicle.kernel);
    element("replayable").hidden = !possible;
    const shown = encounter ? [encounter.leadSpeed, encounter.range, encounter.closingSpeed] : ["", "", ""];
    ["at-lead", "at-range", "at-closing"].forEach((id, k) => { element(id).value = shown[k] === "" ? "" : Number(shown[k].toFixed(2)); });
    if (!possible) {
      element("outcome").textContent = vehicle.kernel ? "Choose a cut-in on the map to replay it." : "This vehicle's states are not known, so nothing can be replayed.";
      return;
    }
    const numbers = this.engine.numbers(vehicle, this.state.stops);
    this.states = trace(vehicle.kernel, numbers, encounter);
    const single = [encounter.leadSpeed, encounter.range, encounter.closingSpeed].map((value) => Float64Array.of(value));
    const { crash, impactSpeed, minRange } = simulate(vehicle.kernel, numbers, ...single);
    const which = this.state.own ? "This cut-in" : `The likeliest ${this.state.event === "crash" ? "crash" : this.state.event}`;
    element("outcome").textContent = crash[0]
      ? `${which} ends in a contact after ${this.states[this.states.length - 1].time.toFixed(1)} s, at an impact speed of ${impactSpeed[0].toFixed(1)} m/s.`
      : `${which} ends without a crash; the smallest range is ${minRange[0].toFixed(1)} m.`;
    this.time = Math.min(this.time, this.states.length - 1);
    Object.assign(element("time"), { max: this.states.length - 1, value: this.time });
    const every = this.states.length > 100 ? 10 : 5, rows = this.states.filter((_, k) => k % every === 0 || k === this.states.length - 1);
    fillTable(element("states"), ["time [s]", "range [m]", "vehicle [m/s]", "other car [m/s]", "acceleration [m/s²]", "TTC [s]", "emergency"],
      rows.map((row) => [row.time.toFixed(1), row.range.toFixed(2), row.speed.toFixed(2), row.lead.toFixed(2), row.acceleration.toFixed(2),
        Number.isFinite(row.ttc) ? row.ttc.toFixed(2) : "–", row.emergency ? "yes" : "no"]));
    this.showMoment();
  }

  showMoment() {
    const { states } = this, state = states[this.time], times = states.map(({ time }) => time), box = element("charts");
    element("time-value").textContent = `${state.time.toFixed(1)} s`;
    element("now").textContent = `Range ${state.range.toFixed(1)} m; vehicle ${state.speed.toFixed(1)} m/s, other car ${state.lead.toFixed(1)} m/s; `
      + `acceleration ${state.acceleration.toFixed(1)} m/s²${state.emergency ? "; emergency braking" : ""}.`;
    element("scene").innerHTML = drawScene(state, Math.max(...states.map(({ range }) => range)), element("scene").clientWidth);
    const columns = Math.max(1, Math.floor((box.clientWidth + 16) / 256)), width = (box.clientWidth - 16 * (Math.min(columns, 3) - 1)) / Math.min(columns, 3);
    const line = (name, shade, pick, dashed) => ({ name, colour: shade, values: states.map(pick), dashed });
    box.innerHTML = [
      drawChart("Range [m]", times, [line("range", "own", ({ range }) => range)], state.time, width),
      drawChart("Speed [m/s], other car dashed", times, [line("vehicle", "own", ({ speed }) => speed), line("other car", "study", ({ lead }) => lead, true)], state.time, width),
      drawChart("Acceleration [m/s²]", times, [line("acceleration", "own", ({ acceleration }) => acceleration)], state.time, width),
    ].join("");
  }
}

Engine.load(...["data", "arrays"].map((id) => element(id).textContent)).then((engine) => {
  window.explorer = engine;
  window.page = new Page(engine);
}).catch((error) => {
  element("headline").textContent = `The explorer cannot start: ${error.message}. It needs a browser of 2023 or later.`;
});

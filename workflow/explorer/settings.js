// What a reader of the explorer sets, and the link that holds it.
"use strict";

const FIELDS = ["at-0", "at-1", "at-2"]; // of the replayed encounter, in the order of the axes

class Settings {
  fillControls() {
    const options = (entries) => entries.map(([value, text]) => `<option value="${escaped(value)}">${escaped(text)}</option>`).join("");
    const { laws, events, axes, noun, exposure } = this.meta, [{ low, high }] = axes;
    element("vehicle").innerHTML = options(this.vehicles.map((vehicle) => [vehicle.name, vehicle.title]));
    element("event").innerHTML = options([["crash", "Crash"], ...events.map(({ name }) => [name, name.replace(/^i/, "I")])]);
    element("law").innerHTML = options([["all", "All models, by their weights"]])
      + options([...new Set(laws.members.map(({ family }) => family))].map((name) => [name, name]));
    Object.assign(element("lead"), { min: low, max: high });
    element("study").textContent = `It rests on ${exposure.cut_ins.toLocaleString("en-US")} recorded ${noun}s.`;
    axes.forEach(({ name, unit, limits: [least, most] }, k) => {
      element(`name-${k}`).textContent = `${capital(name)} [${unit}]`;
      Object.assign(element(FIELDS[k]), { min: least, max: most });
    });
  }

  start(vehicle) {
    return { vehicle: vehicle.name, stops: vehicle.sliders.map((slider) => slider.start), law: "all", event: "crash", lead: null, own: null };
  }

  // The settings of the link, and those of the study for whatever it does not say.
  readLink() {
    const link = new URLSearchParams(location.hash.slice(1));
    const vehicle = this.vehicles.find(({ name }) => name === link.get("vehicle")) || this.vehicles[0];
    const known = (id, value) => [...element(id).options].some((option) => option.value === value);
    this.state = this.start(vehicle);
    vehicle.sliders.forEach((slider, k) => {
      const stop = slider.stops.findIndex(({ value }) => value === link.get(slider.name));
      if (stop >= 0) this.state.stops[k] = stop;
    });
    for (const name of ["law", "event"]) if (known(name, link.get(name))) this.state[name] = link.get(name);
    const numbers = (link.get("at") || "").split(",").map(Number);
    const { axes } = this.meta, isIn = (value, k) => Number.isFinite(value) && value >= axes[k].limits[0] && value <= axes[k].limits[1];
    if (numbers.length === 3 && numbers.every(isIn) && numbers[1] > 0) this.state.own = numbers;
    const lead = Number(link.get("lead")), [{ low, high }] = axes;
    if (link.get("lead") && lead >= low && lead <= high) this.state.lead = lead;
    this.showControls();
  }

  writeLink() {
    const { state, vehicle } = this, link = new URLSearchParams({ vehicle: state.vehicle });
    vehicle.sliders.forEach((slider, k) => {
      if (state.stops[k] !== slider.start) link.set(slider.name, slider.stops[state.stops[k]].value);
    });
    for (const [name, usual] of [["law", "all"], ["event", "crash"]]) if (state[name] !== usual) link.set(name, state[name]);
    if (state.lead !== null) link.set("lead", state.lead);
    if (state.own) link.set("at", state.own.join(","));
    this.written = `#${link}`;
    history.replaceState(null, "", this.written);
  }

  get vehicle() {
    return this.vehicles.find(({ name }) => name === this.state.vehicle);
  }

  // Whether the vehicle is that of the study.
  get isTested() {
    return this.state.vehicle === this.meta.tested;
  }

  get threshold() {
    const event = this.meta.events.find(({ name }) => name === this.state.event);
    return event ? event.threshold : null;
  }

  // Whether the page computes this vehicle's probabilities, or only the study has them.
  get isExplored() {
    return Boolean(this.vehicle.kernel) && !this.vehicle.striped;
  }

  showControls() {
    const { vehicle, state } = this;
    for (const name of ["vehicle", "law", "event"]) element(name).value = state[name];
    element("sliders").innerHTML = this.isExplored ? vehicle.sliders.map((slider, k) => `<div class="slider">
      <span><label for="slider-${k}">${escaped(slider.label)}</label><output for="slider-${k}" id="value-${k}"></output></span>
      <input type="range" id="slider-${k}" min="0" max="${slider.stops.length - 1}" step="1"><small id="help-${k}"></small></div>`).join("") : "";
    const reason = vehicle.striped
      ? "A few millimetres of range decide whether this driver crashes, which this page cannot resolve. The numbers are those of the study, and replays are possible."
      : `${this.isTested ? "The page has no compiled code of this vehicle." : "In each encounter, this driver is another person, which takes too long to simulate here."}`
        + ` The numbers are those of the study; sliders and replays are missing. ${this.mapInWords()}`;
    element("missing").hidden = this.isExplored;
    element("missing").textContent = reason;
    element("law").disabled = !this.isExplored;
    this.showStops();
  }

  // What the map shows of a vehicle whose code the page does not have.
  mapInWords() {
    const { map_second: map, run_crash: runs } = this.engine.data;
    if (!this.isTested) return `The map shows recorded ${this.meta.noun}s only.`;
    if (map) return "The map is that of the study.";
    return runs ? `Instead of crash areas, the map shows the ${runs.length} simulations of the study.` : "The map is missing, too.";
  }

  showStops() {
    if (!this.isExplored) return;
    const numbers = this.engine.numbers(this.vehicle, this.state.stops);
    this.vehicle.sliders.forEach((slider, k) => {
      const stop = slider.stops[this.state.stops[k]], input = element(`slider-${k}`);
      input.value = this.state.stops[k];
      element(`value-${k}`).textContent = `${stop.label} ${slider.unit}`;
      input.setAttribute("aria-valuetext", `${stop.label} ${slider.unit}`);
      input.parentElement.classList.toggle("changed", this.state.stops[k] !== slider.start);
      const helps = { aeb_jerk: `full braking after ${(numbers.aeb_deceleration / numbers.aeb_jerk).toFixed(2)} s` };
      element(`help-${k}`).textContent = helps[slider.name] || (this.state.stops[k] === slider.start ? "as in the study" : "");
    });
  }

  listen() {
    const later = (change) => (event) => {
      change(event);
      if (this.waiting) return; // one computation for all changes before the next frame
      this.waiting = requestAnimationFrame(() => { this.waiting = 0; this.update(); });
    };
    element("vehicle").addEventListener("change", later(({ target }) => {
      const { law, event, lead } = this.state, vehicle = this.vehicles.find(({ name }) => name === target.value);
      this.state = Object.assign(this.start(vehicle), { law: vehicle.kernel && !vehicle.striped ? law : "all", event, lead });
      this.showControls();
    }));
    for (const name of ["law", "event"]) element(name).addEventListener("change", later(({ target }) => { this.state[name] = target.value; }));
    element("sliders").addEventListener("input", later(({ target }) => {
      this.state.stops[Number(target.id.split("-")[1])] = Number(target.value);
      this.showStops();
    }));
    element("lead").addEventListener("input", later(({ target }) => { this.state.lead = Number(target.value); }));
    element("reset").addEventListener("click", later(() => { this.state = this.start(this.vehicles[0]); this.showControls(); }));
    element("likeliest").addEventListener("click", later(() => Object.assign(this.state, { own: null, lead: null })));
    for (const id of FIELDS) element(id).addEventListener("change", later(() => this.readEncounter()));
    element("copy").addEventListener("click", () => this.copyLink());
    element("time").addEventListener("input", ({ target }) => { this.time = Number(target.value); this.showMoment(); });
    element("map").addEventListener("click", later((event) => {
      this.replayAt(...this.map.encounter(event.offsetX, event.offsetY));
    }));
    element("map").addEventListener("keydown", (event) => this.moveCross(event, later));
    window.addEventListener("hashchange", later(() => { if (location.hash !== this.written) this.readLink(); }));
    window.addEventListener("resize", later(() => {}));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", later(() => {}));
  }

  readEncounter() {
    const fields = FIELDS.map(element);
    if (!fields.every((field) => field.value !== "" && field.checkValidity())) return;
    this.state.own = fields.map((field) => Number(field.value));
    const [{ low, high }] = this.meta.axes;
    this.state.lead = Math.min(Math.max(this.state.own[0], low), high);
  }

  replayAt(x, y) {
    const rounded = (value) => Number(value.toFixed(2));
    this.state.own = [this.lead, Math.max(rounded(x), 0.01), rounded(y)];
    this.state.lead = this.lead;
  }

  moveCross(event, later) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 0.5], ArrowDown: [0, -0.5] }[event.key];
    if (!steps) return;
    event.preventDefault();
    const [, horizontal, vertical] = this.meta.axes, from = this.state.own || this.encounter || [0, horizontal.high / 2, vertical.high / 4];
    const within = (value, low, high) => Math.min(Math.max(value, low), high);
    const factor = event.shiftKey ? 5 : 1;
    later(() => this.replayAt(
      within(from[1] + factor * steps[0], 0.1, horizontal.high), within(from[2] + factor * steps[1], 0, vertical.high),
    ))(event);
  }

  async copyLink() {
    try {
      await navigator.clipboard.writeText(location.href);
      element("copied").textContent = "Copied.";
    } catch {
      element("copied").textContent = "Copy the address of this page.";
    }
  }
}

// The vehicles of the explorer: their own code, translated from Python, and its arrays in the memory of the module.
"use strict";

const fromBase64 = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

class Simulator {
  constructor(layout, run) {
    Object.assign(this, { layout, run, memory: new Float64Array(run.memory.buffer) });
  }

  writeNumbers(kernel, numbers) {
    const layout = this.layout[kernel], integers = new Int32Array(this.run.memory.buffer);
    layout.fields.forEach((kind, k) => {
      if (kind === "float") this.memory[layout.record / 8 + k] = numbers[k];
      else integers[layout.record / 4 + 2 * k] = numbers[k];
    });
  }

  // Simulate cut-ins; the outcomes are valid until the next call: crash, smallest range and TTC, impact speed.
  simulate(kernel, numbers, leadSpeed, range, closingSpeed) {
    const { capacity, encounters, outcomes } = this.layout, count = leadSpeed.length;
    this.writeNumbers(kernel, numbers);
    const results = Array.from({ length: 4 }, () => new Float64Array(count));
    for (let first = 0; first < count; first += capacity) {
      const size = Math.min(capacity, count - first);
      [leadSpeed, range, closingSpeed].forEach((values, row) => {
        this.memory.set(values.subarray(first, first + size), encounters / 8 + row * capacity);
      });
      this.run[kernel](encounters, 0, size, this.layout[kernel].record, outcomes);
      results.forEach((values, row) => {
        const start = outcomes / 8 + row * capacity;
        values.set(this.memory.subarray(start, start + size), first);
      });
    }
    return { crash: results[0], minRange: results[1], minTtc: results[2], impactSpeed: results[3] };
  }

  // States of one encounter, as the library's traces have them.
  trace(kernel, numbers, encounter) {
    this.writeNumbers(kernel, numbers);
    return kernel === "car" ? this.traceCar(encounter) : this.traceDriver(encounter);
  }

  place(encounter) {
    const { encounters, capacity } = this.layout;
    [encounter.leadSpeed, encounter.range, encounter.closingSpeed].forEach((value, row) => {
      this.memory[encounters / 8 + row * capacity] = value;
    });
    return encounters;
  }

  traceCar(encounter) {
    const { car, index } = this.layout, { rows, state, record } = car, { run } = this;
    const at = (row) => this.memory[state / 8 + row * car.lanes];
    run.car_start(this.place(encounter), 0, 1, record, state, index);
    const states = [];
    for (let step = 0, over = false; !over; step++) {
      over = step === car.steps || !(at(rows.RANGE) > 0 && at(rows.SPEED) > 0);
      const [lead, range, speed] = [at(rows.LEAD), at(rows.RANGE), at(rows.SPEED)], acceleration = at(rows.ACCELERATION);
      if (!over) run.car_watch(state, 1, record);
      const ttc = !over && speed > lead ? range / (speed - lead) : Infinity;
      states.push({ time: step * car.step, range, lead, speed, acceleration, ttc, emergency: at(rows.TIMER) > 0 });
      run.car_command(state, 1, record);
      run.car_move(state, 1, record);
    }
    return states;
  }

  traceDriver(encounter) {
    const { driver } = this.layout, { rows, state, record, names, step } = driver, { run } = this;
    const at = (row) => this.memory[state / 8 + row * driver.lanes];
    const length = this.memory[record / 8 + names.indexOf("length")], states = [];
    const add = (k, distance) => {
      const [lead, speed] = [at(rows.LEAD), at(rows.SPEED)], range = distance - length, closing = speed - lead;
      const ttc = range > 0 && closing > 0 ? range / closing : Infinity;
      states.push({
        time: k * step, range, lead, speed, acceleration: at(rows.ACCELERATION), ttc, emergency: at(rows.WANTED) > 0,
      });
    };
    run.driver_start(record, this.place(encounter), 0, state, 0);
    for (;;) {
      const before = at(rows.DISTANCE), closing = at(rows.SPEED) - at(rows.LEAD);
      run.driver_skip(record, state, 0);
      for (let k = 0, first = states.length; first + k < at(rows.STEPS); k++) add(first + k, before - k * closing * step);
      for (let sweep = 0; sweep < rows.SWEEP; sweep++) {
        run.driver_watch(state, 1, record);
        run.driver_decide(state, 1, record);
        add(at(rows.STEPS), at(rows.DISTANCE));
        if (at(rows.OVER) > 0) return states;
        run.driver_move(state, 1, record);
      }
    }
  }
}

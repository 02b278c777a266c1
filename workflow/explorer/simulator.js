// The car and the drivers in a cut-in, and the car in the left turn: the same operations in the same order as in
// vehicles/builtin/kernel.py, driver_kernel.py and scenarios/crossing/kernel.py, for one encounter at a time. In cut-ins every
// outcome equals Python's to the last bit (tests/unit/publishing/test_explorer_simulator.py). In the left turn they may differ in the last
// bits, because cosines do. Outcomes that the page does not show are left out.
// The columns of encounters are in the order of the scenario's variables.
// Each simulation is one function whose state is in local variables, because calls in every step would be slow.
"use strict";

const STEP = 0.1; // [s]
const CAR_STEPS = 80, DRIVER_STATES = 349;
const SWEEP = 8; // number of steps after which a driver without danger skips steps
const RSS_RULE = 1, FSM_RULE = 2;
const { abs, floor, max, min } = Math;

// Simulate cut-in k of the car; write its outcomes to `found`, and its states to `states`, if given.
function driveCar(car, [leadSpeed, ranges, closingSpeed], k, found, states) {
  const lead = leadSpeed[k];
  let range = ranges[k], speed = min(lead + closingSpeed[k], car.top_start_speed);
  let acceleration = 0, command = 0, error = 0, timer = 0, onset = 0, minRange = range;
  for (let step = 0; ; step++) {
    const over = step === CAR_STEPS || !(range > 0 && speed > 0);
    if (!over) { // `watch`
      const ttc = -range / (lead - speed); // -Infinity at equal speeds: not closing
      const threshold = min(car.threshold_base + car.threshold_slope * (speed - car.threshold_speed), car.threshold_top);
      const wasOn = timer > 0;
      if (!wasOn) onset = command;
      timer = ttc > 0 && (ttc <= threshold || (wasOn && ttc <= car.release_ttc)) ? timer + STEP : 0;
    }
    if (states) states.push(shown(step, range, lead, speed, acceleration, over ? Infinity : range, timer));
    if (over) break;

    if (timer > 0) { // `command`
      command = max(onset - car.aeb_jerk * timer, -car.aeb_deceleration);
      error = 0;
    } else {
      const last = error;
      error = car.headway - range / speed;
      const acc = command + car.kp * (error - last) + car.ki_half_step * (error + last);
      command = min(max(acc, -car.acc_limit), speed >= car.acc_top_speed ? 0 : car.acc_limit);
    }

    const before = speed, wanted = min(max(command, -car.friction_limit), car.friction_limit); // `move`
    acceleration = min(max(wanted, acceleration - car.acceleration_step), acceleration + car.acceleration_step);
    speed = max(speed + acceleration * STEP, 0);
    range += (lead - (before + speed) / 2) * STEP;
    minRange = min(minRange, range);
  }
  found.crash[k] = range <= 0 ? 1 : 0;
  found.closest[k] = minRange;
  found.impactSpeed[k] = range <= 0 ? max(speed - lead, 0) : 0;
}

const ttcOf = (gap, closing) => (gap > 0 && closing > 0 ? max(gap / closing, Number.MIN_VALUE) : Infinity);

// The longitudinal safe distance of RSS.
function rssDistance(driver, speed, lead) {
  const time = driver.response_time, endSpeed = speed + driver.response_acceleration * time;
  return (speed + endSpeed) * time / 2 + endSpeed * endSpeed * driver.host_path - lead * lead * driver.lead_path;
}

// The gap at which a driver first perceives danger, at constant speeds in the same lane.
function wakeGap(driver, speed, lead) {
  const closing = speed - lead, time = driver.response_time;
  if (driver.rule === RSS_RULE) return rssDistance(driver, speed, lead);
  if (driver.rule !== FSM_RULE) return closing * (driver.critical_ttc + driver.ttc_slope * closing);
  const shared = speed * time - lead * lead * driver.lead_path + driver.margin;
  return max(shared + speed * speed * driver.comfort_path + driver.safe_margin,
    (closing + closing) * time / 2 + closing * closing * driver.comfort_path);
}

// A fuzzy number of FSM: 0 above the safe gap, 1 below the unsafe gap, and linear in between.
const fuzzy = (gap, safe, unsafe) => (gap >= safe ? 0 : gap <= unsafe ? 1 : (gap - safe) / (unsafe - safe));

// Simulate cut-in k of a driver, as `driveCar` does for the car.
function driveDriver(driver, [leadSpeed, ranges, closingSpeed], k, found, states) {
  const lead = leadSpeed[k], { rule, length, width, lateral_speed: sideways, response_time: time } = driver;
  let speed = lead + closingSpeed[k], closing = closingSpeed[k], distance = ranges[k] + length, offset = 0, moving = 0;
  if (sideways > 0) {
    distance += max(closing, 0) * ((driver.start_offset - driver.entry_offset) / sideways) - closing * STEP;
    offset = driver.start_offset - sideways * STEP;
    moving = floor(driver.start_offset / STEP / sideways);
  }
  let acceleration = 0, ramp = driver.coasting, waited = 0, steps = 0, wanted = 0, minRange = ranges[k];
  for (let step = 0; ; step++) {
    closing = speed - lead;
    const isCalm = waited === 0 && wanted === 0 && (steps === 0 || sideways > 0);
    if (step % SWEEP === 0 && isCalm && abs(offset) < width && closing > 0) { // `skip`
      const gap = distance - length, wake = wakeGap(driver, speed, lead);
      if (gap > 0 && gap > wake) {
        const skipped = max(0, min(floor((gap - wake) / (closing * STEP)), DRIVER_STATES - 1 - steps));
        for (let later = 0; states && later < skipped; later++) {
          const ahead = distance - later * closing * STEP - length;
          states.push(shown(steps + later, ahead, lead, speed, acceleration, ahead, wanted));
        }
        steps += skipped;
        distance -= skipped * closing * STEP;
        offset -= min(skipped, max(moving, 0)) * sideways * STEP;
        moving -= skipped;
      }
    }

    const gap = abs(distance) - length, lateralGap = abs(offset) - width; // `watch`
    const behind = distance > 0, overlaps = lateralGap < 0, contact = overlaps && gap <= 0;
    if (overlaps && (behind || contact)) minRange = min(minRange, gap);
    const dropped = lateralGap <= 0 && abs(gap) > abs(closing) * driver.dropped_ttc;
    const noMore = behind ? overlaps && closing <= 0 : gap > 0 && closing >= 0;

    wanted = 0; // `decide`
    const lateral = moving > 0 ? sideways : 0;
    if (!(distance >= 0)) wanted = 0;
    else if (rule === FSM_RULE) {
      // A car next to the lane is no danger if it does not come nearer, or if the host passes before it arrives.
      const arrives = lateralGap * closing <= (distance + length + STEP * closing) * lateral;
      if (lateralGap <= 0 || (lateral > 0 && closing >= 0 && arrives)) {
        const left = closing + time * max(acceleration, -driver.comfort); // closing speed at the end of the response
        const travelled = (closing + left) * time / 2, criticalSafe = travelled + left * left * driver.comfort_path;
        if (closing > 0 && (left >= 0 ? gap < criticalSafe : gap * -2 * acceleration < closing * closing)) {
          const share = left < 0 ? 1 : fuzzy(gap, criticalSafe, travelled + left * left * driver.host_path);
          wanted = min(driver.comfort + driver.comfort_to_full * share, driver.deceleration);
        } else {
          const shared = speed * time - lead * lead * driver.lead_path + driver.margin;
          const safe = shared + speed * speed * driver.comfort_path + driver.safe_margin;
          wanted = min(driver.comfort * fuzzy(gap, safe, shared + speed * speed * driver.host_path), driver.deceleration);
        }
      }
    } else if (rule === RSS_RULE) {
      const endSpeed = lateral + driver.lateral_acceleration * time;
      const safe = driver.lateral_gap + (lateral + endSpeed) * time / 2 + endSpeed * endSpeed * driver.lateral_path;
      if (gap < rssDistance(driver, speed, lead) && lateralGap < safe) wanted = driver.deceleration;
    } else if (lateralGap <= driver.lateral_gap && abs(gap) <= abs(closing) * (driver.critical_ttc + driver.ttc_slope * closing)) {
      wanted = driver.deceleration;
    }
    if (states) states.push(shown(steps, distance - length, lead, speed, acceleration, distance - length, wanted));
    if (contact || dropped || noMore || steps + 1 >= DRIVER_STATES) break;

    const danger = wanted > 0, reacts = waited < driver.reaction_steps, braking = min(ramp + driver.ramp_step, wanted); // `move`
    acceleration = danger ? (reacts ? -driver.coasting : -braking) : 0;
    speed = max(speed + acceleration * STEP, 0);
    distance -= (speed - lead) * STEP;
    if (moving > 0) offset -= sideways * STEP;
    if (danger && reacts) waited += 1;
    else if (danger) ramp = braking;
    else if (driver.forgets_ramp) ramp = 0;
    moving -= 1;
    steps += 1;
  }
  const crash = abs(offset) < width && abs(distance) <= length;
  found.crash[k] = crash ? 1 : 0;
  found.closest[k] = minRange;
  found.impactSpeed[k] = crash ? speed - lead : 0;
}

// A state as the library's traces have it; an emergency is on while `alarm` is above 0.
function shown(steps, range, lead, speed, acceleration, gap, alarm) {
  const ttc = gap < Infinity ? ttcOf(gap, speed - lead) : Infinity;
  return { time: steps * STEP, range, lead, speed, acceleration, ttc, emergency: alarm > 0 };
}

// The left turn.
const RADIUS = 6, LANE = 3.9, LEAD_TIME = 1; // [m], [m], [s]
const CONFLICT_ANGLE = Math.acos((RADIUS - LANE) / RADIUS), QUARTER = Math.PI / 2;
const TOLERANCE_ROOT = 0.251188643150958, SMALL = 1e-3; // 1e-3 ** 0.2, and the smallest size of a state
const NODES = [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1];
const STAGES = [
  [], [1 / 5], [3 / 40, 9 / 40], [44 / 45, -56 / 15, 32 / 9], [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
  [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656], [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
];

// Position of the target between two ticks: ahead + ahead1 t + ahead2 t^2 along the path of the host, and similarly across it.
const aheadAt = (p, t) => p.ahead + t * (p.ahead1 + t * p.ahead2);
const asideAt = (p, t) => p.aside + t * (p.aside1 + t * p.aside2);
const squared = (p, t) => aheadAt(p, t) * aheadAt(p, t) + asideAt(p, t) * asideAt(p, t);
const parting = (p, t) => aheadAt(p, t) * (p.ahead1 + 2 * t * p.ahead2) + asideAt(p, t) * (p.aside1 + 2 * t * p.aside2);
const curved = ({ ahead, ahead1: b, ahead2: c, aside, aside1: e, aside2: f }) => b * b + e * e + 2 * (ahead * c + aside * f);

// The time before `end` at which the distance is smallest: the best of the ends and of the local minima between the roots of
// the second derivative.
function closestTime(p, end) {
  const { ahead1: b, ahead2: c, aside1: e, aside2: f } = p;
  const square = 6 * (c * c + f * f), half = 3 * (b * c + e * f), constant = curved(p);
  const discriminant = half * half - square * constant;
  let low = end, high = end;
  if (discriminant > 0) {
    const larger = half > 0 ? -half - Math.sqrt(discriminant) : -half + Math.sqrt(discriminant);
    const one = min(max(square !== 0 ? larger / square : end, 0), end), two = min(max(constant / larger, 0), end);
    [low, high] = [min(one, two), max(one, two)];
  }
  let best = squared(p, 0) <= squared(p, end) ? 0 : end, left = 0, falls = parting(p, 0) < 0;
  for (const right of [low, high, end]) {
    const fell = falls;
    falls = parting(p, right) < 0;
    if (left < right && fell && !falls) {
      let [before, after] = [left, right];
      for (let k = 0; k < 30; k++) {
        const middle = (before + after) / 2;
        if (parting(p, middle) < 0) before = middle;
        else after = middle;
      }
      if (squared(p, before) < squared(p, best)) best = before;
    }
    left = right;
  }
  return best;
}

// The time at which a contact began, by bisection.
function contactTime(p, contact, within) {
  let before = 0;
  for (let k = 0; k < 40; k++) {
    const middle = (before + within) / 2;
    if (squared(p, middle) < contact * contact) within = middle;
    else before = middle;
  }
  return within;
}

// Move the host over a step of the solver ode45, in its order of summation.
function advance(host, acceleration, rate, growth, h) {
  let gain = 0, change = 0;
  for (let stage = 0; stage < 7; stage++) {
    gain = 0;
    for (let j = 0; j < STAGES[stage].length; j++) gain += acceleration * (h * STAGES[stage][j]);
    if (stage < 6) change += (rate + growth * NODES[stage] - (host.speed + gain)) * (h * STAGES[6][stage]);
  }
  host.gain = gain;
  host.change = change;
}

// Move the host from a tick to the next one, or until it stops; returns the duration.
function integrate(host, acceleration, rate, growth, tick) {
  const begin = tick * STEP, end = (tick + 1) * STEP;
  let t = begin, stops = false;
  while (t < end && !stops) {
    let step = min(host.step, STEP);
    const last = 1.1 * step >= end - t;
    if (last) step = end - t;
    let next = last ? end : t + step, h = next - t;
    const now = rate + growth * ((t - begin) / STEP), rise = growth * (h / STEP);
    advance(host, acceleration, now, rise, h);
    stops = host.speed + host.gain <= 0;
    if (stops) {
      h = -host.speed / acceleration;
      advance(host, acceleration, now, growth * (h / STEP), h);
      next = t + h;
    }
    host.speed = stops ? 0 : host.speed + host.gain;
    host.range += host.change;
    host.step = step / 0.2;
    t = next;
  }
  return stops ? t - begin : STEP;
}

// Simulate left turn k of the car, as `driveCar` does for a cut-in. A run continues after a contact.
function driveTurn(car, [speeds, turningSpeeds, distances], k, found, states) {
  const turning = turningSpeeds[k], { contact } = car;
  const toConflict = min(CONFLICT_ANGLE, LEAD_TIME * turning / RADIUS), turned = CONFLICT_ANGLE - toConflict;
  const leadTime = turning > 0 ? toConflict * RADIUS / turning : LEAD_TIME;
  const points = floor(QUARTER * RADIUS / turning / STEP) + 1;
  let first = floor(turned * RADIUS / turning / STEP + 0.5), ticks = floor((RADIUS * QUARTER + 2 * LANE) / turning / STEP) - first;
  if (!Number.isFinite(ticks)) [first, ticks] = [0, Infinity];
  let ahead = distances[k] * Math.sin(CONFLICT_ANGLE) + speeds[k] * leadTime + RADIUS * (1 - Math.sin(turned));
  let aside = LANE - RADIUS * (1 - Math.cos(turned));
  const host = { speed: speeds[k], range: ahead, step: 0, gain: 0, change: 0 };
  const angle = (tick) => (points > 1 ? (first + tick) * QUARTER / (points - 1) : QUARTER);
  const towardsAt = (tick) => (first + tick >= points ? 0 : turning * Math.cos(angle(tick)));
  const acrossAt = (tick) => (first + tick >= points ? turning : turning * Math.sin(angle(tick)));
  let towards = towardsAt(0), across = acrossAt(0), command = 0, error = 0, timer = 0, onset = 0, acceleration = 0, end = 0, passed = false;
  let closest = Infinity, impactSpeed = 0;
  for (let tick = 0; ; tick++) {
    if (states) states.push({ time: max(tick - 1, 0) * STEP + end, ahead, aside, speed: host.speed, acceleration, emergency: timer > 0 });
    if (passed || host.speed <= 0 || tick >= ticks || tick >= car.most_ticks || ahead === Infinity) break;

    const ttc = -host.range / (towards - host.speed), wasOn = timer > 0; // the sign of the target's speed is that of the authors
    const threshold = host.speed >= car.threshold_top_speed ? car.threshold_top
      : car.threshold_base + car.threshold_slope * (host.speed - car.threshold_speed);
    const last = wasOn ? 0 : error;
    error = car.headway - host.range / host.speed;
    if ((ttc > 0 && ttc <= threshold) || (wasOn && !(ttc > car.release_ttc || ttc < 0))) {
      if (!wasOn) onset = command;
      timer += STEP;
      command = max(-car.aeb_deceleration, onset - car.aeb_jerk * timer);
    } else {
      const acc = command + car.kp * (error - last) + car.ki_half_step * (error + last);
      command = min(max(acc, -car.acc_limit), host.speed >= car.acc_top_speed ? 0 : car.acc_limit);
      timer = 0;
    }
    const wanted = min(max(command, -car.friction_limit), car.friction_limit);
    acceleration = min(max(wanted, acceleration - car.acceleration_step), acceleration + car.acceleration_step);

    const nextTowards = towardsAt(tick + 1), nextAcross = acrossAt(tick + 1), growth = nextTowards - towards;
    const p = {
      ahead, ahead1: -(towards + host.speed), ahead2: -(growth / STEP + acceleration) / 2,
      aside, aside1: -across, aside2: -((nextAcross - across) / STEP / 2),
    };
    if (tick === 0) {
      let fastest = max(host.speed, abs(towards), abs(p.aside1), squared(p, 0) < contact * contact ? 1 : 0) / SMALL;
      fastest = max(fastest, abs(acceleration) / max(host.speed, SMALL), abs(towards - host.speed) / max(ahead, SMALL));
      host.step = 1 / (fastest * (1.25 / TOLERANCE_ROOT));
    }
    end = integrate(host, acceleration, towards, growth, tick);
    const begin2 = squared(p, 0), half = 3 * (p.ahead1 * p.ahead2 + p.aside1 * p.aside2);
    const isFar = !(curved(p) < 2 * abs(half) * end || min(begin2, squared(p, end)) <= contact * contact);
    if (!(isFar && (parting(p, end) < 0 || (parting(p, 0) > 0 && begin2 >= closest * closest)))) {
      const t = closestTime(p, end), distance = Math.sqrt(squared(p, t));
      if (distance < contact && closest >= contact) {
        const at = contactTime(p, contact, t);
        impactSpeed = Math.hypot(p.ahead1 + 2 * at * p.ahead2, p.aside1 + 2 * at * p.aside2);
      }
      closest = min(closest, distance);
    }
    [ahead, aside, towards, across] = [aheadAt(p, end), asideAt(p, end), nextTowards, nextAcross];
    passed = -ahead > max(closest, contact) || -aside > max(closest, contact);
  }
  closest = min(closest, Math.hypot(ahead, aside));
  found.crash[k] = closest < contact ? 1 : 0;
  found.closest[k] = closest;
  found.impactSpeed[k] = impactSpeed;
}

const KERNELS = { car: driveCar, driver: driveDriver, turn: driveTurn };

// Simulate encounters of a vehicle with the given numbers.
function simulate(kernel, numbers, ...columns) {
  const column = () => new Float64Array(columns[0].length), found = { crash: column(), closest: column(), impactSpeed: column() };
  for (let k = 0; k < columns[0].length; k++) KERNELS[kernel](numbers, columns, k, found);
  return found;
}

// The states of one encounter over time.
function trace(kernel, numbers, encounter) {
  const states = [], found = { crash: [], closest: [], impactSpeed: [] };
  KERNELS[kernel](numbers, encounter.map((value) => [value]), 0, found, states);
  return states;
}

// The car and the drivers: the same operations in the same order as in vehicles/builtin/kernel.py and driver_kernel.py,
// for one cut-in at a time. Every outcome equals Python's to the last bit (tests/unit/test_explorer_simulator.py); the
// smallest TTC, which the page does not show, is left out.
// Each simulation is one function whose state is in local variables, because calls in every step would be slow.
"use strict";

const STEP = 0.1; // [s]
const CAR_STEPS = 80, DRIVER_STATES = 349;
const SWEEP = 8; // number of steps after which a driver without danger skips steps
const RSS_RULE = 1, FSM_RULE = 2;
const { abs, floor, max, min } = Math;

// Simulate cut-in k of the car; write its outcomes to `found`, and its states to `states`, if given.
function driveCar(car, { leadSpeed, range: ranges, closingSpeed }, k, found, states) {
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
  found.minRange[k] = minRange;
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
function driveDriver(driver, { leadSpeed, range: ranges, closingSpeed }, k, found, states) {
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
  found.minRange[k] = minRange;
  found.impactSpeed[k] = crash ? speed - lead : 0;
}

// A state as the library's traces have it; an emergency is on while `alarm` is above 0.
function shown(steps, range, lead, speed, acceleration, gap, alarm) {
  const ttc = gap < Infinity ? ttcOf(gap, speed - lead) : Infinity;
  return { time: steps * STEP, range, lead, speed, acceleration, ttc, emergency: alarm > 0 };
}

const KERNELS = { car: driveCar, driver: driveDriver };

// Simulate cut-ins of a vehicle with the given numbers.
function simulate(kernel, numbers, leadSpeed, range, closingSpeed) {
  const column = () => new Float64Array(leadSpeed.length), cutIns = { leadSpeed, range, closingSpeed };
  const found = { crash: column(), minRange: column(), impactSpeed: column() };
  for (let k = 0; k < leadSpeed.length; k++) KERNELS[kernel](numbers, cutIns, k, found);
  return found;
}

// The states of one cut-in over time.
function trace(kernel, numbers, { leadSpeed, range, closingSpeed }) {
  const states = [], found = { crash: [], minRange: [], impactSpeed: [] };
  KERNELS[kernel](numbers, { leadSpeed: [leadSpeed], range: [range], closingSpeed: [closingSpeed] }, 0, found, states);
  return states;
}

"""Templates of the page of instructions for an exported set.

The page explains how others compute a crash probability from the outcomes of their own vehicle.
"""

RECIPE = """\
# {size} {noun}s with weights

{intro}Run your vehicle in all {size} scenarios, note in which it crashed, and follow this page. You do not
need any of our programs.

## Files

{files}

## What to do

1. Run every scenario once, {until}.
   Do not leave out any scenario: one that you cannot run could also end in a crash, and without it the sum
   may be too small.
2. Write `outcomes.csv` with two columns: `scenario`, and `crash`, which is {crash}.
3. Run this script in the folder of the two tables. It needs only Python.

```python
import csv, math, statistics

confidence = 0.80
rows = list(csv.DictReader(open("scenarios.csv")))
crash = {{int(row["scenario"]): int(row["crash"]) for row in csv.DictReader(open("outcomes.csv"))}}
shells = {{}}  # by shell: weight of a scenario, number of scenarios, number of crashes
for row in rows:
    weight, count, crashes = shells.get(int(row["shell"]), (float(row["weight"]), 0, 0))
    shells[int(row["shell"])] = weight, count + 1, crashes + crash[int(row["scenario"])]
probability = sum(weight * crashes for weight, count, crashes in shells.values())
if probability > 0:
    first = min(shell for shell, (weight, count, crashes) in shells.items() if crashes)
    variance = 0.0
    for shell, (weight, count, crashes) in shells.items():
        if shell >= first - 1:
            share = (crashes + 0.5) / (count + 1)
            variance += (weight * count) ** 2 * share * (1 - share) / count
    reach = statistics.NormalDist().inv_cdf((1 + confidence) / 2) * math.sqrt(variance) / probability
    low, high = probability * math.exp(-reach), probability * math.exp(reach)
else:
    low = 0.0
    high = max(w * n * (1 - (1 - confidence) ** (1 / n)) for w, n, _ in shells.values())
interval = f"{{confidence:.0%}} interval {{low:.3g}} to {{high:.3g}}"
print(f"crash probability {{probability:.3g}} per {noun}, {{interval}}")
```

{whole}## Why this is right

{why}

The interval contains the random error of drawing the scenarios. Half a crash is added to each shell, from the
one before the first shell with a crash on, because a few scenarios without a crash do not prove that there
are no crashes in a shell.

## What is assumed

{assumed}

{uncertainty}

| shell | {measure} | probability | scenarios |
| --- | --- | --- | --- |
{shells}

## Where it comes from

{origin}
"""

# The parts of the page that describe cut-ins and their files.
CUT_IN_FILES = {
    "intro": """\
In each scenario another car comes into the lane of the host, at the given range, and {motion};
the host closes in. How often would your vehicle crash in such cut-ins, as often as they happen on the road?
""",
    "files": """\
- `scenario_001.xosc` and so on: OpenSCENARIO XML 1.2; `straight_road.xodr`: their road, OpenDRIVE. The
  entity `host` is your vehicle. It has its speed at the start and no action. Let your controller keep
  this speed in the {run_up:g} s until the other car crosses the marking; the lane change begins {begins:g} s
  after the start. From the crossing on, your vehicle drives by itself. If it drives by itself earlier and
  brakes early, report what happens. The range is the distance between the bumpers of two cars of 4.3 m when
  the middle of the other car crosses the marking. If your car is longer or shorter, move its start so that
  the range stays the same. The speed of the other car is given along its path, and such that its speed
  along the road is `lead_speed` also during the lane change. Play the files with steps of 5 ms or less:
  a player notices the start of the lane change up to one step late, and with 33 ms the host comes up to
  a metre closer in this time.
- `scenarios.csv`: a row for each scenario with `scenario` (its number), `shell`, `weight`, `lead_speed`
  [m/s], `range` [m], `closing_speed` [m/s] (host minus lead, at the marking), `host_speed` [m/s],
  `file`{columns}.""",
    "until": "until the cars touch or {over}",
    "crash": "1 if the cars touched and 0\n   if not",
}

# The other parts of the page for cut-ins that are ordered by deceleration.
CUT_INS = {
    "why": """\
Cut-ins are sorted by the constant deceleration that just avoids the crash if it begins at once, a = C^2
/ (2 R) with closing speed C and range R, and cut into shells. Each shell has a known probability under
the law of cut-ins, and its scenarios were drawn from it by that law. The crashes of a shell, divided by
its scenarios, estimate without bias how often your vehicle crashes in it. A weight is the shell's
probability divided by its number of scenarios, so the sum of the weights of all crashes is the crash
probability of a cut-in (stratified sampling; Cochran, Sampling Techniques, 1977, chapter 5). This holds
for any vehicle.""",
    "assumed": """\
**{safe} of all cut-ins are assumed to be safe, and are not in this set**: those that a constant
deceleration of {least} m/s^2 avoids. The set represents the other {harder}. If your vehicle crashes in the
easy cut-ins, its crash probability is larger than the number that you compute. If it crashes in shell 1, it
probably also crashes in easier cut-ins; then use a set with a smaller deceleration.""",
    "measure": "deceleration needed [m/s^2]",
}

# What the other car does: it keeps its speed, or changes it.
STILL = {
    "motion": "keeps its speed",
    "columns": "",
    "over": "your vehicle is no longer faster than the other car",
}
MOVING = {
    "motion": "then changes its speed",
    "columns": ", and `speed_0.1`, ..., `speed_8.0` [m/s]: the speed of the other car so many seconds\n"
    "  after the marking",
    "over": "8 s have passed since the other car crossed the marking",
}

# The parts of the page for encounters that are ordered by the score of a built-in vehicle.
ENCOUNTERS = {
    "intro": """\
In each scenario, {description}. How often would your vehicle crash in such encounters, as often as they
happen on the road?
""",
    "files": """\
- `scenarios.csv`: a row for each scenario with `scenario` (its number), `shell`, `weight`, and
{variables}

There are no OpenSCENARIO files, because they are written for cut-ins only.""",
    "until": "until the encounter is over",
    "crash": "{crash}",
    "why": """\
About {pool:,} encounters were drawn from the law, simulated with the built-in vehicle `{vehicle}`, and
sorted by its score, the outcome `{score}` ({score_meaning}). They were cut into shells, and the scenarios of
a shell were selected from its encounters at random. The crashes of a shell, divided by its scenarios,
estimate without bias how often your vehicle crashes in it. A weight is the shell's share of the draws divided
by its number of scenarios, so the sum of the weights of all crashes estimates the crash probability of an
encounter (two-phase sampling for stratification; Cochran, Sampling Techniques, 1977, chapter 12). This holds
for any vehicle. The estimate is more accurate if your vehicle resembles the built-in one.

The shares of the shells are those of {pool:,} draws. This adds a relative error of
1 / sqrt({pool:,} times the probability), which is not in the interval.""",
    "assumed": """\
No encounter is assumed to be safe. If your vehicle crashes in the first shells, it crashes in encounters
that are easy for the built-in vehicle. These few scenarios have large weights, and the interval is wide.""",
    "measure": "{score}",
}

ONE_LAW = """\
The probability is the one under the law of {noun}s that is stated below. The interval does not include the
uncertainty about this law, which was fitted to a finite number of records."""

ALL_LAWS = """\
The first interval contains only the random error of drawing the scenarios. The intervals by `weights.csv`
also contain the uncertainty about the law of {noun}s, which was fitted to a finite number of records."""

WHOLE = """\
## The uncertainty of the records

The records do not determine the law of {noun}s exactly. `weights.csv` has the weights of the scenarios under
{draws} laws that agree with the records, drawn from their posterior: a row for each `scenario`, a column for
each draw. Add these lines to the script:

```python
draws = list(csv.DictReader(open("weights.csv")))
names = [name for name in draws[0] if name.startswith("draw")]
crashed = [row for row in draws if crash[int(row["scenario"])]]
sums = [sum(float(row[name]) for row in crashed) for name in names]
if probability > 0:
    error = math.sqrt(variance) / probability
    noise = [statistics.NormalDist().inv_cdf((i + 0.5) / 25) for i in range(25)]
    values = sorted(total * math.exp(error * z) for total in sums for z in noise)
    print(f"median with the uncertainty of the records {{values[len(values) // 2]:.3g}}")
    for level in (0.5, 0.8, 0.95):
        ends = [values[round((len(values) - 1) * (1 + side * level) / 2)] for side in (-1, 1)]
        print(f"{{level:.0%}} interval {{ends[0]:.3g}} to {{ends[1]:.3g}}")
```

Each draw gives its own crash probability. The values are widened by the error of the drawing, which is taken
to be the same for all draws.

"""

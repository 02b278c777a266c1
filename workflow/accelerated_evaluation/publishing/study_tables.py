"""Tables of results: the name by which figures and tables ask for each, and its file."""

TABLES = {
    # Number and share of the lane changes in each segment.
    "segment_counts": "segments.csv",
    # Kendall's tau of each pair of variables, inside each segment.
    "dependence": "dependence.csv",
    # Log-likelihood, AIC and rank of all candidate families.
    "candidates": "candidates.csv",
    # Every iteration of every Cross-Entropy search.
    "trace": "cross_entropy_trace.csv",
    # Estimates of importance sampling on the way to convergence, and beyond it.
    "course": "estimates_course.csv",
    # What crude Monte Carlo found, over all segments and in each.
    "crude": "crude.csv",
    # Every simulation of every replicate of the surrogate-guided sampler.
    "runs": "estimates_runs.csv",
    # Exact crash probabilities, over all segments and in each, with their standard errors.
    "exact": "exact.csv",
    # Exact crash probabilities by resolution of the crash map.
    "convergence": "convergence.csv",
    # Exact coefficient of variation of a weight under each f*.
    "variation": "variation.csv",
    # Probabilities of crashes above impact speeds, and of near misses.
    "severity": "severity.csv",
    # Mean and quantiles of the impact speed of crashes.
    "impact_speed": "impact_speed.csv",
    # Exact crash probability with one choice changed at a time.
    "sensitivity": "sensitivity.csv",
    # Budget of the uncertainty of the crash probability, by source.
    "uncertainty": "uncertainty.csv",
    # Crash probability of the law refitted to each resample of the lane changes.
    "bootstrap": "bootstrap.csv",
    # Held-out scores, weights and crash probabilities of laws, and whether the records refuse them.
    "laws": "laws/laws.csv",
    # Recorded against expected counts of cut-ins and near misses near the crash set.
    "calibration": "laws/calibration.csv",
    # Crashes drawn from laws: where each law puts them.
    "crash_places": "laws/crash_places.csv",
    # The probability of a crash and of near misses, all that is not known included.
    "answer": "laws/answer.csv",
    # Rates of cut-ins, crashes and near misses per kilometre and hour, as far as these are known.
    "exposure": "laws/exposure.csv",
    # Crash probabilities of vehicles, and their ratios to the careful human's.
    "vehicles": "laws/vehicles.csv",
    # Drivers who are injured: per cut-in, and per million kilometres and hours as far as these are known.
    "injuries": "laws/injuries.csv",
    # The same per cut-in, for each pair of published curves.
    "injuries_by_curve": "laws/injuries_by_curve.csv",
    # Where the uncertainty of the injured drivers comes from.
    "injury_budget": "laws/injury_budget.csv",
    # The published curves of the risk of injury.
    "injury_curves": "laws/injury_curves.csv",
    # Ratios of the injured drivers of the vehicle under test to those of the other vehicles.
    "risk_balance": "laws/risk_balance.csv",
    # Draws of the crash probability, and the law of each.
    "answer_draws": "laws/answer_draws.csv",
    # Where the uncertainty of the answer comes from.
    "answer_budget": "laws/answer_budget.csv",
    # The answer as each threshold alone gives it.
    "answer_thresholds": "laws/answer_thresholds.csv",
    # The answer under other variants of the records.
    "data_quality": "laws/data_quality.csv",
    # Crash rates per million miles: those that the study predicts, and those that were counted.
    "counted_crashes": "counted_crashes.csv",
    # Crashes and near-crashes that are predicted for human drivers, and those that were counted.
    "human_predictions": "human_predictions.csv",
    # Crash probabilities if the lead vehicle changes its speed.
    "lead_motion": "lead_motion.csv",
    # The likeliest ways to crash and the nearest records, with what they end in.
    "happened": "happened/encounters.csv",
    # Every state of the encounters of `happened`.
    "traces": "happened/traces.csv",
    # Where each vehicle can no longer avoid the crash, by lead speed and range.
    "preventable": "happened/preventable.csv",
    # Of another scenario than the cut-in: the records, and the range of each variable in them.
    "scenario_encounters": "scenario/encounters.csv",
    "scenario_records": "scenario/records.csv",
    # Held-out scores and weights of the joint laws.
    "scenario_laws": "scenario/laws.csv",
    # The probability of each event, all that is not known included.
    "scenario_answer": "scenario/answer.csv",
    # Draws of the crash probability, and where its uncertainty comes from.
    "scenario_draws": "scenario/draws.csv",
    "scenario_budget": "scenario/budget.csv",
    # Shares of encounters and crashes by the size of a variable.
    "scenario_crash_shares": "scenario/crash_shares.csv",
    # Estimates of every replicate of every method under the heaviest law, and the runs of the surrogate.
    "scenario_estimates": "scenario/estimates.csv",
    "scenario_runs": "scenario/runs.csv",
    # How many published verdicts the vehicle reproduces.
    "scenario_agreement": "scenario/agreement.csv",
    "scenario_experiments": "scenario/experiments.csv",
    # For a slow vehicle: estimate under the mean law, simulations, those that crashed, comparisons.
    "sampled_estimate": "sampled/estimate.csv",
    "sampled_runs": "sampled/runs.csv",
    "sampled_crashes": "sampled/crashes.csv",
    "compared": "sampled/compared.csv",
    # How often intervals hold the exact probability, by method and way to stop.
    "coverage": "coverage.csv",
}

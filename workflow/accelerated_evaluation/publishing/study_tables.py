"""Tables of results: the name that figures and tables use for each of them, and its file."""

TABLES = {
    # Number and share of the lane changes in each segment.
    "segment_counts": "segments.csv",
    # Kendall's tau of each pair of variables, inside each segment.
    "dependence": "dependence.csv",
    # Ratio of the largest to the smallest quantile of TTC^-1 of the segments.
    "similarity": "similarity.csv",
    # Log-likelihood, AIC and rank of all candidate families.
    "candidates": "candidates.csv",
    # Every iteration of every Cross-Entropy search.
    "trace": "cross_entropy_trace.csv",
    # Estimates of importance sampling after increasing numbers of simulations, also beyond convergence.
    "course": "estimates_course.csv",
    # Estimates of crude Monte Carlo, over all segments and in each.
    "crude": "crude.csv",
    # Every simulation of every replicate of the surrogate-guided sampler.
    "runs": "estimates_runs.csv",
    # Exact crash probabilities, over all segments and in each, with their standard errors.
    "exact": "exact.csv",
    # Exact crash probabilities by resolution of the crash map.
    "convergence": "convergence.csv",
    # Exact coefficient of variation of the weight of a simulation under each f*.
    "variation": "variation.csv",
    # Searches of the first segment with more seeds and more updates, and how good their f* are.
    "repeated_searches": "repeated_searches.csv",
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
    # Held-out scores, weights and crash probabilities of laws, and whether the records contradict them.
    "laws": "laws/laws.csv",
    # Recorded against expected counts of cut-ins and near misses near the crash set.
    "calibration": "laws/calibration.csv",
    # Random predicted crashes: lead speed, range and closing speed, and how far they are from the records.
    "crash_places": "laws/crash_places.csv",
    # Shares of the answer by distance of the predicted crashes from the records.
    "extrapolation": "laws/extrapolation.csv",
    # Intervals of near misses that allow for clusters of critical records.
    "near_misses": "laws/near_misses.csv",
    # Crash probability for other choices of laws, weights, priors and splines.
    "choices": "laws/choices.csv",
    # The probability of a crash and of near misses, with the uncertainty from data, laws and sampling.
    "answer": "laws/answer.csv",
    # Rates of cut-ins, crashes and near misses per kilometre and per hour, if distance and time are known.
    "exposure": "laws/exposure.csv",
    # Crash probabilities of vehicles, and their ratios to the careful human's.
    "vehicles": "laws/vehicles.csv",
    # Expected number of injured drivers per cut-in, and per million kilometres and hours if these are known.
    "injuries": "laws/injuries.csv",
    # The same per cut-in, for each pair of published risk curves.
    "injuries_by_curve": "laws/injuries_by_curve.csv",
    # Budget of the uncertainty of the number of injured drivers, by source.
    "injury_budget": "laws/injury_budget.csv",
    # The published curves of the risk of injury.
    "injury_curves": "laws/injury_curves.csv",
    # Ratios of the number of injured drivers with the vehicle under test to those with the other vehicles.
    "risk_balance": "laws/risk_balance.csv",
    # Random draws of the crash probability, with the law of each.
    "answer_draws": "laws/answer_draws.csv",
    # Budget of the uncertainty of the crash probability under laws with dependence, by source.
    "answer_budget": "laws/answer_budget.csv",
    # Crash probability for each threshold of the laws' tails alone.
    "answer_thresholds": "laws/answer_thresholds.csv",
    # Crash probability for alternative treatments of the records.
    "data_quality": "laws/data_quality.csv",
    # Crash rates per million miles: those that the study predicts, and those that were counted.
    "counted_crashes": "counted_crashes.csv",
    # Crashes and near-crashes that are predicted for human drivers, and those that were counted.
    "human_predictions": "human_predictions.csv",
    # Crash probabilities if the lead vehicle changes its speed.
    "lead_motion": "lead_motion.csv",
    # The most probable kinds of crashes and the most critical records, with their outcomes.
    "happened": "happened/encounters.csv",
    # States of both cars over time in the encounters of `happened`.
    "traces": "happened/traces.csv",
    # Closing speed from which on each vehicle always crashes, by lead speed and range.
    "preventable": "happened/preventable.csv",
    # Shares of encounters and crashes by the size of a variable.
    "crash_shares": "laws/crash_shares.csv",
    # Estimates of all replicates of all methods for the law with the largest weight; runs of the surrogate.
    "scenario_estimates": "scenario/estimates.csv",
    "scenario_runs": "scenario/runs.csv",
    # Number of published verdicts that the vehicle reproduces.
    "scenario_agreement": "scenario/agreement.csv",
    # For a slow vehicle: estimate under the mean law, simulations, those that crashed, comparisons.
    "sampled_estimate": "laws/estimate.csv",
    "sampled_runs": "laws/runs.csv",
    "sampled_crashes": "laws/crashes.csv",
    "compared": "laws/compared.csv",
    # Share of intervals that contain the exact probability, by method and stopping rule.
    "coverage": "coverage.csv",
}

"""The tables of the benchmarks in their README and in two guides, made from benchmarks/results.

``python benchmarks/readme.py`` updates them.
"""

import numpy as np
import pandas as pd
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.publishing.readme import CAUSES, ROOT, WORLDS, Table, markdown, update

ANSWERS = ROOT / "benchmarks" / "results" / "answers.csv"
CERTIFICATES = ROOT / "benchmarks" / "results" / "certificates.csv"
CHANCE = ROOT / "benchmarks" / "results" / "chance.csv"
CHECKS = ROOT / "benchmarks" / "results" / "checks.csv"
PUBLIC = ROOT / "benchmarks" / "results" / "public.csv"
RECORDINGS = ROOT / "benchmarks" / "results" / "recordings.csv"
SAMPLERS = ROOT / "benchmarks" / "results" / "samplers.csv"
SCENARIOS = ROOT / "benchmarks" / "results" / "scenarios.csv"
STUDIES = ROOT / "figures"
SUCCESSORS = ROOT / "benchmarks" / "results" / "successors.csv"
VEHICLES = ROOT / "benchmarks" / "results" / "vehicles.csv"
BEYOND = ROOT / "benchmarks" / "results" / "worlds_beyond.csv"
BENCHMARKS = ROOT / "benchmarks" / "README.md"
GUIDE = ROOT / "docs" / "sampler.md"
JOINT_LAWS = ROOT / "docs" / "joint_laws.md"
YOUR_RECORDS = ROOT / "docs" / "your_records.md"
OURS = "surrogate"
LEARNERS = ("ak_mcs", "ak_is", "two_stage", "kde_ais")  # as in benchmarks/samplers/methods.py
RELIABLE = 0.05  # share of failed seeds up to which another sampler is called the best
COMMAND = "python benchmarks/readme.py"


def samplers_table(samplers: pd.DataFrame) -> str:
    """Return, for each problem of the benchmark, what this project's sampler, the paper and others need.

    Of the others the one of fewest effective simulations is shown, among those that rarely fail.
    """
    headings = (
        "problem",
        "probability",
        "this sampler",
        "its true error",
        "its 80 % intervals hold",
        "failed",
    )
    headings += ("best of the paper's methods", "best public tool")
    table = []
    for name, rows in samplers.groupby("problem", sort=False):
        ours = rows[rows["method"] == OURS].iloc[0]
        others = rows[(rows["method"] != "crude") & (rows["failed"] <= RELIABLE) & (rows["method"] != OURS)]
        is_paper = others["method"].isin([name for name in METHODS if METHODS[name].learns_apart])
        cells = (
            name.replace("_", " "),
            f"{ours.reference:.2g}",
            f"{ours.calls_mean:,.0f}",
            f"{ours['error']:.2f}",
            f"{ours.coverage80:.0%}",
            f"{ours.failed * ours.seeds:.0f} of {ours.seeds:,.0f}",
            _best(others[is_paper]),
            _best(others[~is_paper]),
        )
        table.append(cells)
    return markdown(headings, table)


def learners_table(samplers: pd.DataFrame) -> str:
    """Return, for the problems on which others that learn a surface were run, what they and ours need."""
    headings = ("problem", "method", "seeds", "calls", "95 % at most", "error", "bias")
    headings += ("off by a factor of 2", "of these claimed", "80 % holds", "95 % holds")
    learned = samplers.groupby("problem", sort=False).filter(lambda rows: rows["method"].isin(LEARNERS).any())
    forms = {"error": ".2f", "bias": "+.0%", "failed": ".0%", "claimed": ".0%"}
    forms |= {"coverage80": ".0%", "coverage95": ".0%"}
    table = []
    for _, row in learned[learned["method"].isin([OURS, *LEARNERS])].iterrows():
        cells = (
            row["problem"].replace("_", " "),
            "this sampler" if row["method"] == OURS else row["method"],
            *(f"{row[name]:,.0f}" for name in ("seeds", "calls_mean", "calls_p95")),
            *("–" if pd.isna(row[name]) else format(row[name], form) for name, form in forms.items()),
        )
        table.append(cells)
    return markdown(headings, table)


def public_table(public: pd.DataFrame) -> str:
    """Return what this project's sampler and OpenTURNS need for the problems of public collections."""
    headings = ("problem", "inputs", "reference", "seeds", "simulations", "95 % at most", "error")
    headings += ("80 % holds", "off by a factor of 2", "no number", "NAIS: simulations", "its error")
    table = []
    for name, rows in public.groupby("problem", sort=False):
        by = rows.set_index("method")
        ours, others = by.loc[OURS], by.drop(index=OURS)
        found = others[others["failed"] <= RELIABLE]
        best = None if found.empty else found.loc[(found["calls_mean"] * found["error"] ** 2).idxmin()]
        no_number = round(ours["no_number"] * ours["seeds"])
        uncertain = f" ± {ours['reference_se']:.1g}" if ours["reference_se"] else ""
        cells = (
            name.replace("_", " "),
            f"{ours['dimension']:.0f}",
            f"{ours['reference']:.3g}{uncertain}",
            *(f"{ours[column]:,.0f}" for column in ("seeds", "calls_mean", "calls_p95")),
            "–" if pd.isna(ours["error"]) else f"{ours['error']:.2f}",
            f"{ours['coverage80']:.0%}",
            f"{round(ours['failed'] * ours['seeds']) - no_number}",
            f"{no_number}",
            *_calls_and_error(best),
        )
        table.append(cells)
    return markdown(headings, table)


def _calls_and_error(row: pd.Series | None) -> tuple[str, str]:
    return ("–", "–") if row is None else (f"{row['calls_mean']:,.0f}", f"{row['error']:.2f}")


def vehicles_table(vehicles: pd.DataFrame) -> str:
    """Return, for each law and vehicle, the exact crash probability and how well the sampler finds it."""
    headings = ("law", "vehicle", "exact", "simulations", "mean / exact", "true error")
    headings += ("80 % intervals hold", "failed", "of these, said to have converged")
    table = []
    for row in vehicles.to_dict("records"):
        cells = [row["law"].replace("_", " "), row["vehicle"], f"{row['exact']:.2g}"]
        if row["seeds"]:
            found, failed = pd.notna(row["error"]), round(row["failed"] * row["seeds"])
            cells += [
                f"{row['calls_mean']:,.0f}",
                f"{1 + row['bias']:.2f}" if found else "–",
                f"{row['error']:.2f}" if found else "–",
                f"{row['coverage80']:.0%}" if found else "–",
                f"{failed} of {row['seeds']:.0f}",
                f"{row['claimed'] * failed:.0f}" if failed else "–",
            ]
        table.append((*cells, *["–"] * (len(headings) - len(cells))))
    return markdown(headings, table)


def worlds_table(worlds: pd.DataFrame) -> str:
    """Return how often the intervals cover in each kind of world, and how wide they are, as Markdown."""
    headings = ("kind", "worlds", "50 % covers", "80 % covers", "95 % covers", "80 %: upper / lower")
    headings += ("median / truth", "paper's 80 % covers")
    table = []
    for kind, rows in worlds.groupby("kind", sort=False):
        by = rows.set_index("procedure")
        ours = by.loc["this project"]
        cells = (
            kind,
            f"{ours.worlds:.0f}",
            *(f"{ours[f'coverage{level}']:.0%}" for level in (50, 80, 95)),
            f"{ours.width80:.1f}",
            f"{ours.median_ratio:.2f}",
            f"{by.loc['paper', 'coverage80']:.0%}",
        )
        table.append(cells)
    return markdown(headings, table)


def beyond_table(beyond: pd.DataFrame) -> str:
    """Return how often the intervals cover in worlds beyond the family, and what would reveal them."""
    headings = ("kind", "by", "worlds", "50 % covers", "80 % covers", "95 % covers", "80 %: upper / lower")
    headings += ("median / truth", "its 10 and 90 %", "counts differ near crashes", "by host speed")
    table = [
        (
            row.kind,
            row.procedure,
            f"{row.worlds:.0f}",
            *(f"{getattr(row, f'coverage{level}') * row.worlds:.0f}" for level in (50, 80, 95)),
            f"{row.width80:.1f}",
            f"{row.median_ratio:.2f}",
            f"{row.ratio_10:.2f}, {row.ratio_90:.2f}",
            *(f"{found * row.worlds:.0f}" for found in (row.near_found, row.host_found)),
        )
        for row in beyond.itertuples()
    ]
    return markdown(headings, table)


def causes_table(causes: pd.DataFrame) -> str:
    """Return what a threshold does by chance, and the choice among laws to the width, as Markdown."""
    headings = ("kind", "worlds", "10 %", "median", "90 %", "80 % covers", "upper / lower")
    headings += ("80 % of the true law alone covers", "its upper / lower")
    table = [
        (
            row.kind,
            f"{row.worlds:.0f}",
            *(f"{ratio:.2f}" for ratio in (row.ratio_10, row.ratio_50, row.ratio_90)),
            *(f"{row.coverage80:.0%}", f"{row.width80:.1f}"),
            *(f"{row.true_law_coverage80:.0%}", f"{row.true_law_width80:.1f}"),
        )
        for row in causes.itertuples()
    ]
    return markdown(headings, table)


def recordings_table(recordings: pd.DataFrame) -> str:
    """Return what recordings of each size take, and which of their cut-ins are found, as Markdown."""
    headings = ("rows of targets", "CSV", "processor time", "a million rows", "peak memory")
    headings += ("temporary files", "planted", "found", "invented")
    table = [
        (
            f"{row.target_rows:,}",
            f"{row.gb:.2f} GB",
            f"{row.cpu_s:.0f} s",
            f"{row.cpu_s / row.target_rows * 1e6:.1f} s",
            f"{row.peak_gb:.2f} GB",
            f"{row.temporary_gb:.2f} GB",
            *(f"{count:,}" for count in (row.planted, row.found, row.invented)),
        )
        for row in recordings.itertuples()
    ]
    return markdown(headings, table)


def certificates_table(certificates: pd.DataFrame) -> str:
    """Return what each certificate costs, and how often it misses a hidden part, as Markdown."""
    headings = ("share, curvature", "main problem", "range ≤ 1 m", "of these, draws of the wide law")
    headings += ("hidden part missed",)
    table = []
    for (share, curvature), rows in certificates.groupby(["share", "curvature"], sort=False):
        by = rows.set_index("problem")
        main, near, hidden = by.loc["segment_5_15"], by.loc["range_1"], by.loc["hidden"]
        cells = (
            f"{share:g}, {curvature:g}",
            *(f"{row.calls_mean:,.0f} (95 %: {row.calls_p95:,.0f})" for row in (main, near)),
            f"{main.wide_draws:,.0f}, {near.wide_draws:,.0f}",
            f"{hidden.missed * hidden.seeds:.0f} of {hidden.certified * hidden.seeds:.0f}",
        )
        table.append(cells)
    return markdown(headings, table)


def successors_table(successors: pd.DataFrame) -> str:
    """Return what runs of a similar vehicle save, as Markdown; the first variant is the vehicle itself."""
    headings = (
        "variant",
        "crash probability",
        "ratio to the predecessor",
        "ranked right at 60",
        "error at 60",
        "simulations to the end",
        "error",
        "80 % intervals hold",
        "off by a factor of 2",
        "simulations alone",
    )
    table = []
    for row in successors.itertuples():
        cells = (
            row.variant,
            f"{row.probability:.1e}",
            f"{row.ratio:.2f}",
            f"{row.ranked * row.seeds:.0f} of {row.seeds}" if row.ratio != 1 else "–",
            f"{row.early_error:.2f}",
            f"{row.simulations:.0f}",
            f"{row.error:.2f}",
            f"{row.holds * row.seeds:.0f} of {row.seeds}",
            f"{row.off * row.seeds:.0f}",
            f"{row.simulations_alone:.0f}",
        )
        table.append(cells)
    return markdown(headings, table)


def _best(rows: pd.DataFrame) -> str:
    if rows.empty:
        return "–"
    best = rows.loc[rows["effective_calls"].idxmin()]
    return f"{best.effective_calls:,.0f} ({best.method})"


def chance_table(chance: pd.DataFrame) -> str:
    """Return what the sampler does for systems that do not repeat themselves, as Markdown."""
    headings = ("system", "probability", "version", "seeds", "simulations", "converged")
    headings += ("of these: mean over truth", "80 % intervals cover", "off by a factor of 2")
    table = []
    for row in chance.itertuples():
        some = row.converged > 0
        cells = (
            row.problem.replace("_", " "),
            f"{row.exact:.1e}",
            row.version,
            f"{row.seeds}",
            f"{row.simulations:.0f}",
            f"{row.converged}",
            f"{row.ratio:.2g}" if some else "–",
            f"{row.covered} of {row.converged}" if some else "–",
            f"{row.off}" if some else "–",
        )
        table.append(cells)
    return markdown(headings, table)


def checks_table(checks: pd.DataFrame) -> str:
    """Return how often intervals that are checked after every batch miss the truth, as Markdown."""
    headings = (
        "problem",
        "interval",
        "seeds",
        "simulations",
        "any check missed the truth",
        "the last one did",
    )
    table = []
    for row in checks.itertuples():
        ends = f"{row.missed_at_any_low:.0%} to {row.missed_at_any_high:.0%}"
        cells = (
            row.problem.replace("_", " "),
            row.interval,
            f"{row.seeds}",
            f"{row.simulations:.0f}",
            f"{row.missed_at_any_check:.0%} (95 %: {ends})",
            f"{row.missed_at_the_end:.0%}",
        )
        table.append(cells)
    return markdown(headings, table)


def answers_table(answers: pd.DataFrame) -> str:
    """Return, for each vehicle, how far the whole answer of few runs is from that of the crash map."""
    headings = ("vehicle", "seeds", "runs", "95 % at most", "80 % interval, ends", "95 % interval, ends")
    headings += (
        "median, bias",
        "ratio to `cc_human`",
        "off by a factor of 2",
        "of these, claimed",
        "no answer",
    )
    table = []
    for row in answers.to_dict("records"):
        errors = ["–"] * 4
        if row["no_answer"] < 1:
            errors = [f"{row[f'low{level}']:.2f} and {row[f'high{level}']:.2f}" for level in (80, 95)]
            errors += [f"{np.expm1(row['median_bias']):+.1%} ± {row['median_bias_se']:.1%}"]
            errors += [f"{row['ratio']:.2f}"]
        counts = (f"{row[name] * row['seeds']:.0f}" for name in ("off_by_2", "silently", "no_answer"))
        runs = (f"{row[name]:,.0f}" for name in ("seeds", "runs_mean", "runs_p95"))
        table.append((row["vehicle"], *runs, *errors, *counts))
    return markdown(headings, table)


def scenario_answers(answer: pd.DataFrame) -> str:
    """Return the probability of each event of a scenario with its intervals."""
    rows = [
        (
            row.event,
            row.encounters,
            f"{row.median:.2g}",
            f"{row.low50:.2g} to {row.high50:.2g}",
            f"{row.low80:.2g} to {row.high80:.2g}",
            f"{row.low95:.2g} to {row.high95:.2g}",
        )
        for row in answer.itertuples()
    ]
    headings = ("event", "encounters", "median", "50 % interval", "80 % interval", "95 % interval")
    return markdown(headings, rows)


def scenarios_table(scenarios: pd.DataFrame) -> str:
    """Return how often the sampler is right in the scenarios with joint laws, and what it takes."""
    rows = [
        (
            row.scenario.replace("_", " "),
            f"{row.probability:.3g}",
            f"{row.at_most:,}",
            f"{row.seeds}",
            f"{row.simulations:.0f}",
            f"{row.covered:.0%}",
            f"{row.with_a_number:.0%}",
            f"{row.converged:.0%}",
            f"{row.silently_off_by_2}",
        )
        for row in scenarios.itertuples()
    ]
    headings = ("scenario", "probability", "runs at most", "seeds", "runs, mean", "80 % intervals that cover")
    headings += ("with an interval below 1", "converged", "of these, off by a factor of 2")
    return markdown(headings, rows)


def experiments_table(experiments: pd.DataFrame) -> str:
    """Return the stored experiments with right weights, and which check warns of them."""
    rows = [
        (
            row.experiment,
            row.weights,
            f"{row.probability:.2g} ± {row.error:.1g}",
            f"{row.errors_off:.1f}",
            *("yes" if warns else "no" for warns in (row.warns_events, row.warns_mean, row.warns_region)),
            f"{row.crude_runs:,.0f}",
        )
        for row in experiments.itertuples()
    ]
    headings = ("experiment", "weights", "estimate", "too low by, in errors", "effective crashes warn")
    headings += ("mean weight warns", "control regions warn", "crude runs that contradict it")
    return markdown(headings, rows)


TABLES = {
    "left_turn": Table(
        JOINT_LAWS, STUDIES / "left_turn/tables/scenario_answer.csv", scenario_answers, COMMAND
    ),
    "pedestrian": Table(
        JOINT_LAWS, STUDIES / "pedestrian/tables/scenario_answer.csv", scenario_answers, COMMAND
    ),
    "experiments": Table(
        JOINT_LAWS, STUDIES / "left_turn/tables/scenario_experiments.csv", experiments_table, COMMAND
    ),
    "scenarios": Table(JOINT_LAWS, SCENARIOS, scenarios_table, COMMAND),
    "answers": Table(BENCHMARKS, ANSWERS, answers_table, COMMAND),
    "samplers": Table(BENCHMARKS, SAMPLERS, samplers_table, COMMAND),
    "learners": Table(BENCHMARKS, SAMPLERS, learners_table, COMMAND),
    "public": Table(BENCHMARKS, PUBLIC, public_table, COMMAND),
    "vehicles": Table(BENCHMARKS, VEHICLES, vehicles_table, COMMAND),
    "worlds": Table(BENCHMARKS, WORLDS, worlds_table, COMMAND),
    "beyond": Table(BENCHMARKS, BEYOND, beyond_table, COMMAND),
    "causes": Table(BENCHMARKS, CAUSES, causes_table, COMMAND),
    "recordings": Table(BENCHMARKS, RECORDINGS, recordings_table, COMMAND),
    "size": Table(YOUR_RECORDS, RECORDINGS, recordings_table, COMMAND),
    "certificates": Table(GUIDE, CERTIFICATES, certificates_table, COMMAND),
    "chance": Table(GUIDE, CHANCE, chance_table, COMMAND),
    "checks": Table(GUIDE, CHECKS, checks_table, COMMAND),
    "successors": Table(GUIDE, SUCCESSORS, successors_table, COMMAND),
}

if __name__ == "__main__":
    update(TABLES)

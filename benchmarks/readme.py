"""The tables in the README, in the pages of the benchmarks and in guides, from their results and figures.

``python benchmarks/readme.py`` updates them. Each table is a dictionary from a heading to the format of its
cells, which names columns of the published file.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from accelerated_evaluation.methods import METHODS
from accelerated_evaluation.methods.importance_sampling import crude_simulations
from accelerated_evaluation.publishing.tables.claims import UNTESTED
from accelerated_evaluation.publishing.tables.paper_claims import PAPER_PROBABILITY, PAPER_RATIOS
from accelerated_evaluation.publishing.tables.spreads import rests_in_words
from scipy.special import betaincinv

sys.path += [str(Path(__file__).parent), str(Path(__file__).parent / "motorway")]

from blocks import NOTHING, RESULTS, ROOT, Block, formatted, markdown, update
from tables import MOTORWAY_TABLES

README = ROOT / "README.md"
BENCHMARKS = ROOT / "benchmarks"
FEWRUNS = ROOT / "fewruns" / "README.md"
SAMPLERS, DETAILS = (ROOT / f"fewruns/benchmarks/{name}.md" for name in ("README", "details"))
WORLDS, ANSWERS, MOTORWAY = (
    BENCHMARKS / folder / "README.md" for folder in ("worlds", "answers", "motorway")
)
JOINT_LAWS, FORMATS, EUROPE, EXPORT, SAFETY = (
    ROOT / f"docs/{name}.md"
    for name in ("joint_laws", "formats_of_recordings", "records_from_europe", "export", "safety_case")
)
OURS = "surrogate"
FAMILY = ("paper", "exponential", "heavy", "light", "two kinds")  # kinds of worlds that resemble the laws
RELIABLE = 0.05  # share of failed seeds up to which another sampler is called the best
PAPER_INTERVAL = "7e-07 to 7.8e-07, of the simulations alone"  # section VI.C, 80 %


def spaced(names: pd.Series) -> pd.Series:
    """Return names with spaces instead of underscores."""
    return names.str.replace("_", " ")


def counts(table: pd.DataFrame, *shares: str, of: str = "seeds") -> pd.DataFrame:
    """Return a table in which the named shares are numbers of seeds, or of what the column ``of`` counts."""
    return table.assign(**{share: (table[share] * table[of]).round() for share in shares})


def ours_and_others(samplers: pd.DataFrame) -> list[tuple[pd.Series, pd.DataFrame]]:
    """Return, for each problem, the row of this sampler and the rows of the others that rarely fail."""
    pairs = []
    for _, rows in samplers.groupby("problem", sort=False):
        others = rows[(rows["method"] != OURS) & (rows["failed"] <= RELIABLE)]
        pairs.append((rows[rows["method"] == OURS].iloc[0], others))
    return pairs


def samplers_table(samplers: pd.DataFrame) -> str:
    """Return the simulations that this sampler, Cross-Entropy searches and public tools need by problem.

    Of the other methods that rarely fail, the one with the fewest effective simulations is shown.
    """

    def best(others: pd.DataFrame) -> str:
        if others.empty:
            return NOTHING
        row = others.loc[others["effective_calls"].idxmin()]
        return f"{row.effective_calls:,.0f} ({row.method})"

    papers = [name for name in METHODS if METHODS[name].learns_apart]
    rows = []
    for ours, others in ours_and_others(samplers):
        others = others[others["method"] != "crude"]
        is_paper = others["method"].isin(papers)
        rows.append({**ours, "paper": best(others[is_paper]), "public": best(others[~is_paper])})
    table = counts(pd.DataFrame(rows), "failed")
    return formatted(
        table.assign(problem=spaced(table["problem"])),
        {
            "problem": "{problem}",
            "probability": "{reference:.2g}",
            "this sampler": "{calls_mean:,.0f}",
            "its true error": "{error:.2f}",
            "its 80 % intervals cover": "{coverage80:.0%}",
            "failed": "{failed:.0f} of {seeds:,.0f}",
            "best Cross-Entropy search": "{paper}",
            "best public tool": "{public}",
        },
    )


def public_table(public: pd.DataFrame) -> str:
    """Return the simulations that this sampler and OpenTURNS need for the problems of public collections."""
    rows = []
    for ours, others in ours_and_others(public):
        best = {"nais": np.nan, "nais_error": np.nan}
        if not others.empty:
            other = others.loc[(others["calls_mean"] * others["error"] ** 2).idxmin()]
            best = {"nais": other["calls_mean"], "nais_error": other["error"]}
        uncertain = f" ± {ours['reference_se']:.1g}" if ours["reference_se"] else ""
        rows.append({**ours, **best, "reference": f"{ours['reference']:.3g}{uncertain}"})
    table = counts(pd.DataFrame(rows), "failed", "no_number")
    return formatted(
        table.assign(problem=spaced(table["problem"]), off=table["failed"] - table["no_number"]),
        {
            "problem": "{problem}",
            "inputs": "{dimension:.0f}",
            "reference": "{reference}",
            "seeds": "{seeds:,.0f}",
            "simulations": "{calls_mean:,.0f}",
            "95 % at most": "{calls_p95:,.0f}",
            "error": "{error:.2f}",
            "80 % covers": "{coverage80:.0%}",
            "off by a factor of 2": "{off:.0f}",
            "no number": "{no_number:.0f}",
            "NAIS: simulations": "{nais:,.0f}",
            "its error": "{nais_error:.2f}",
        },
    )


def exported_table(exported: pd.DataFrame) -> str:
    """Return how well exported sets of scenarios estimate the crash probability of each vehicle."""
    return formatted(
        exported.assign(vehicle="`" + exported["vehicle"] + "`"),
        {
            "vehicle": "{vehicle}",
            "exact probability": "{exact:.2g}",
            "mean / exact": "{mean:.2g}",
            "relative error": "{error:.0%}",
            "80 % intervals that cover": "{coverage80:.0%}",
            "95 % intervals that cover": "{coverage95:.0%}",
        },
    )


def vehicles_table(vehicles: pd.DataFrame) -> str:
    """Return, for each law and vehicle, the exact crash probability and how well the sampler finds it."""
    table = counts(vehicles, "failed")
    run, found = table["seeds"] > 0, table["error"].notna()
    return formatted(
        table.assign(
            law=spaced(table["law"]),
            ratio=1 + table["bias"].where(found),
            coverage80=table["coverage80"].where(found),
            calls_mean=table["calls_mean"].where(run),
            seeds=table["seeds"].where(run),
            claimed=(table["claimed"] * table["failed"]).where(table["failed"] > 0),
        ),
        {
            "law": "{law}",
            "vehicle": "{vehicle}",
            "exact": "{exact:.2g}",
            "simulations": "{calls_mean:,.0f}",
            "mean / exact": "{ratio:.2f}",
            "true error": "{error:.2f}",
            "80 % intervals cover": "{coverage80:.0%}",
            "failed": "{failed:.0f} of {seeds:.0f}",
            "of these, said to have converged": "{claimed:.0f}",
        },
    )


def worlds_table(worlds: pd.DataFrame) -> str:
    """Return how often the intervals cover in each kind of world, and how wide they are."""
    paper = worlds[worlds["procedure"] == "paper"].set_index("kind")["coverage80"]
    ours = worlds[worlds["procedure"] == "this project"]
    return formatted(
        ours.assign(paper=ours["kind"].map(paper)),
        {
            "kind": "{kind}",
            "worlds": "{worlds:.0f}",
            "50 % covers": "{coverage50:.0%}",
            "80 % covers": "{coverage80:.0%}",
            "95 % covers": "{coverage95:.0%}",
            "80 %: upper / lower": "{width80:.1f}",
            "median / truth": "{median_ratio:.2f}",
            "paper's 80 % covers": "{paper:.0%}",
        },
    )


def beyond_table(beyond: pd.DataFrame) -> str:
    """Return how often the intervals cover in worlds beyond the family, and how wide they are."""
    shares = ("coverage50", "coverage80", "coverage95")
    by_map = beyond[beyond["procedure"] == "map"]
    return formatted(
        counts(by_map.assign(percent=100 * by_map["coverage80"]), *shares, of="worlds"),
        {
            "kind": "{kind}",
            "worlds": "{worlds:.0f}",
            "50 % covers": "{coverage50:.0f}",
            "80 % covers": "{coverage80:.0f} ({percent:.0f} %)",
            "95 % covers": "{coverage95:.0f}",
            "80 %: upper / lower": "{width80:.1f}",
            "median / truth": "{median_ratio:.2f}",
            "its 10 and 90 %": "{ratio_10:.2f}, {ratio_90:.2f}",
        },
    )


def coverage_in_words(worlds: pd.DataFrame) -> str:
    """Return in which kinds of worlds the 80 % intervals cover the truth, and in which they rarely do."""
    worlds = worlds[worlds["procedure"] == "map"].sort_values("coverage80", kind="stable")
    is_family = worlds["kind"].isin(FAMILY)
    like, others = (f"{covered(own)} of {len(own)} kinds" for own in (worlds[is_family], worlds[~is_family]))
    error = 100 * math.sqrt(0.8 * 0.2 / worlds["worlds"].min())
    first, second = (
        f"*{row.kind}* ({covered(worlds[worlds['kind'] == row.kind])}; the answer is "
        f"{row.median_ratio:.1f} times the truth)"
        for row in worlds.head(2).itertuples()
    )
    return (
        f"{like} that resemble the models; {others} that break an assumption. The worst kinds are "
        f"{first} and {second}. The standard error of the share of a kind is up to {error:.0f} points."
    )


def covered(worlds: pd.DataFrame) -> str:
    """Return how many of the worlds of some kinds the 80 % intervals cover, as a number and a percentage."""
    hits, size = round((worlds["coverage80"] * worlds["worlds"]).sum()), worlds["worlds"].sum()
    return f"{hits} of {size:.0f} worlds ({100 * hits / size:.0f} %)"


def deciding_in_words(deciding: pd.DataFrame) -> str:
    """Return how often the records that the table ``deciding`` asks for decide a criterion, on worlds."""
    tried = deciding[deciding["verdict_before"] == "not decided"]
    decided = tried[tried["verdict_after"] != "not decided"]
    right = (decided["verdict_after"] == "met") == decided["should_be_met"]
    promised = tried[np.isfinite(tried["needed"])]
    kept = (promised["verdict_after"] != "not decided").sum()
    fewer = (promised["simulated"] < promised["needed"]).sum()
    sizes = f"{promised['needed'].min():,.0f} to {promised['needed'].max():,.0f}"
    others = len(tried) - len(promised)
    text = (
        f"In {len(tried)} worlds, the first records left the criterion undecided. The table named a number "
        f"of records in {len(promised)} of them ({sizes}; more than were simulated in {fewer} worlds). With "
        f"the simulated records, {kept} of these {len(promised)} criteria were decided. In the other "
        f"{others} worlds, where by the table no number of records decides, {len(decided) - kept} were "
        f"decided nevertheless. {right.sum()} of the {len(decided)} verdicts are right."
    )
    return text + "\n"


def causes_table(causes: pd.DataFrame) -> str:
    """Return what a threshold does by chance, and how much the choice of a law adds to the width."""
    return formatted(
        causes,
        {
            "kind": "{kind}",
            "worlds": "{worlds:.0f}",
            "10 %": "{ratio_10:.2f}",
            "median": "{ratio_50:.2f}",
            "90 %": "{ratio_90:.2f}",
            "80 % covers": "{coverage80:.0%}",
            "upper / lower": "{width80:.1f}",
            "80 % of the true law alone covers": "{true_law_coverage80:.0%}",
            "its upper / lower": "{true_law_width80:.1f}",
        },
    )


def recordings_table(recordings: pd.DataFrame) -> str:
    """Return the time and memory that recordings of each size need, and which of their cut-ins are found."""
    return formatted(
        recordings.assign(per_million=recordings["cpu_s"] / recordings["target_rows"] * 1e6),
        {
            "rows of targets": "{target_rows:,}",
            "CSV": "{gb:.2f} GB",
            "processor time": "{cpu_s:.0f} s",
            "a million rows": "{per_million:.1f} s",
            "peak memory": "{peak_gb:.2f} GB",
            "temporary files": "{temporary_gb:.2f} GB",
            "planted": "{planted:,}",
            "found": "{found:,}",
            "invented": "{invented:,}",
        },
    )


def certificates_table(certificates: pd.DataFrame) -> str:
    """Return the cost of each certificate, and how often it misses a hidden part."""
    shares = counts(certificates, "missed", "certified")
    wide = shares.pivot_table(index=["share", "curvature"], columns="problem", sort=False)
    wide.columns = [f"{problem}_{column}" for column, problem in wide.columns]
    return formatted(
        wide.reset_index(),
        {
            "share, curvature": "{share:g}, {curvature:g}",
            "main problem": "{segment_5_15_calls_mean:,.0f} (95 %: {segment_5_15_calls_p95:,.0f})",
            "range ≤ 1 m": "{range_1_calls_mean:,.0f} (95 %: {range_1_calls_p95:,.0f})",
            "of these, wide draws": "{segment_5_15_wide_draws:,.0f}, {range_1_wide_draws:,.0f}",
            "hidden part missed": "{hidden_missed:.0f} of {hidden_certified:.0f}",
        },
    )


def successors_table(successors: pd.DataFrame) -> str:
    """Return the simulations that runs of a similar vehicle save; the first variant is the vehicle itself."""
    table = counts(successors, "ranked", "holds", "off")
    return formatted(
        table.assign(ranked=table["ranked"].where(table["ratio"] != 1)),
        {
            "variant": "{variant}",
            "crash probability": "{probability:.1e}",
            "ratio to the predecessor": "{ratio:.2f}",
            "ranked right at 60": "{ranked:.0f} of {seeds}",
            "error at 60": "{early_error:.2f}",
            "simulations to the end": "{simulations:.0f}",
            "error": "{error:.2f}",
            "80 % intervals cover": "{holds:.0f} of {seeds}",
            "off by a factor of 2": "{off:.0f}",
            "simulations alone": "{simulations_alone:.0f}",
        },
    )


def chance_table(chance: pd.DataFrame) -> str:
    """Return what the sampler finds for systems that do not repeat themselves."""
    some = chance["converged"] > 0
    return formatted(
        chance.assign(
            problem=spaced(chance["problem"]),
            covered=chance["covered"].where(some),
            off=chance["off"].where(some),
        ),
        {
            "system": "{problem}",
            "probability": "{exact:.1e}",
            "seeds": "{seeds}",
            "simulations": "{simulations:.0f}",
            "converged": "{converged}",
            "of these: mean over truth": "{ratio:.2g}",
            "80 % intervals cover": "{covered:.0f} of {converged}",
            "off by a factor of 2": "{off:.0f}",
            "intervals of all seeds contain the truth": "{covered_all:.0%}",
        },
    )


def answers_table(answers: pd.DataFrame) -> str:
    """Return, for each vehicle, how far the whole answer of few runs is from that of the crash map."""
    table = counts(answers, "off_by_2", "silently", "no_answer")
    errors = ["low80", "high80", "low95", "high95", "median_bias", "ratio"]
    table[errors] = table[errors].where(table["no_answer"] < table["seeds"])
    return formatted(
        table.assign(bias=np.expm1(table["median_bias"])),
        {
            "vehicle": "{vehicle}",
            "seeds": "{seeds:,.0f}",
            "runs": "{runs_mean:,.0f}",
            "95 % at most": "{runs_p95:,.0f}",
            "80 % interval, ends": "{low80:.2f} and {high80:.2f}",
            "95 % interval, ends": "{low95:.2f} and {high95:.2f}",
            "median, bias": "{bias:+.1%} ± {median_bias_se:.1%}",
            "ratio to `cc_human`": "{ratio:.2f}",
            "off by a factor of 2": "{off_by_2:.0f}",
            "of these, claimed": "{silently:.0f}",
            "no answer": "{no_answer:.0f}",
        },
    )


def scenario_answers(answer: pd.DataFrame) -> str:
    """Return the probability of each event of a scenario with its intervals."""
    return formatted(
        answer,
        {
            "event": "{event}",
            "encounters": "{encounters}",
            "median": "{median:.2g}",
            "50 % interval": "{low50:.2g} to {high50:.2g}",
            "80 % interval": "{low80:.2g} to {high80:.2g}",
            "95 % interval": "{low95:.2g} to {high95:.2g}",
        },
    )


def scenarios_table(scenarios: pd.DataFrame) -> str:
    """Return how often the sampler is right in the scenarios with joint laws, and the runs that it needs."""
    return formatted(
        scenarios.assign(scenario=spaced(scenarios["scenario"])),
        {
            "scenario": "{scenario}",
            "event": "{event}",
            "probability": "{probability:.3g}",
            "runs at most": "{at_most:,}",
            "seeds": "{seeds}",
            "runs, mean": "{simulations:.0f}",
            "80 % intervals that cover": "{covered:.0%}",
            "with an interval below 1": "{with_a_number:.0%}",
            "converged": "{converged:.0%}",
            "of these, off by a factor of 2": "{silently_off_by_2}",
        },
    )


def of_study(name: str) -> pd.DataFrame:
    """Return a published table of the default study."""
    return pd.read_csv(ROOT / "figures" / "spmd" / "tables" / f"{name}.csv")


def rests(extrapolation: pd.DataFrame) -> str:
    """Return a paragraph that says what the answer rests on, and what the replays could have shown."""
    return rests_in_words(extrapolation, of_study("data_quality")) + "\n"


def score_in_words(claims: pd.DataFrame) -> str:
    """Return how many numbers and statements of the paper agree with ours, of those that can be compared."""
    verdicts = (
        claims["verdict"].value_counts().reindex(["agrees", "differs", "undecided", UNTESTED]).fillna(0)
    )
    agree, differ, open_, untested = verdicts.astype(int)
    others = [f"{open_} undecided"] * bool(open_) + [f"{untested} not testable"] * bool(untested)
    return ", ".join([f"{agree} agree with ours", f"{differ} differ", *others])


def piecewise_in_words() -> str:
    """Return how many times as many simulations a single distribution needs, without and with the search."""
    simulations = of_study("needed").set_index(["scope", "method"])["simulations"]
    single, piecewise = simulations["all", "single"], simulations["all", "piecewise"]
    repeated = of_study("repeated_searches")
    shortest = repeated[repeated["crash_updates"] == repeated["crash_updates"].min()]
    slow = shortest.groupby("method")[["simulations", "needed"]].mean().sum(axis=1)
    costs = of_study("table2_computation")
    search = costs[(costs["stage"] == "Cross-Entropy") & (costs["quantity"] == "simulations")]
    search = search.set_index("method")["ours"]
    everywhere = (search["single"] + single) / (search["piecewise"] + piecewise)
    rarest = of_study("exact").query("segment != 'all'")["probability"].min()
    return (
        f"{single / piecewise:.2f} (paper: {PAPER_RATIOS['single']:.2f}); with the search "
        f"{slow['single'] / slow['piecewise']:.2f} in slow traffic, where nearly all crashes happen, and "
        f"{everywhere:.2f} if crashes are also searched in fast traffic, where their probability is "
        f"{rarest:.0e}"
    )


def shares_in_words() -> str:
    """Return the shares of the sources of uncertainty in the variance of the paper's estimate."""
    shares = 100 * of_study("uncertainty").set_index("source")["variance_share"]
    return (
        f"sampling {shares['sampling']:.1f} %, finite data {shares['data']:.0f} %, the choice among two or "
        f"three pieces and three knots {shares['choice of model']:.0f} % (the cap of the closing speed is "
        "not among these choices)"
    )


def sampler_in_words(samplers: pd.DataFrame) -> str:
    """Return how many simulations the sampler takes on the main problem, like for like."""
    rows = samplers[samplers["problem"] == "segment_5_15"].set_index("method")
    ours, equal = rows.loc[OURS], rows["effective_calls"]
    public = rows.drop(index=[OURS, *METHODS], errors="ignore").query("failed <= @RELIABLE")
    return (
        f"at equal error {equal[OURS]:,.0f} with our sampler, {equal['piecewise']:,.0f} with the paper's "
        f"piecewise method (300 draws an iteration), {public['effective_calls'].min():,.0f} with the best "
        f"public tool; our sampler takes {ours['calls_mean']:,.0f} on average, and may assume that a crash "
        "also happens at every larger closing speed"
    )


def motion_in_words(motion: pd.DataFrame) -> str:
    """Return by how much lead vehicles that change their speed change the crash probability."""
    closing = motion[motion["gap"] == "closing"].set_index("vehicle")["factor"]
    europe = pd.read_csv(RESULTS / "europe.csv")
    europe = europe[europe["what"] == "factor of the European lead motion"].set_index("group")["value"]
    return (
        f"× {closing['under test']:.1f} with American and × {europe['acc_aeb']:.2f} with European motion; "
        f"for the careful human × {closing['cc_human']:.1f} and × {europe['cc_human']:.2f}"
    )


def counted_in_words(counted: pd.DataFrame) -> str:
    """Return which predicted crash rates the count of two million miles contradicts."""
    predicted = counted[(counted["kind"] == "predicted") & counted["what"].str.startswith("crash: closing")]
    known = predicted["verdict"].eq("compatible with the count")
    fine, bad = (predicted.loc[each, "who"].unique() for each in (known, ~known))
    return f"compatible: {', '.join(fine)}; contradicted: {', '.join(bad) or 'none'}"


def findings(claims: pd.DataFrame) -> str:
    """Return a table of what else was found: a question, the numbers, and where the details are."""
    motorway = pd.read_csv(RESULTS / "motorway.csv").query("host == 'acc_aeb'")
    crashes = motorway.groupby("gap")["counted"].sum()
    notebooks = "figures/spmd/notebooks"
    rows = [
        (
            "the paper's numbers and statements that can be compared",
            score_in_words(claims),
            "[claims](figures/spmd/tables/claims.md)",
        ),
        (
            "simulations: single distribution / piecewise mixture, by exact variances",
            piecewise_in_words(),
            f"[chapter 8]({notebooks}/08_results.ipynb)",
        ),
        (
            "variance of the paper's estimate",
            shares_in_words(),
            f"[chapter 9]({notebooks}/09_ground_truth.ipynb)",
        ),
        (
            "synthetic records with a known truth: 80 % intervals that cover it",
            coverage_in_words(pd.read_csv(RESULTS / "worlds_beyond.csv")),
            "[worlds](benchmarks/worlds/README.md)",
        ),
        (
            "simulations for a crash at 5 to 15 m/s, with the search",
            sampler_in_words(pd.read_csv(RESULTS / "samplers.csv")),
            "[benchmarks](benchmarks/README.md), [guide](fewruns/README.md)",
        ),
        (
            "crash probability if the lead vehicle changes its speed",
            motion_in_words(of_study("lead_motion")),
            f"[chapter 12]({notebooks}/12_the_world.ipynb)",
        ),
        (
            "crashes after a gap that opens, on a simulated motorway",
            f"{crashes['opening']:.0f} of the {crashes.sum():.0f} crashes of the car under test",
            "[motorway](benchmarks/motorway/README.md)",
        ),
        (
            "crash rates predicted for closing cut-ins, and the count of the 100-Car study",
            counted_in_words(of_study("counted_crashes")),
            f"[chapter 12]({notebooks}/12_the_world.ipynb)",
        ),
    ]
    return markdown(("question", "finding", "details"), rows)


def few_in_words() -> str:
    """Return how many simulations an answer takes, and how many crude Monte Carlo would take."""
    answers = pd.read_csv(RESULTS / "answers.csv").set_index("vehicle")
    median = of_study("answer").set_index("event").loc["crash", "median"]
    crude = float(f"{crude_simulations(median, 0.2, 0.2) / 1e6:.1g}")
    return (
        f"Our answer takes about {round(answers.loc['acc_aeb', 'runs_mean'], -1):.0f} simulations of a "
        f"vehicle. Crude Monte Carlo takes {crude:.0f} million for one law (an 80 % interval of ± 20 %)."
    )


def answer_in_words(answer: pd.DataFrame) -> str:
    """Return the number of cut-ins for one crash, with its interval, in a sentence."""
    crash = answer.set_index("event").loc["crash"]
    middle, low, high, paper = map(_one_in, (*crash[["median", "high80", "low80"]], PAPER_PROBABILITY))
    return (
        f"**The authors' car crashes in about one of {middle} cut-ins** (80 % interval: one of {low} to one "
        f"of {high}). The paper's estimate is one of {paper}. {few_in_words()}\n"
    )


def answer_table(answer: pd.DataFrame) -> str:
    """Return the crash probability of the default study with its intervals, next to the paper's numbers."""
    crash = answer.set_index("event").loc["crash"]
    rows = [("crash of a cut-in, median", f"{PAPER_PROBABILITY:.1e}", f"**{crash['median']:.1e}**")]
    for level in (50, 80, 95):
        ends = f"{crash[f'low{level}']:.1e} to {crash[f'high{level}']:.1e}"
        rows.append((f"{level} % interval", PAPER_INTERVAL if level == 80 else NOTHING, ends))
    rows.append(("mean", NOTHING, f"{crash['probability']:.1e}"))
    return markdown(("", "paper", "this project"), rows)


def europe_table(europe: pd.DataFrame) -> str:
    """Return a Markdown table of what the European cut-ins say, with the limits where there are any."""
    cells = {
        "quantity": "{what}",
        "cut-ins, or vehicle": "{group}",
        "number": "{count:,.0f}",
        "value": "{value:.2g}",
        "from": "{low:.2g}",
        "to": "{high:.2g}",
    }
    return formatted(europe, cells)


def _one_in(probability: float) -> str:
    """Return the number of cut-ins for one crash, with two digits."""
    return f"{float(f'{1 / probability:.2g}'):,.0f}"


def by_kind(drawn: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each kind of random problems: means over all seeds, and the largest 95 % quantile."""
    outcome = drawn["problem"].str.endswith("flags").map({True: "flags", False: "scores"})
    inputs = drawn["dimension"].gt(3).map({True: "4 to 8 inputs", False: "2 or 3 inputs"})
    number = drawn["problem"].str.extract(r"(\d+)", expand=False).astype(int)
    # See DRAWN, SHOWN, LATER, LAST and UNSEEN in fewruns/benchmarks/hidden_problems.py.
    runs = ["", ", that showed a fault", ", run later", ", run last", ", run after all but the last change"]
    when = pd.cut(number, [99, 139, 199, 259, 419, 619], labels=runs).astype(str)
    rows = []
    for kind, problems in drawn.groupby(outcome + ", " + inputs + when):
        seeds = problems["seeds"]
        row = {
            "problem": f"{len(problems)} random problems, {kind}",
            "calls_p95": problems["calls_p95"].max(),
        }
        row |= {name: problems[name].sum() for name in ("seeds", "failed", "claimed")}
        found = problems["mean"].notna()  # a problem without any number has neither mean nor error
        row |= {name: problems[name] @ seeds / seeds.sum() for name in ("calls_mean", "coverage80")}
        row["mean"] = np.average(problems["mean"][found], weights=seeds[found])
        row["error"] = math.sqrt(np.average(problems["error"][found] ** 2, weights=seeds[found]))
        rows.append(row)
    return pd.DataFrame(rows)


def hidden_table(hidden: pd.DataFrame) -> str:
    """Return what this sampler finds of events of which a search may miss a part; random ones are grouped."""
    table = counts(hidden.assign(mean=1 + hidden["bias"]), "failed")
    table["claimed"] = table["claimed"].fillna(0) * table["failed"]
    is_drawn = table["problem"].str.startswith("drawn_")
    whole = pd.concat([table[~is_drawn], by_kind(table[is_drawn])], ignore_index=True)
    return formatted(
        whole.assign(problem=spaced(whole["problem"])),
        {
            "problem": "{problem}",
            "inputs": "{dimension:.0f}",
            "probability": "{reference:.3g}",
            "seeds": "{seeds:.0f}",
            "simulations": "{calls_mean:,.0f}",
            "95 % at most": "{calls_p95:,.0f}",
            "mean / exact": "{mean:.2f}",
            "error": "{error:.2f}",
            "80 % covers": "{coverage80:.0%}",
            "off by a factor of 2": "{failed:.0f}",
            "of these, said to have converged": "{claimed:.0f}",
        },
    )


def general_table(general: pd.DataFrame) -> str:
    """Return what the sampler claims, and when its interval is narrow and it ends, on further problems."""
    return formatted(
        counts(general.assign(problem=spaced(general["problem"])), "covered"),
        {
            "problem": "{problem}",
            "seeds": "{seeds:.0f}",
            "said to have converged": "{converged:.0f}",
            "of these, off by a factor of 2": "{claimed_off:.0f}",
            "intervals that cover": "{covered:.0f}",
            "median / exact": "{median:.2f}",
            "narrow after": "{narrow:,.0f}",
            "ended after": "{runs:,.0f}",
            "at most": "{most_runs:,.0f}",
        },
    )


def parts_in_words(general: pd.DataFrame) -> str:
    """Return how many estimates claim a wrong answer if a part is next to, behind or between known ones."""
    parts = general[general["kind"] == "parts"]
    seeds, claimed = parts["seeds"].sum(), parts["claimed_off"].sum()
    limit = betaincinv(claimed + 1, seeds - claimed, 0.95)
    return (
        f"Of {seeds} estimates of {len(parts)} problems with a part next to, behind or in front of the known "
        f"one, {parts['converged'].sum()} claim to have converged, {claimed or 'none'} of them off by a "
        f"factor of 2 (with 95 % confidence, fewer than {100 * limit:.2g} % of the estimates are).\n"
    )


def result(text: Path, name: str, make: Callable[[pd.DataFrame], str]) -> Block:
    """Return the table that a text has of one file of the results."""
    return Block(text, RESULTS / f"{name}.csv", make)


def published(text: Path, study: str, table: str, make: Callable[[pd.DataFrame], str]) -> Block:
    """Return the table that a text has of one published table of a study."""
    return Block(text, ROOT / "figures" / study / "tables" / f"{table}.csv", make)


BLOCKS = {
    "answer_in_words": published(README, "spmd", "answer", answer_in_words),
    "answer": published(README, "spmd", "answer", answer_table),
    "rests": published(README, "spmd", "extrapolation", rests),
    "findings": published(README, "spmd", "claims", findings),
    "left_turn": published(JOINT_LAWS, "left_turn", "answer", scenario_answers),
    "pedestrian": published(JOINT_LAWS, "pedestrian", "answer", scenario_answers),
    "scenarios": result(JOINT_LAWS, "scenarios", scenarios_table),
    "answers": result(ANSWERS, "answers", answers_table),
    "samplers": result(SAMPLERS, "samplers", samplers_table),
    "public": result(DETAILS, "public", public_table),
    "hidden": result(DETAILS, "hidden", hidden_table),
    "vehicles": result(DETAILS, "vehicles", vehicles_table),
    "exported": result(EXPORT, "exported", exported_table),
    "worlds": result(WORLDS, "worlds", worlds_table),
    "beyond": result(WORLDS, "worlds_beyond", beyond_table),
    "causes": result(WORLDS, "worlds_causes", causes_table),
    "deciding": result(SAFETY, "worlds_deciding", deciding_in_words),
    "size": result(FORMATS, "recordings", recordings_table),
    "europe": result(EUROPE, "europe", europe_table),
    "certificates": result(DETAILS, "certificates", certificates_table),
    "chance": result(DETAILS, "chance", chance_table),
    "general": result(DETAILS, "general", general_table),
    "parts_in_words": result(FEWRUNS, "general", parts_in_words),
    "successors": result(DETAILS, "successors", successors_table),
} | {name: result(MOTORWAY, name, make) for name, make in MOTORWAY_TABLES.items()}

if __name__ == "__main__":
    update(BLOCKS)

"""Surrogate-guided sampling: the probability of a rare event from a few hundred simulations.

The event is a set in the space of normal scores, z ~ N(0, I). In every batch, surrogates predict the
probability p(z) of the event from all runs so far (`belief`). A pool of points z_j, which need no simulation,
is drawn from a density h, with weights w_j = phi(z_j) / h(z_j) (`pools`). From the pool, n runs are chosen,
most of them where w_j times the expected error of the surrogate is large. With p as control variate, they
give an unbiased estimate (`two_phase`).

The result is a weighted mean over the last batches with consistent predictions (`combining`). The probability
of parts that were missed is bounded (`certificate`). Before these batches, a search finds the event
(`second_phase`). method.md derives the method, and README.md explains its use.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from fewruns import results
from fewruns.arrays import Array, Flags
from fewruns.belief import Belief
from fewruns.certificate import BY_DEFAULT, Certificate
from fewruns.combining import estimate_batch
from fewruns.constants import (
    BEYOND,
    CERTIFIED,
    CORE,
    COVERED,
    DEFENCE,
    DEFENCE_ALONE,
    DRIFT_LAG,
    DRIFT_PAIRS,
    ENOUGH_BATCHES,
    ENOUGH_UNEXPECTED,
    ENOUGH_UNLEARNT,
    FEW,
    FIRST_REPEATS,
    FREQUENT_REACH,
    FREQUENT_START,
    LARGEST_SCORE,
    LONGEST,
    LONGEST_SHARE,
    MOST_INPUTS_OF_FLAGS,
    MOST_INPUTS_OF_SCORES,
    PATIENCE,
    POOL,
    REACH,
    REACHED,
    RELEARN,
    SEARCHED,
    SHORT_START,
    SHORT_STEP,
    START,
    STEP,
    UNSEEN_ALPHA,
)
from fewruns.cover import Cover
from fewruns.directions import learn_directions
from fewruns.errors import InputError
from fewruns.estimates import Estimate, Stopping
from fewruns.graded import say_more
from fewruns.pools import Defence, WholeSpace, space_along
from fewruns.problems import Predecessor
from fewruns.progress import LAW, PLAIN, SEARCH, WIDE, Batch, PlainBatch, Progress
from fewruns.repeats import RepeatBatch, choose_repeats, end_differently
from fewruns.second_phase import SecondPhase, draw_approach
from fewruns.statements import events_below_others, point_the_wrong_way
from fewruns.two_phase import TwoPhaseBatch
from fewruns.wide_laws import draw_wide, rarity

# Linear algebra uses one thread. The matrices are small, and the results must not depend on the number of
# cores.
BLAS = ThreadpoolController()


class Sampler:
    """The sampler as an object that requests batches of runs (`ask`) and receives their outcomes (`tell`).

    Use it for systems that are run elsewhere; otherwise `run_batches` and `estimate` are simpler.

    Parameters
    ----------
    dimension
        Number d of inputs. The event is defined in their normal scores, which are independent and standard
        normal.
    generator
        Source of all randomness.
    batch_size
        Number n of runs in a batch, from 1 to 500. The attribute may be changed between two batches.
    fingerprint
        Text that identifies the problem, so that a saved state is not resumed for another one.
    certificate
        Bound on unobserved parts of the event that is required for convergence. None, the default, stands for
        `Cover.by_default`, and for an ``upper_set`` it is replaced by `certificate.BY_DEFAULT`. With more
        than six inputs, or with flags alone and more than two, an estimate only converges if a certificate or
        ``upper_set`` is stated.
    upper_set
        Whether it is known that the event is an upper set in one of the inputs, so that it also happens if
        this input is larger, and that it has no separate parts. Fewer runs are then needed.
    predecessor
        Runs of a similar system, near whose events the sampler begins.
    deterministic
        Whether the system always has the same outcome for the same inputs. By default this is not known, and
        `ask` requests a few runs again.
    enough_repeats, enough_draws
        If ``deterministic`` is None: numbers of repetitions of runs, and of draws of the inputs by their own
        law, that are required for convergence. Repetitions show random outcomes, and draws show events far
        from all other runs, such as thin stripes.
    frequent
        Whether the event may be frequent, and may have several separate parts. The sampler then begins with
        40 runs up to a tail probability of 5e-5, instead of 20 runs at all tail probabilities.

    Attributes
    ----------
    progress
        The runs so far: normal scores ``z``, shape (runs, d), ``happened`` and ``score``, shape (runs,).
    emphasis
        Factor of the inclusion probabilities as a function of z; see `SeveralLaws.emphasis`.

    Examples
    --------
    The event is that the sum of two standard normal inputs exceeds 6.

    >>> import numpy as np
    >>> from fewruns import Sampler, Stopping
    >>> goal = Stopping()
    >>> sampler = Sampler(2, np.random.default_rng(1))
    >>> while not sampler.has_converged(goal):
    ...     z = sampler.ask(certify=sampler.is_narrow(goal))
    ...     margin = 6 - z.sum(axis=1)
    ...     sampler.tell(margin < 0, margin)
    >>> found = sampler.estimate(goal)
    >>> found.simulations < 200, found.low < 1.1e-5 < found.high
    (True, True)
    """

    def __init__(
        self,
        dimension: int,
        generator: np.random.Generator,
        batch_size: int = 5,
        *,
        fingerprint: str = "",
        certificate: Certificate | Cover | None = None,
        upper_set: bool = False,
        predecessor: Predecessor | None = None,
        deterministic: bool | None = None,
        enough_repeats: int = FIRST_REPEATS,
        enough_draws: int = 0,
        frequent: bool = False,
    ) -> None:
        _check_settings(dimension, generator, batch_size, certificate, deterministic)
        if predecessor is not None:
            predecessor.check(dimension)
        self.dimension, self.batch_size, self.fingerprint = dimension, batch_size, fingerprint
        self.certificate = BY_DEFAULT if certificate is None and upper_set else certificate
        self.frequent, self.predecessor = frequent, predecessor
        self.deterministic = deterministic
        self.enough_repeats, self.enough_draws = enough_repeats, enough_draws
        self.progress = Progress.start(dimension)
        self.progress.chance = deterministic is False
        self.generator = generator
        self.emphasis: Callable[[Array], Array] | None = None
        self.belief = Belief(WholeSpace(dimension), predecessor)
        # For which runs and certificate it was last computed whether the certificate is met, and the answer.
        self._certified: tuple[object, bool] = None, False
        # Number of the first runs, their largest rarity, and the step of rarity with one run of the search.
        start, step = (SHORT_START, SHORT_STEP) if self._relies_on_cover else (START, STEP)
        self._first, self._step = (FREQUENT_START, FREQUENT_REACH) if frequent else (start, REACH), step

    # ---- simulations

    def ask(self, *, certify: bool = False) -> Array:
        """Return the normal scores to simulate next, shape (n, d), until `tell` has received their outcomes.

        The array is a copy, which may be changed. The batches of the search, and those that only exclude
        unobserved parts of the event, may be smaller than ``batch_size``.

        With ``certify``, most runs exclude unobserved parts of the event, as needed when the interval is
        narrow. For a deterministic system with at most two inputs, such runs begin earlier.
        """
        return self._pending_batch(certify=certify).z.copy()

    def tell(self, happened: ArrayLike, score: ArrayLike | None = None) -> None:
        """Receive the outcomes of the batch that `ask` returned last: flags and scores, shape (n,).

        A score is smaller the closer a run came to the event. InputError is raised if no batch has been
        requested, if the flags are not boolean, or if a shape or score is wrong.
        """
        progress = self.progress
        if (batch := progress.pending) is None:
            expected, change = "those of a requested batch", "Call `ask` once before each `tell`."
            raise InputError("the outcomes", seen="no requested batch", expected=expected, change=change)
        happened, score = _outcomes(happened, score, len(batch.z))
        progress.pending = None
        if isinstance(batch, RepeatBatch):
            self._take_repeats(batch, happened, score)
        elif isinstance(batch, PlainBatch) and batch.phase == LAW:
            progress.law_draws = progress.law_draws.extended(batch.z, happened)
            progress.chance |= results.is_contradicted(progress)  # the system may then lapse
        else:
            progress.z = np.vstack([progress.z, batch.z])
            progress.happened = np.append(progress.happened, happened)
            progress.score = np.append(progress.score, score)
            progress.sizes = np.append(progress.sizes, len(batch.z))
            self._take_runs(batch, happened)

    def _take_runs(self, batch: PlainBatch | TwoPhaseBatch, happened: Flags) -> None:
        """Update what is derived from the runs of a batch."""
        progress = self.progress
        if isinstance(batch, TwoPhaseBatch):
            progress.wide_draws = np.vstack([progress.wide_draws, batch.wide_draws])
            progress.estimates.append(estimate_batch(batch, happened))
            progress.batches.append(batch)
            progress.foreseen = np.vstack([progress.foreseen, batch.foreseen])
            if progress.centres is not None:
                # Kernels are needed around the events of a part that the last pool did not contain.
                progress.centres = np.vstack([progress.centres, batch.z[happened & (batch.weight == 0)]])
            return
        events = self.belief.space.coordinates(batch.z[happened])
        rarest = min(rarity(events).min(initial=REACH), progress.rarest)
        if batch.phase == PLAIN:
            progress.plain = progress.plain.extended(batch.z, happened)
        elif batch.phase == WIDE:
            progress.wide_draws = np.vstack([progress.wide_draws, [len(batch.z), 0.0, self._first[1]]])
        else:
            progress.searched += len(batch.z) / self._search_reach
        progress.rarest = rarest

    def _take_repeats(self, batch: RepeatBatch, happened: Flags, score: Array) -> None:
        """Compare repetitions with their runs; a difference shows that outcomes may be random."""
        progress, first = self.progress, batch.repeated
        differed = end_differently(progress.happened[first], progress.score[first], happened, score)
        was_noisy = progress.repeats.vary_often
        progress.repeats = progress.repeats.extended(batch, happened, differed, score)
        progress.chance |= bool(differed.any())
        if (is_noisy := progress.repeats.vary_often) != was_noisy:
            # Earlier predictions and estimates assumed another kind of outcome, so they are not used.
            progress.chance_since = len(progress.estimates)
            progress.foreseen, progress.learnt_at = np.empty((0, 2)), 0
            self.belief = Belief(self.belief.space, self.predecessor, noisy=is_noisy)

    @property
    def simulations(self) -> int:
        """Number of simulations whose outcomes have been received, including repeats and draws of the law."""
        return len(self.progress.z) + len(self.progress.repeats) + len(self.progress.law_draws)

    @property
    def repeats_next(self) -> bool:
        """Whether the requested batch consists of repetitions of earlier runs."""
        return isinstance(self.progress.pending, RepeatBatch)

    @property
    def draws_next(self) -> bool:
        """Whether the requested batch consists of draws of the law itself, which are no runs."""
        return getattr(self.progress.pending, "phase", None) == LAW

    # ---- convergence

    def has_converged(self, stopping: Stopping) -> bool:
        """Return whether the interval is narrow and no more runs are needed for other reasons."""
        return self.is_narrow(stopping) and self.is_settled()

    def is_narrow(self, stopping: Stopping) -> bool:
        """Return whether the interval is as narrow as the rule requires, with enough events."""
        return results.is_narrow(self.progress, stopping)

    def is_settled(self) -> bool:
        """Return whether no more runs are needed except to narrow the interval."""
        if self.is_counted:
            return True
        excluded = self._has_excluded_all_else() and self._can_exclude
        return excluded and not self.may_lapse and not self.progress.repeats.drift

    def has_ended(self, *, is_narrow: bool) -> bool:
        """Return whether the estimate has converged, or no further runs would help it to converge.

        They would not help if the interval has been narrow for so many runs that the scores, or the shape of
        the event, do not allow the default certificate to be met. Only the cover is then completed.
        """
        if self.may_lapse:
            return is_narrow and self.is_counted
        return self.progress.repeats.drift or (
            is_narrow and (self._gives_up or self._has_excluded_all_else())
        )

    @property
    def _gives_up(self) -> bool:
        """Whether other parts of the event are not excluded, although that has taken as long as it may."""
        if not self._is_late or not self.progress.estimates[-1].runs:
            return False
        return results.is_covered(self.progress, self.required) and not self._is_certified

    @property
    def _is_late(self) -> bool:
        """Whether the default certificate has taken as many runs as it may since the interval was narrow."""
        narrow_at = self.progress.narrow_at
        if self.certificate is not None or narrow_at is None:
            return False
        longest = max(LONGEST_SHARE * narrow_at, LONGEST, LONGEST * self.dimension / 3)
        return len(self.progress.z) >= narrow_at + longest

    @property
    def _is_certified(self) -> bool:
        """Whether the runs exclude all other parts of the event that the certificate speaks of."""
        known = self.simulations, len(self.progress.estimates), self.required
        if self._certified[0] != known:
            self._certified = known, results.is_certified(self.progress, self.required)
        return self._certified[1]

    @property
    def may_lapse(self) -> bool:
        """Whether the system may fail at random in a few of its runs, which the runs may have missed."""
        return results.may_lapse(self.progress)

    @property
    def is_counted(self) -> bool:
        """Whether the estimate is the share of events among the draws of the law (`results.is_counted`)."""
        return results.is_counted(self.progress)

    @property
    def unseen_lapses(self) -> float:
        """A bound on the probability that lapses add to an estimate; 0 without lapses, or if they count."""
        return results.unseen_lapses(self.progress)

    def repeats_wanted(self, *, certify: bool) -> int:
        """Return how many repetitions are still required; ``certify`` adds those for convergence."""
        repeats = self.progress.repeats
        if self.deterministic is True:
            return 0
        if repeats.vary_often:
            first = max(FIRST_REPEATS + DRIFT_PAIRS - len(repeats), 0)
            return first or repeats.pairs_wanted(self._late_repeats(certify=certify))
        if self.progress.chance and self.deterministic is None and len(repeats):
            return 0
        wanted = self.enough_repeats if certify and not self.progress.chance else FIRST_REPEATS
        return max(wanted - len(repeats), 0)

    def _late_repeats(self, *, certify: bool) -> int:
        """Return how often the runs that show a drift should have been repeated after the early repeats."""
        runs = self.progress.repeats.repeated[: FIRST_REPEATS + DRIFT_PAIRS]
        return int(certify) + (len(self.progress.z) > DRIFT_LAG * (runs.max() + 1))

    def _draws_wanted(self) -> int:
        """Return how many draws of the law are still wanted before an estimate can have converged."""
        if self.deterministic is not None or self.progress.chance:
            return 0
        return max(self.enough_draws - len(self.progress.law_draws), 0)

    @property
    def required(self) -> Certificate | Cover:
        """The required certificate; by default a cover, which is stricter for flags without scores."""
        return self.certificate or Cover.by_default(self.dimension, with_scores=self._has_scores)

    @property
    def _relies_on_cover(self) -> bool:
        """Whether a cover with few runs finds the parts of the event that a longer search would find.

        Systems whose outcomes may be random need more runs, which also show whether they drift.
        """
        by_cover = not isinstance(self.certificate, Certificate)
        return by_cover and self.dimension <= COVERED and self.deterministic is True

    @property
    def _has_scores(self) -> bool:
        return say_more(self.progress.happened, self.progress.score)

    @property
    def _can_exclude(self) -> bool:
        """Whether the certificate was stated, or the default one excludes parts of a moderate size."""
        most = MOST_INPUTS_OF_SCORES if self._has_scores else MOST_INPUTS_OF_FLAGS
        return self.certificate is not None or self.dimension <= most

    def _is_drawn(self, *, certify: bool) -> bool:
        """Return whether the next runs are draws of the law itself.

        They are the last check before convergence, and are also due if surrogates do not learn the event. Of
        a system that may lapse they are at least half of the runs, and all that are left then.
        """
        progress = self.progress
        batches = max(ENOUGH_UNLEARNT // self.batch_size, ENOUGH_BATCHES)
        enough = len(progress.foreseen) >= batches * self.batch_size
        unlearnt = enough and not results.has_learnt(progress, batches)
        if not self.may_lapse and not self._draws_wanted():
            return unlearnt
        is_last = certify and self._is_certified
        unlearnt |= sum(batch.surprising for batch in progress.estimates) >= ENOUGH_UNEXPECTED
        if not self.may_lapse:
            return is_last or unlearnt
        few = 2 * len(progress.law_draws) < self.simulations
        is_checked = self.deterministic is True or len(progress.repeats) > 0
        return is_checked and (is_last or unlearnt or few or self.is_counted)

    def _has_excluded_all_else(self) -> bool:
        """Return whether the certificate is met and all checks are made; only lapses may then remain."""
        if self.repeats_wanted(certify=True) or self._draws_wanted():
            return False
        if not self._is_certified:
            return False
        return not self._relies_on_cover or results.reaches_prediction(self.progress, REACHED)

    def estimate(self, stopping: Stopping) -> Estimate:
        """Return the estimate from the runs so far; ``tables["runs"]`` has a row for each run.

        The diagnostics ``unseen_mode`` and ``unseen_any`` bound the probability of unobserved parts
        (`Certificate`).
        """
        found = results.estimate(
            self.progress, self.batch_size, stopping, self.required, converged=self.has_converged(stopping)
        )
        words = {
            "reason": self._reason(stopping),
            "excluded": self._excluded(found.probability),
            "warning": self._warning(),
        }
        found = replace(found, **words)
        return results.with_lapses(found, self.progress, stopping)

    def _reason(self, stopping: Stopping) -> str:
        """Return in one sentence why the estimate has converged, or why it has not."""
        progress, missing = self.progress, self.repeats_wanted(certify=True) + self._draws_wanted()
        if progress.repeats.drift:
            return "the system drifts: repetitions of the same runs differ in one direction"
        if self.may_lapse and not self.is_counted:
            return "outcomes may be random in a few of the runs, which the runs cannot exclude"
        if not progress.happened.any() and not progress.law_draws.events:
            return "no run has met the event"
        if results.has_begun_again(progress) and not self.is_counted:
            return (
                "the estimate begins again without its earlier batches, because later runs did not agree "
                "with what was predicted from them"
            )
        if progress.chance_since and results.combined_estimate(progress, stopping)[0] is None:
            return (
                "the earlier batches no longer count, because repetitions show that most outcomes are random"
            )
        if not self.is_narrow(stopping):
            return "the interval is wider than required"
        if self.is_settled():
            return "the interval is narrow, and the certificate is met"
        if not self._is_certified:
            further = (
                f"after {len(progress.z) - progress.narrow_at} further runs" if self._gives_up else "yet"
            )
            return f"the interval is narrow, but other parts of the event are not excluded {further}"
        if missing:
            return f"the interval is narrow, but {missing} checks for random outcomes are missing"
        if not self._can_exclude:
            return "with so many inputs, only a stated certificate excludes other parts of the event"
        return (
            "the surrogate predicts more than the estimate, which may have missed a part that was found late"
        )

    def _excluded(self, probability: float) -> str:
        """Return what other parts of the event the runs exclude, and what outcomes by chance."""
        progress, required, parts = self.progress, self.required, "no other part of the event"
        if required == BY_DEFAULT:
            parts = "other parts of the event, because it was stated that there are none"
        elif self._is_certified:
            parts = f"parts of the event with more than {required.share:g} times its probability"
            if required.curvature:
                parts += f" and a radius of at least {1 / required.curvature:.2g} normal scores"
            by_scores = isinstance(required, Cover) and self._has_scores and self.dimension <= FEW
            parts += ", and smaller ones to which the scores lead" * by_scores
        if self.deterministic is not None or progress.chance or not len(progress.repeats):
            return parts
        rate = 1 - UNSEEN_ALPHA ** (1 / len(progress.repeats))
        added = min(rate, progress.law_draws.interval(2 * UNSEEN_ALPHA)[1])
        words = (
            f"{parts}; other outcomes in more than {100 * rate:.2g} % of repeated runs. Lapses at this rate"
        )
        words += f" in all runs could add {added:.2g} to the probability"
        return words + f", {added / probability:.2g} times the estimate" * (probability > 0)

    def _warning(self) -> str:
        """Return what the runs say against statements about the problem."""
        progress, words = self.progress, []
        if point_the_wrong_way(progress.happened, progress.score):
            words.append("scores of events are larger than those of other runs, but should be smaller")
        is_upper = self.required == BY_DEFAULT and not progress.chance  # as stated
        if is_upper and (events := events_below_others(progress.z, progress.happened)):
            of = np.count_nonzero(progress.happened)
            where = f"in each input, at least {events} of {of} events have a run without the event above them"
            words.append(f"upper_set was stated, but {where}")
        return "; ".join(words)

    # ---- design of a batch

    def _pending_batch(self, *, certify: bool = False) -> Batch:
        if self.progress.pending is None:
            if not certify:
                self.progress.narrow_at = None
            elif self.progress.narrow_at is None:
                self.progress.narrow_at = len(self.progress.z)
            with BLAS.limit(limits=1):
                beyond = results.where_to_search(self.progress, self.required)
                by_draws = certify and isinstance(self.required, Certificate)
                defence = Defence(DEFENCE_ALONE if by_draws else DEFENCE, beyond)
                checks = self._repeats(certify=certify) or self._draws(certify=certify)
                self.progress.pending = checks or self._design(defence, certify=certify)
        return self.progress.pending

    def _repeats(self, *, certify: bool) -> RepeatBatch | None:
        """Choose runs to repeat; return None if no repetition is required now."""
        progress = self.progress
        if not (count := min(self.repeats_wanted(certify=certify), self.batch_size)):
            return None
        if self._is_searching() or (certify and not self._is_certified):
            return None
        expected = np.zeros(len(progress.z), bool)
        expected[len(progress.z) - len(progress.foreseen) :] = progress.foreseen.max(axis=1, initial=0) > 0.5
        known = progress.z, progress.happened, progress.score, progress.repeats
        is_late = progress.repeats.vary_often and len(progress.repeats) >= FIRST_REPEATS + DRIFT_PAIRS
        rounds = self._late_repeats(certify=certify) if is_late else 0
        frequent = results.frequent_runs(progress, max(self.enough_repeats, 1))
        return choose_repeats(*known, count, expected, frequent, rounds=rounds)

    def _draws(self, *, certify: bool) -> PlainBatch | None:
        """Draw from the law itself, as the last check or because of lapses; None while this is not due."""
        if not self._is_drawn(certify=certify):
            return None
        count = min(self._draws_wanted() or self.batch_size, self.batch_size)
        return PlainBatch(self.generator.standard_normal((count, self.dimension)), LAW)

    def _design(self, defence: Defence, *, certify: bool) -> Batch:
        """Choose the next batch: wide draws at first, then the search, then the second phase."""
        progress, generator = self.progress, self.generator
        if self.predecessor is None:
            happened, score = progress.happened, progress.score
            start, reach = self._first
            first = start if self.dimension <= FEW else max(start, self.dimension)
            few = self.simulations < first
            if few or happened.all() or not (happened.any() or np.ptp(score) > 0):  # all outcomes are equal
                count = min(self.batch_size, first)
                return PlainBatch(draw_wide(count, self.dimension, generator, reach), WIDE)
            self._learn_directions()
            if self._is_searching():
                return self._search()
        self.belief.fit(progress)
        cover, required = np.empty((0, self.dimension)), self.required
        if isinstance(required, Cover) and (
            certify or (self._relies_on_cover and results.can_cover(progress))
        ):
            given = progress, required, self.batch_size, generator
            cover = results.runs_of_cover(*given, by_cover_alone=self._is_late)
        # If the interval is narrow, few runs are sampled, from which the surrogate learns what a cover shows.
        few = min(self.batch_size, CERTIFIED) if certify and isinstance(required, Cover) else self.batch_size
        sampled, known = max(few - len(cover), 0), self.belief
        if len(cover) and len(since := progress.cover_runs):
            # The estimate does not know a part that only the last runs of the cover have shown.
            known = self.belief.refitted(progress.without(since))
        given = self.belief, progress, sampled, cover, known.probability(cover) >= CORE
        return SecondPhase(*given, defence, self.emphasis, generator).batch()

    def _search(self) -> PlainBatch:
        """Choose the next batch of the search; if it is long in vain, some are draws of the law.

        They find events in the bulk of the law, where the search has few runs, and bound their probability.
        """
        progress, space, n = self.progress, self.belief.space, min(self.batch_size, SEARCHED)
        in_vain = not progress.happened.any() and progress.searched >= PATIENCE
        turn = len(progress.sizes) % 3 if in_vain and progress.searched >= 4 * PATIENCE else 0
        if turn == 1:
            return PlainBatch(self.generator.standard_normal((n, self.dimension)), PLAIN)
        known = space.coordinates(progress.z), progress.happened, progress.score
        z = draw_approach(n, self._search_reach, *known, self.generator, in_vain=in_vain, in_bulk=turn == 2)
        return PlainBatch(space.draw(z, self.generator), SEARCH)

    def _learn_directions(self) -> None:
        """If there are many normal scores and enough new runs, learn the directions of the event again."""
        progress, runs = self.progress, self.simulations
        known = progress.directions
        if self.dimension <= FEW or (known is not None and runs < RELEARN * progress.learnt_at):
            return
        progress.directions = learn_directions(progress.z, progress.happened, progress.score, known)
        space = space_along(progress.directions, self.dimension)
        self.belief = Belief(space, None, noisy=progress.repeats.vary_often)
        progress.learnt_at = runs if self._is_searching() else 0  # with 0, the surrogates learn again
        events = progress.z[progress.happened]
        progress.rarest = rarity(self.belief.space.coordinates(events)).min(initial=REACH)

    def _is_searching(self) -> bool:
        """Return whether the search continues: it needs an event and one run in every step of rarity."""
        progress = self.progress
        return not progress.happened.any() or (not progress.estimates and progress.searched < 1 / self._step)

    @property
    def _search_reach(self) -> float:
        """Rarity up to which the search extends: that of the most probable known event plus `BEYOND`."""
        return min(self.progress.rarest + BEYOND, REACH)


def _check_settings(
    dimension: object, generator: object, batch_size: object, certificate: object, deterministic: object
) -> None:
    """Raise InputError if an argument of a sampler has another type or is out of range."""
    for name, value, fits, expected in (
        ("dimension", dimension, _is_count(dimension), "a whole number, at least 1"),
        ("generator", generator, isinstance(generator, np.random.Generator), "a numpy.random.Generator"),
        (
            "batch_size",
            batch_size,
            _is_count(batch_size) and batch_size <= POOL // 4,
            f"a whole number, 1 to {POOL // 4}",
        ),
        (
            "certificate",
            certificate,
            isinstance(certificate, Certificate | Cover | None),
            "a Cover, a Certificate or None",
        ),
        ("deterministic", deterministic, isinstance(deterministic, bool | None), "True, False or None"),
    ):
        if not fits:
            raise InputError(name, seen=repr(value), expected=expected, change="Choose another value.")


def _is_count(value: object) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and value >= 1


def _outcomes(happened: ArrayLike, score: ArrayLike | None, n: int) -> tuple[Flags, Array]:
    """Return the flags and scores of n runs as arrays, shape (n,); without scores they are 0."""
    happened, score = np.asarray(happened), np.zeros(n) if score is None else np.asarray(score)
    if happened.dtype != bool or score.dtype.kind not in "biuf":
        seen = f"flags of the type {happened.dtype} and scores of the type {score.dtype}"
        expected = "booleans that state whether the event happens, and real numbers"
        change = "Return, for example, `margin <= 0, margin`."
        raise InputError("the outcomes", seen=seen, expected=expected, change=change)
    if happened.shape != (n,) or score.shape != (n,) or np.isnan(score).any():
        seen = f"{happened.shape} flags and {score.shape} scores, {np.isnan(score).sum()} of them NaN"
        expected = f"{n} flags and {n} scores, each as an array of the shape ({n},), and numbers"
        change = "Return one outcome for each of the points, in their order."
        raise InputError("the outcomes", seen=seen, expected=expected, change=change)
    return happened, np.clip(score.astype(float), -LARGEST_SCORE, LARGEST_SCORE)

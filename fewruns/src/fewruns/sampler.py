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

from fewruns import results, wording
from fewruns.arguments import check_settings, outcomes
from fewruns.arrays import Array, Flags
from fewruns.belief import Belief
from fewruns.certificate import BY_DEFAULT, Certificate
from fewruns.checks import Checks
from fewruns.combining import estimate_batch
from fewruns.constants import (
    CERTIFIED,
    CORE,
    COVERED,
    DEFENCE,
    DEFENCE_ALONE,
    FEW,
    FIRST_REPEATS,
    FREQUENT_REACH,
    FREQUENT_START,
    REACH,
    REACHED,
    RELEARN,
    SHORT_START,
    SHORT_STEP,
    START,
    STEP,
)
from fewruns.cover import Cover
from fewruns.directions import learn_directions
from fewruns.errors import InputError
from fewruns.estimates import Estimate, Stopping
from fewruns.exclusion import Exclusion
from fewruns.pools import Defence, WholeSpace, space_along
from fewruns.problems import Predecessor
from fewruns.progress import LAW, PLAIN, WIDE, Batch, PlainBatch, Progress
from fewruns.repeats import RepeatBatch, end_differently
from fewruns.search import Search
from fewruns.second_phase import SecondPhase
from fewruns.two_phase import TwoPhaseBatch
from fewruns.wide_laws import rarity

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
    >>> while not sampler.is_done(goal):
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
        check_settings(
            dimension=dimension,
            generator=generator,
            batch_size=batch_size,
            fingerprint=fingerprint,
            certificate=certificate,
            upper_set=upper_set,
            predecessor=predecessor,
            deterministic=deterministic,
            enough_repeats=enough_repeats,
            enough_draws=enough_draws,
            frequent=frequent,
        )
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
        self._known: tuple[object, Exclusion] | None = None  # the last exclusion, and for which runs it is
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
        progress = self.progress
        if progress.pending is None:
            if not certify:
                progress.narrow_at = None
            elif progress.narrow_at is None:
                progress.narrow_at = len(progress.z)
            with BLAS.limit(limits=1):
                progress.pending = self._check(certify=certify) or self._design(certify=certify)
        return progress.pending.z.copy()

    def tell(self, happened: ArrayLike, score: ArrayLike | None = None) -> None:
        """Receive the outcomes of the batch that `ask` returned last: flags and scores, shape (n,).

        A score is smaller the closer a run came to the event. InputError is raised if no batch has been
        requested, if the flags are not boolean, or if a shape or score is wrong.
        """
        progress = self.progress
        if (batch := progress.pending) is None:
            expected, change = "those of a requested batch", "Call `ask` once before each `tell`."
            raise InputError("the outcomes", seen="no requested batch", expected=expected, change=change)
        happened, score = outcomes(happened, score, len(batch.z))
        progress.pending = None
        if isinstance(batch, RepeatBatch):
            self._take_repeats(batch, happened, score)
        elif isinstance(batch, PlainBatch) and batch.phase == LAW:
            progress.law_draws = progress.law_draws.extended(batch.z, happened)
            progress.chance |= progress.is_contradicted  # the system may then lapse
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
            progress.searched += len(batch.z) / self._search.reach
        progress.rarest = rarest  # only now, because the batch was drawn up to the earlier reach

    def _take_repeats(self, batch: RepeatBatch, happened: Flags, score: Array) -> None:
        """Compare repetitions with their runs; a difference shows that outcomes may be random."""
        progress, first = self.progress, batch.repeated
        differed = end_differently(progress.happened[first], progress.score[first], happened, score)
        was_noisy = progress.is_noisy
        progress.repeats = progress.repeats.extended(batch, happened, differed, score)
        progress.chance |= bool(differed.any())
        if (is_noisy := progress.is_noisy) != was_noisy:
            # Earlier predictions and estimates assumed another kind of outcome, so they are not used.
            progress.chance_since = len(progress.estimates)
            progress.foreseen, progress.learnt_at = np.empty((0, 2)), 0
            self.belief = Belief(self.belief.space, self.predecessor, noisy=is_noisy)

    @property
    def simulations(self) -> int:
        """Number of simulations whose outcomes have been received, including repeats and draws of the law."""
        return self.progress.simulations

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
        excluded = self._has_excluded_all_else() and self._exclusion.is_sufficient
        return excluded and not self.may_lapse and not self.progress.repeats.drift

    def is_done(self, stopping: Stopping, *, is_narrow: bool | None = None) -> bool:
        """Return whether the runs end: converged or not, and never above the largest number of simulations.

        ``is_narrow`` says whether the estimate is precise enough, by default whether the interval is narrow.
        """
        if self.simulations + self.batch_size > stopping.maximum_simulations:
            return True
        return self.has_ended(is_narrow=self.is_narrow(stopping) if is_narrow is None else is_narrow)

    def has_ended(self, *, is_narrow: bool) -> bool:
        """Return whether the estimate has converged, or no further runs would help it to converge.

        They would not help if the interval has been narrow for so many runs that the scores, or the shape of
        the event, do not allow the default certificate to be met. Only the cover is then completed.
        """
        if self.may_lapse:
            return is_narrow and self.is_counted
        return self.progress.repeats.drift or (
            is_narrow and (self._exclusion.gives_up or self._has_excluded_all_else())
        )

    @property
    def may_lapse(self) -> bool:
        """Whether the system may fail at random in a few of its runs, which the runs may have missed."""
        return self.progress.may_lapse

    @property
    def is_counted(self) -> bool:
        """Whether the estimate is the share of events among the draws of the law (`Progress.is_counted`)."""
        return self.progress.is_counted

    @property
    def unseen_lapses(self) -> float:
        """A bound on the probability that lapses add to an estimate; 0 without lapses, or if they count."""
        return self.progress.unseen_lapses

    def repeats_wanted(self, *, certify: bool) -> int:
        """Return how many repetitions are still required; ``certify`` adds those for convergence."""
        return self._checks.repeats_wanted(certify=certify)

    @property
    def required(self) -> Certificate | Cover:
        """The required certificate; by default a cover, which is stricter for flags without scores."""
        return self._exclusion.required

    def estimate(self, stopping: Stopping) -> Estimate:
        """Return the estimate from the runs so far; ``tables["runs"]`` has a row for each run.

        The diagnostics ``unseen_mode`` and ``unseen_any`` bound the probability of unobserved parts
        (`Certificate`).
        """
        progress, exclusion, checks = self.progress, self._exclusion, self._checks
        converged = self.has_converged(stopping)
        found = results.estimate(progress, self.batch_size, stopping, exclusion, converged=converged)
        words = {
            "reason": wording.reason(progress, stopping, exclusion, checks, is_settled=self.is_settled()),
            "excluded": wording.excluded(progress, exclusion, checks, found.probability),
            "warning": wording.warning(progress, exclusion),
        }
        return results.with_lapses(replace(found, **words), progress, stopping)

    @property
    def _exclusion(self) -> Exclusion:
        """What the runs exclude, which is computed once for each state of the runs."""
        known = self.simulations, len(self.progress.estimates), self.certificate, self.batch_size
        if self._known is None or self._known[0] != known or self._known[1].progress is not self.progress:
            self._known = known, Exclusion(self.progress, self.certificate, self.batch_size)
        return self._known[1]

    @property
    def _checks(self) -> Checks:
        """The checks for random outcomes."""
        return Checks(self.progress, self.deterministic, self.enough_repeats, self.enough_draws)

    @property
    def _search(self) -> Search:
        """The search for the event."""
        return Search(self.progress, self.belief.space, self._step)

    @property
    def _relies_on_cover(self) -> bool:
        """Whether a cover with few runs finds the parts of the event that a longer search would find.

        Systems whose outcomes may be random need more runs, which also show whether they drift.
        """
        by_cover = not isinstance(self.certificate, Certificate)
        return by_cover and self.dimension <= COVERED and self.deterministic is True

    def _has_excluded_all_else(self) -> bool:
        """Return whether the certificate is met and all checks are made; only lapses may then remain."""
        if self._checks.missing or not self._exclusion.is_certified:
            return False
        return not self._relies_on_cover or self.progress.reaches_prediction(REACHED)

    # ---- design of a batch

    def _check(self, *, certify: bool) -> RepeatBatch | PlainBatch | None:
        """Choose runs to repeat, or draws of the law itself; return None while neither is due."""
        n, is_last, repeats = self.batch_size, certify and self._exclusion.is_certified, None
        if not self._search.goes_on and is_last == certify:
            repeats = self._checks.repeats(n, certify=certify)
        return repeats or self._checks.draws(n, self.generator, is_last=is_last)

    def _design(self, *, certify: bool) -> Batch:
        """Choose the next batch: wide draws at first, then the search, then the second phase."""
        progress, generator, exclusion = self.progress, self.generator, self._exclusion
        by_draws = certify and isinstance(self.required, Certificate)
        defence = Defence(DEFENCE_ALONE if by_draws else DEFENCE, exclusion.beyond)
        if self.predecessor is None:
            happened, score = progress.happened, progress.score
            start, reach = self._first
            first = start if self.dimension <= FEW else max(start, self.dimension)
            few = self.simulations < first
            if few or happened.all() or not (happened.any() or np.ptp(score) > 0):  # all outcomes are equal
                return self._search.unguided_batch(min(self.batch_size, first), reach, generator)
            self._learn_directions()
            if self._search.goes_on:
                return self._search.batch(self.batch_size, generator)
        self._fit()
        cover, by_cover = np.empty((0, self.dimension)), isinstance(self.required, Cover)
        if by_cover and (certify or (self._relies_on_cover and exclusion.can_cover)):
            cover = exclusion.runs(generator)
        # If the interval is narrow, few runs are sampled, from which the surrogate learns what a cover shows.
        few = min(self.batch_size, CERTIFIED) if certify and by_cover else self.batch_size
        sampled, known = max(few - len(cover), 0), self.belief
        if len(cover) and len(since := progress.cover_runs):
            # The estimate does not know a part that only the last runs of the cover have shown.
            known = self.belief.refitted(progress.without(since))
        given = self.belief, progress, sampled, cover, known.probability(cover) >= CORE
        batch, progress.centres = SecondPhase(*given, defence, self.emphasis, generator).batch()
        return batch

    def _fit(self) -> None:
        """Fit the surrogates to all runs, and learn their parameters again if there are enough new runs."""
        if learn := self.progress.is_learnt_again:
            self.progress.learnt_at = len(self.progress.z)
        self.belief.fit(self.progress, learn=learn)

    def _learn_directions(self) -> None:
        """If there are many normal scores and enough new runs, learn the directions of the event again."""
        progress, runs = self.progress, self.simulations
        known = progress.directions
        if self.dimension <= FEW or (known is not None and runs < RELEARN * progress.learnt_at):
            return
        progress.directions = learn_directions(progress.z, progress.happened, progress.score, known)
        space = space_along(progress.directions, self.dimension)
        self.belief = Belief(space, None, noisy=progress.is_noisy)
        progress.learnt_at = runs if self._search.goes_on else 0  # with 0, the surrogates learn again
        events = progress.z[progress.happened]
        progress.rarest = rarity(self.belief.space.coordinates(events)).min(initial=REACH)

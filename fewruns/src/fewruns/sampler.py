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

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import ThreadpoolController

from fewruns import results, wording
from fewruns.arguments import check_settings, is_whole, outcomes
from fewruns.arrays import Array, Flags, Function, Indices
from fewruns.belief import Belief
from fewruns.certificate import BY_DEFAULT, Certificate
from fewruns.checks import Checks
from fewruns.combining import estimate_batch
from fewruns.constants import (
    CERTIFIED,
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
from fewruns.errors import InputError, require
from fewruns.estimates import Estimate, Stopping
from fewruns.exclusion import Exclusion
from fewruns.pools import Defence, WholeSpace, space_along
from fewruns.problems import Predecessor
from fewruns.progress import LAW, PLAIN, WIDE, Asked, Batch, PlainBatch, Progress, without_failed
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
    numbers
        Numbers of the runs that `ask` returned last, shape (n,), counted from 0.
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
        check_settings({name: value for name, value in locals().items() if name != "self"})
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
        self.numbers = np.empty(0, np.int64)
        self.emphasis: Function | None = None
        self.belief = Belief(WholeSpace(dimension), predecessor)
        self._known: tuple[object, Exclusion] | None = None  # the last exclusion, and for which runs it is
        # Number of the first runs, their largest rarity, and the step of rarity with one run of the search.
        start, step = (SHORT_START, SHORT_STEP) if self._relies_on_cover else (START, STEP)
        self._first, self._step = (FREQUENT_START, FREQUENT_REACH) if frequent else (start, REACH), step

    # ---- simulations

    def ask(self, n: int | None = None, *, certify: bool = False, exactly: bool = False) -> Array:
        """Return the normal scores to simulate next, shape (k, d); their numbers are in `numbers`.

        Without ``n``, these are all runs whose outcomes have not been received, and a new batch if there are
        none. The array is a copy, which may be changed. The batches of the search, and those that only
        exclude unobserved parts of the event, may be smaller than ``batch_size``.

        With ``n``, they are up to n further runs, although others are pending: as many as there are free
        workers. There are fewer, or none, if it is better to wait for outcomes, but not with ``exactly``.

        With ``certify``, most runs exclude unobserved parts of the event, as needed when the interval is
        narrow. For a deterministic system with at most two inputs, such runs begin earlier.
        """
        asked, before = self.progress.asked, self.outstanding
        if n is None:
            if not asked:
                self._plan(certify=certify)
            for each in asked:
                each.issued = len(each.batch.z)
            before = before[:0]
        else:
            require("n", n, "a whole number, at least 1, or None", fits=is_whole(n, 1))
            while missing := n + len(before) - len(self.outstanding):
                is_issued = not asked or asked[-1].issued == len(asked[-1].batch.z)
                may_plan = exactly or self._may_plan
                if is_issued and not (may_plan and self._plan(certify=certify, exactly=exactly)):
                    break
                asked[-1].issued = min(asked[-1].issued + missing, len(asked[-1].batch.z))
        self.numbers = np.setdiff1d(self.outstanding, before)
        z = [each.batch.z[np.isin(each.first + np.arange(len(each.batch.z)), self.numbers)] for each in asked]
        return np.vstack([self.progress.z[:0], *z])

    @property
    def outstanding(self) -> Indices:
        """Numbers of the runs that `ask` has returned, and whose outcomes have not been received."""
        return np.concatenate([np.empty(0, np.int64), *(each.outstanding for each in self.progress.asked)])

    def tell(
        self,
        happened: ArrayLike,
        score: ArrayLike | None = None,
        *,
        runs: ArrayLike | None = None,
        failed: ArrayLike | None = None,
    ) -> None:
        """Receive the outcomes of runs: flags and scores, shape (n,).

        A score is smaller the closer a run came to the event. The outcomes are those of the runs with the
        numbers ``runs``, in any order, and by default of all outstanding ones. They count as soon as the
        outcomes of their batch and of all earlier batches are known, so that fast runs are not preferred.
        Where ``failed`` is true, a run has no outcome: it leaves the estimate, and the interval contains the
        answers for the two cases that all or none of the failed runs are events.
        InputError is raised if a run is not outstanding, if the flags are not boolean, or if a shape or score
        is wrong.
        """
        asked, outstanding = self.progress.asked, self.outstanding
        numbers = outstanding if runs is None else np.asarray(runs)
        if not len(outstanding) or len(np.intersect1d(numbers, outstanding)) < numbers.size:
            seen = f"the runs {numbers.tolist()}" if len(outstanding) else "no requested batch"
            expected = f"those of the requested runs, each once: {outstanding.tolist()}"
            change = "Call `ask` before each `tell`, and pass the `numbers` of its runs."
            raise InputError("the outcomes", seen=seen, expected=expected, change=change)
        received = outcomes(happened, score, failed, len(numbers))
        for each in asked:
            here = np.isin(numbers, each.outstanding)
            place = numbers[here] - each.first
            each.told[place] = True
            for name, values in zip(("happened", "score", "failed"), received, strict=True):
                getattr(each, name)[place] = values[here]
        while asked and asked[0].told.all():
            self._receive(asked.pop(0))

    def _receive(self, asked: Asked) -> None:
        """Take the outcomes of a complete batch."""
        progress, failed, batch = self.progress, asked.failed, without_failed(asked.batch, asked.failed)
        happened, score = asked.happened[~failed], asked.score[~failed]
        progress.failed = np.vstack([progress.failed, asked.batch.z[failed]])
        progress.failed_draws += (getattr(batch, "phase", None) in (LAW, PLAIN)) * int(failed.sum())
        if isinstance(asked.batch, TwoPhaseBatch):
            progress.estimates.append(estimate_batch(asked.batch, asked.happened, failed))
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
            self._take_runs(batch, happened, int(failed.sum()))

    def _take_runs(self, batch: PlainBatch | TwoPhaseBatch, happened: Flags, failed: int) -> None:
        """Update what is derived from the runs of a batch, some of which have ``failed``."""
        progress = self.progress
        if isinstance(batch, TwoPhaseBatch):
            share = len(batch.z) / (len(batch.z) + failed) if failed else 1.0
            progress.wide_draws = np.vstack([progress.wide_draws, batch.wide_draws * [share, 1, 1]])
            progress.batches.append(batch)
            progress.foreseen = np.vstack([progress.foreseen, batch.foreseen])
            if progress.centres is not None:
                # Kernels are needed around the events of a part that the last pool did not contain.
                progress.centres = np.vstack([progress.centres, batch.z[happened & (batch.weight == 0)]])
            return
        if batch.phase == PLAIN:
            progress.plain = progress.plain.extended(batch.z, happened)
        elif batch.phase == WIDE:
            progress.wide_draws = np.vstack([progress.wide_draws, [len(batch.z), 0.0, self._first[1]]])
        else:
            progress.searched += len(batch.z) / self._search.reach
        # Only now, because the batch was drawn up to the earlier reach.
        events = self.belief.space.coordinates(batch.z[happened])
        progress.rarest = min(rarity(events).min(initial=REACH), progress.rarest)

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
        return results.is_narrow(self.progress, stopping, with_failed=True) and self.is_settled()

    def is_narrow(self, stopping: Stopping) -> bool:
        """Return whether the interval is as narrow as the rule requires, with enough events."""
        return results.is_narrow(self.progress, stopping)

    def is_settled(self) -> bool:
        """Return whether no more runs are needed except to narrow the interval."""
        if self.is_counted:
            return True
        excluded = self._has_excluded_all_else() and self._exclusion.is_sufficient
        return excluded and not self.progress.may_lapse and not self.progress.repeats.drift

    def is_done(self, stopping: Stopping, *, is_narrow: bool | None = None) -> bool:
        """Return whether the runs end: converged or not, and never above the largest number of simulations.

        ``is_narrow`` says whether the estimate is precise enough, by default whether the interval is narrow.
        """
        if self.progress.next_number + self.batch_size > stopping.maximum_simulations:
            return True
        return self.has_ended(is_narrow=self.is_narrow(stopping) if is_narrow is None else is_narrow)

    def has_ended(self, *, is_narrow: bool) -> bool:
        """Return whether the estimate has converged, or no further runs would help it to converge.

        They would not help if the system drifts, or if the default certificate is met but does not suffice
        for so many inputs.
        """
        if self.progress.may_lapse:
            return is_narrow and self.is_counted
        return self.progress.repeats.drift or (is_narrow and self._has_excluded_all_else())

    @property
    def is_counted(self) -> bool:
        """Whether the estimate is the share of events among the draws of the law (`Progress.is_counted`)."""
        return self.progress.is_counted

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
        exclusion, checks, converged = self._exclusion, self._checks, self.has_converged(stopping)
        found = results.estimate(exclusion, self.batch_size, stopping, converged=converged)
        return replace(
            results.with_lapses(found, self.progress, stopping),
            reason=wording.reason(exclusion, checks, stopping, is_settled=self.is_settled()),
            excluded=wording.excluded(exclusion, checks, found.probability),
            warning=wording.warning(exclusion),
        )

    @property
    def _exclusion(self) -> Exclusion:
        """What the runs exclude, which is computed once for each state of the runs."""
        progress = self.progress
        state = self.simulations, len(progress.estimates), progress.narrow_at
        known = *state, self.certificate, self.batch_size
        if self._known is None or self._known[0] != known or self._known[1].progress is not progress:
            self._known = known, Exclusion(progress, self.certificate, self.batch_size)
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

    @property
    def _may_plan(self) -> bool:
        """Whether a further batch may be planned: at most as many runs are pending as there are, or begin."""
        return self.progress.next_number - self.simulations < max(self.simulations, self._first[0])

    def _plan(self, *, certify: bool, exactly: bool = False) -> bool:
        """Choose the next batch, and return whether there is one; otherwise, outcomes are needed first."""
        progress = self.progress
        if not certify:
            progress.narrow_at = None
        elif progress.narrow_at is None:
            progress.narrow_at = len(progress.z)
        with BLAS.limit(limits=1):
            batch = self._check(certify=certify) or self._design(certify=certify, exactly=exactly)
        if batch is not None:
            progress.asked.append(Asked.start(batch, progress.next_number))
        return batch is not None

    def _check(self, *, certify: bool) -> RepeatBatch | PlainBatch | None:
        """Choose runs to repeat, or draws of the law itself; return None while neither is due."""
        n, is_last, repeats = self.batch_size, certify and self._exclusion.is_certified, None
        checks = replace(self._checks, progress=self.progress.planned)
        if not self._search.goes_on and is_last == certify:
            repeats = checks.repeats(n, certify=certify)
        return repeats or checks.draws(n, self.generator, is_last=is_last)

    def _design(self, *, certify: bool, exactly: bool) -> Batch | None:
        """Choose the next batch: wide draws at first, then the search, then the second phase."""
        progress, generator, exclusion = self.progress, self.generator, self._exclusion
        by_draws = certify and isinstance(self.required, Certificate)
        defence = Defence(DEFENCE_ALONE if by_draws else DEFENCE, exclusion.beyond)
        if self.predecessor is None:
            happened, score = progress.happened, progress.score
            start, reach = self._first
            first = start if self.dimension <= FEW else max(start, self.dimension)
            early = self.simulations < first
            if early or happened.all() or not (happened.any() or np.ptp(score) > 0):  # all outcomes are equal
                return self._search.unguided_batch(min(self.batch_size, first), reach, generator)
            self._learn_directions()
            if self._search.goes_on:
                return self._search.batch(self.batch_size, generator)
        self._fit()
        runs, by_cover = self.batch_size, isinstance(self.required, Cover)
        cover, known = progress.z[:0], self.belief
        if by_cover and self._cover_is_due(certify=certify):
            cover = exclusion.runs(generator)
        if certify and by_cover:  # from a few runs the surrogate learns what the cover shows
            if progress.asked and not len(cover) and not exactly:
                return None
            runs = min(runs, CERTIFIED)
        if len(cover) and len(since := progress.cover_runs):
            # The estimate does not know a part that only the last runs of the cover have shown.
            known = self.belief.refitted(progress.without(since))
        phase = SecondPhase(self.belief, progress, runs, defence, self.emphasis, generator)
        batch, progress.centres = phase.batch(cover, known)
        return batch

    def _cover_is_due(self, *, certify: bool) -> bool:
        """Return whether the next batch may exclude other parts of the event.

        A sampled batch follows each batch of a cover that was not full. Little is left to exclude then, but
        earlier batches may have excluded a part of the event.
        """
        is_full = len(self.progress.cover_runs) % self.batch_size == 0 or bool(self.progress.asked)
        return is_full and (certify or (self._relies_on_cover and self._exclusion.can_cover))

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

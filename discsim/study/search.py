"""Search for the settings with the least CPU time at a given error, by local power laws of the knobs.

A knob is a parameter to vary. A place is a tuple with a rung for each knob, 0 for the value in the scene. For a
number, RUNG more is one step finer; the rungs of a choice number its values. The search starts at a coarse place and
moves a centre, the best place so far. For each knob k, `run_probes` runs the places one rung from the centre (probes),
and finds

    dE_k = ln(error of probe / error of centre),   dC_k = ln(CPU time of probe / CPU time of centre)

Between and beyond probes, error and CPU time are extrapolated as power laws of the knob, with a slightly curved dE,
as errors of several knobs add up. Knobs are assumed independent: the place that minimises sum dC_k + lambda sum dE_k
then follows knob by knob. lambda is the smallest value for which this place satisfies

    sum dE_k <= ln(goal / error of centre)                                                         (1)

If no place within MAX_SHIFT satisfies (1), lambda is the price of accuracy at the centre, d ln CPU / d ln(1/error) of
the best knob. The place found is run. If it is better than the centre, it becomes the next centre; if not, the length
of moves is halved. The search ends if no place is predicted to gain MIN_GAIN. Finally the best places are run with
several seeds; the result is the cheapest one whose mean error reaches the goal.

A gain must exceed twice the scatter between seeds. A knob without effect on error and cost therefore stays unchanged,
and a knob that only costs is made coarser. This module does not make runs itself; tests use synthetic results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from statistics import stdev
from typing import NamedTuple

from discsim.study.trials import RUNG, Knob, Place, Runner, Trial

MAX_SHIFT = 2 * RUNG  # largest change of a knob in a move
MIN_GAIN = 0.05  # least gain of a move in ln CPU
MIN_COST_NOISE = 0.07  # smallest noise of ln CPU that is assumed
FINER_NOISE_FACTOR = 4.0  # factor on the noise of ln CPU for a finer place that is cheaper, but not more accurate
MIN_ERROR_NOISE = 0.01  # smallest noise of ln error that is assumed, also if seeds do not scatter
CURVATURE = 1.3  # dE grows as distance^CURVATURE where it rises, distance^(1/CURVATURE) where it falls: errors add up
FIRST_SEEDS = 5  # seeds of the first place; their scatter is the noise
MAX_CHOICE_PRICE = math.log(2.0)  # a value of a choice is not probed again if its dC + lambda dE exceeds this
USUAL_GAIN = 0.5  # assumed gain in ln error per ln CPU before the first probes
MAX_TRIES, MAX_MOVES = 4, 40  # largest numbers of predicted places per move, and of moves
MAX_LAMBDA = 1e3  # largest lambda
MAX_RETRIES, AIM_FACTOR = 20, 0.95  # if a mean over seeds misses the goal: largest number of retries, factor on the aim
COST_FACTOR_LIMIT, EXTRA_SECONDS = 10.0, 0.5  # limit of a run: a factor on the CPU time of the centre, plus seconds
MAX_FINALIST_COST, MAX_FINALISTS = 1.3, 3  # finalists: largest CPU time over that of the cheapest, largest number


class Option(NamedTuple):
    """A rung of a knob, with the changes dE and dC relative to the centre."""

    rung: int
    error: float  # dE
    cost: float  # dC


class Search:
    """A search for the cheapest place with at most the error `goal`.

    `start` is a place with coarse settings. `runner` makes the runs, `repeat` is the number of seeds of final results.
    `centre` is the best place so far, `here` its trial.
    """

    def __init__(
        self,
        knobs: Sequence[Knob],
        runner: Runner,
        goal: float,
        start: Place,
        say: Callable[[str], None],
        repeat: int = 3,
    ) -> None:
        self.knobs, self.runner, self.goal, self.say, self.repeat = knobs, runner, goal, say, repeat
        self.aim = goal  # largest error of places that may be finalists; lowered if means over seeds exceed the goal
        self.centre = start
        self.error_noise = 0.0  # twice the scatter of ln error between seeds
        self.cost_noise = MIN_COST_NOISE  # twice the scatter of ln CPU
        self.seeds = 1  # seeds of each probe
        self.rate = USUAL_GAIN  # gain in ln error per ln CPU of the best knob, 1 / lambda
        self.visited: set[Place] = set()  # earlier centres
        self.rejected_choices: set[tuple[int, int]] = set()  # (knob, rung) of choices that are not probed again

    def trial_at(self, place: Place) -> Trial | None:
        """Return the trial of a place; None without runs."""
        trial = self.runner.trials.get(place)
        return trial if trial and trial.runs else None

    @property
    def here(self) -> Trial:
        """The trial of the centre."""
        return self.runner.trials[self.centre]

    @property
    def margin(self) -> float:
        """The noise of ln error of probes; smaller gains count as none."""
        return max(MIN_ERROR_NOISE, self.error_noise / math.sqrt(self.seeds))

    def finished_trials(self) -> list[Trial]:
        """Return the trials with runs."""
        return [trial for trial in self.runner.trials.values() if trial.runs]

    def run(self) -> Trial | None:
        """Search, and return the cheapest trial that reaches the goal; None if there is none. Raises BudgetError."""
        if not self._run_start():
            return None
        if self.here.scatter > 0.0:
            self.runner.run([self.centre], FIRST_SEEDS)
        self.error_noise = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
        times = [_ln(run.cpu) for run in self.here.runs]
        self.cost_noise = max(MIN_COST_NOISE, 2.0 * stdev(times) if len(times) > 1 else 0.0)
        for _ in range(MAX_RETRIES):
            self._move_to_minimum()
            if self.here.error > self.aim:
                break
            self._reset_knobs()
            found = self._compare_finalists([self.centre, *self._places_within_aim()])
            if found is not None:
                return found
            self.aim *= AIM_FACTOR
        self.aim = self.goal
        # Places whose error so far is below the goal.
        groups = [[place] for place in self._places_within_aim()[:MAX_TRIES]]
        return next((found for found in map(self._compare_finalists, groups) if found), None)

    def _run_start(self) -> bool:
        """Run the start; as long as that gives no result, halve its distance to the scene and try again.

        Returns False if even the scene itself gives no result.
        """
        while True:
            if self.runner.allowed(self.centre):
                self.runner.run([self.centre], self.repeat)
                if self.trial_at(self.centre):
                    return True
            if not any(self.centre):
                return False
            self.centre = tuple(int(rung / 2) for rung in self.centre)

    def _places_within_aim(self) -> list[Place]:
        """Return the places with runs whose error is at most `aim`, the cheapest first."""
        return [t.place for t in sorted(self.finished_trials(), key=lambda t: t.cpu) if t.error <= self.aim]

    # Moves

    def _move_to_minimum(self) -> None:
        """Move the centre until no move gains enough, or MAX_MOVES times."""
        for _ in range(MAX_MOVES):
            self.run_probes()
            if self._move_once():
                self.seeds = 1
            elif self.here.error <= self.aim:
                return
            elif self._move_two_rungs():
                self.seeds = 1
            elif self.error_noise > MIN_ERROR_NOISE and self.seeds < self.repeat:
                self.seeds += 1  # more seeds reduce the noise, which may hide gains
            elif not self._refine_all():
                return

    def run_probes(self) -> None:
        """Run the probes: every number one rung in each direction, and every value of a choice."""
        near = list(self._probes(self.centre))
        self._measure_noise()
        self.runner.run(near, self.seeds, COST_FACTOR_LIMIT * self.here.cpu + EXTRA_SECONDS)
        rates = []
        for place in near:
            change = self._change_from_centre(place)
            if change and change.error < 0.0 < change.cost:
                rates.append(-change.error / change.cost)
        self.rate = min(max(rates, default=USUAL_GAIN), 4.0)
        for place in near:
            (knob, rung), change = self._changed_knob(place), self._change_from_centre(place)
            if self.knobs[knob].choice and (
                change is None or change.cost + change.error / self.rate > MAX_CHOICE_PRICE
            ):
                self.rejected_choices.add((knob, rung))

    def _measure_noise(self) -> None:
        """Average the noise with the scatter at this centre, which has a weight of 2/3; finer settings scatter less."""
        if self.error_noise > 0.0:
            self.runner.run([self.centre], self.repeat)
            own = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
            self.error_noise = math.sqrt((2.0 * own**2 + self.error_noise**2) / 3.0)

    def _probes(self, place: Place) -> Iterator[Place]:
        """Yield the places that `run_probes` probes around a place."""
        for k, knob in enumerate(self.knobs):
            if knob.choice:
                rungs = [r for r in range(knob.lowest, knob.highest + 1) if (k, r) not in self.rejected_choices]
            else:
                rungs = [r for r in (place[k] - RUNG, place[k] + RUNG) if knob.lowest <= r <= knob.highest]
            for rung in rungs:
                there = (*place[:k], rung, *place[k + 1 :])
                if rung != place[k] and self.runner.allowed(there):
                    yield there

    def _changed_knob(self, place: Place) -> tuple[int, int]:
        """Return the first knob in which a place differs from the centre, and the rung of this knob in the place."""
        k = next(k for k, rung in enumerate(place) if rung != self.centre[k])
        return k, place[k]

    def _change_from_centre(self, place: Place) -> Option | None:
        """Return dE and dC of a place relative to the centre; None without runs.

        Gains in error and changes of cost that are below the noise are set to 0.
        """
        there, here = self.trial_at(place), self.here
        if there is None:
            return None
        error, cost = _ln(there.error / here.error), _ln(there.cpu / here.cpu)
        error = 0.0 if -self.margin < error < 0.0 else error
        finer = any(r > own and not k.choice for r, own, k in zip(place, self.centre, self.knobs, strict=True))
        least = self.cost_noise * (FINER_NOISE_FACTOR if finer and error >= 0.0 and cost < 0.0 else 1.0)
        return Option(0, error, 0.0 if abs(cost) < least else cost)

    def _move_once(self) -> bool:
        """Run predicted places until one is better than the centre, and make it the centre; else take a better probe.

        At most MAX_TRIES places are run. Returns whether the centre has moved.
        """
        options, reach, missed = self._options_by_knob(), MAX_SHIFT, 0.0
        for _ in range(MAX_TRIES):
            target, change = self._predicted_place(options, reach, missed)
            if target == self.centre:
                break
            if self.trial_at(target) is None:
                self.runner.run([target], most=3.0 * self.here.cpu * math.exp(change.cost) + EXTRA_SECONDS)
            if self._is_better(target):
                self._set_centre(target)
                return True
            found = self.trial_at(target)
            if found is not None:
                missed = max(missed, _ln(found.error / self.here.error) - change.error)
            reach = max(1, reach // 2)
        better = [place for place in self._probes(self.centre) if self._is_better(place)]
        if better:
            self._set_centre(min(better, key=self._rank))
        return bool(better)

    def _options_by_knob(self) -> list[list[Option]]:
        """Return for each knob the rungs within MAX_SHIFT with their predicted changes; the centre's rung is first."""
        out = []
        for k, knob in enumerate(self.knobs):
            options = [Option(self.centre[k], 0.0, 0.0)]
            for place in self._probes(self.centre):
                rung, change = place[k], self._change_from_centre(place)
                if rung == self.centre[k] or change is None:
                    continue
                if knob.choice:
                    options.append(Option(rung, change.error, change.cost))
                    continue
                way = 1 if rung > self.centre[k] else -1
                for half in range(knob.stride, MAX_SHIFT + 1, knob.stride):
                    there = self.centre[k] + way * half
                    if knob.lowest <= there <= knob.highest:
                        share = half / RUNG
                        bent = share ** (CURVATURE if change.error > 0.0 else 1.0 / CURVATURE)
                        options.append(Option(there, change.error * bent, change.cost * share))
            out.append(options)
        return out

    def _predicted_place(self, options: list[list[Option]], reach: int, missed: float) -> tuple[Place, Option]:
        """Return the place within `reach` that minimises the cost under eq. (1), and its predicted change.

        Returns the centre if the predicted gain is too small. `missed` is added to the predicted ln error, after an
        earlier prediction that was too small by this amount.
        """
        slack = math.log(self.aim) - _ln(self.here.error) - missed
        most = math.inf if slack >= 0.0 else 1.0 / (0.8 * self.rate)  # slightly above the price of the best knob
        price = 0.02
        while True:
            chosen = [
                min(
                    (o for o in each if knob.choice or abs(o.rung - each[0].rung) <= reach),
                    key=lambda o: o.cost + price * o.error + (1e-3 if o is not each[0] else 0.0),
                )
                for knob, each in zip(self.knobs, options, strict=True)
            ]
            change = Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))
            if change.error <= slack or (price >= most and change.error < 0.0) or price >= MAX_LAMBDA:
                break
            price *= 1.2
        if slack >= 0.0:
            chosen = _spend_slack(chosen, options, slack, reach, self.knobs)
            change = Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))
        place = tuple(o.rung for o in chosen)
        # Predictions are uncertain: a move must gain at least MIN_GAIN.
        worth = -change.cost if slack >= 0.0 else -change.cost - change.error * max(most, price)
        return (
            (place, change) if worth > MIN_GAIN and self.runner.allowed(place) else (self.centre, Option(0, 0.0, 0.0))
        )

    def _move_two_rungs(self) -> bool:
        """Run the place two rungs along the most promising knob, in case noise hides the gain of a single rung.

        If this place is better, it becomes the centre. Returns whether it has.
        """
        likely: list[tuple[float, Place]] = []
        for place in self._probes(self.centre):
            found, (k, rung) = self.trial_at(place), self._changed_knob(place)
            there = (*place[:k], 2 * rung - self.centre[k], *place[k + 1 :])
            if found and not self.knobs[k].choice and self.knobs[k].lowest <= there[k] <= self.knobs[k].highest:
                gain, cost = -_ln(found.error / self.here.error), _ln(found.cpu / self.here.cpu)
                if gain > 0.0 and self.runner.allowed(there):
                    likely.append((gain / max(cost, self.cost_noise), there))
        if not likely:
            return False
        best = max(likely)[1]
        self.runner.run([best], most=4.0 * COST_FACTOR_LIMIT * self.here.cpu + EXTRA_SECONDS)
        change = self._change_from_centre(best)
        if change is None or change.error >= 0.0 or best in self.visited:
            return False
        self._set_centre(best)
        return True

    def _refine_all(self) -> bool:
        """Run the place with all numbers one rung finer, in case no knob gains by itself.

        If this place is better, it becomes the centre. Returns whether it has.
        """
        finer = tuple(
            rung if knob.choice else min(knob.highest, rung + RUNG)
            for rung, knob in zip(self.centre, self.knobs, strict=True)
        )
        if finer == self.centre or not self.runner.allowed(finer):
            return False
        self.runner.run([finer], most=4.0 * COST_FACTOR_LIMIT * self.here.cpu + EXTRA_SECONDS)
        found = self.trial_at(finer)
        if found is None or _ln(found.error / self.here.error) > -self.margin:
            return False
        self._set_centre(finer)
        return True

    def _reset_knobs(self) -> None:
        """Set knobs one by one to the value in the scene, if the error stays within `aim` at about the same cost."""
        for k in range(len(self.knobs)):
            if self.here.error > self.aim or self.centre[k] == 0:
                continue
            back = (*self.centre[:k], 0, *self.centre[k + 1 :])
            if not self.runner.allowed(back) or self._costs_more_towards_scene(k):
                continue
            more = max(2.0 * MIN_GAIN, self.cost_noise)
            self.runner.run([back], most=(1.0 + more) * self.here.cpu + EXTRA_SECONDS)
            found = self.trial_at(back)
            if found and found.error <= self.aim and _ln(found.cpu / self.here.cpu) < more:
                self._set_centre(back)

    def _costs_more_towards_scene(self, k: int) -> bool:
        """Return whether one rung of knob k towards the scene has a noticeably higher cost."""
        way = RUNG if self.centre[k] < 0 else -RUNG
        change = self._change_from_centre((*self.centre[:k], self.centre[k] + way, *self.centre[k + 1 :]))
        return not self.knobs[k].choice and change is not None and change.cost > max(2.0 * MIN_GAIN, self.cost_noise)

    # Comparison of places

    def _rank(self, place: Place) -> tuple[int, float]:
        """Return a pair by which places are compared; the smaller one is better.

        (0, ln CPU time) if the error is at most `aim`; else (1, ln of the CPU time estimated for an error of `aim`);
        (2, inf) without runs.
        """
        found = self.trial_at(place)
        if found is None:
            return 2, math.inf
        if found.error <= self.aim:
            return 0, _ln(found.cpu)
        return 1, _ln(found.cpu) + _ln(found.error / self.aim) / (0.8 * self.rate)

    def _is_better(self, place: Place) -> bool:
        """Return whether a place is better than the centre; errors that differ only by noise count as equal."""
        if place == self.centre or self.trial_at(place) is None:
            return False
        (level, now), (other, then) = self._rank(self.centre), self._rank(place)
        if other != level:
            return other < level
        change = self._change_from_centre(place)
        assert change is not None
        if level == 0:
            return then < now - MIN_GAIN and change.cost < 0.0
        # Never to a larger error: as the price of an error changes, the search could cycle.
        return (
            place not in self.visited
            and change.error <= MIN_ERROR_NOISE
            and change.cost + change.error / (0.8 * self.rate) < -MIN_GAIN
        )

    def _set_centre(self, place: Place) -> None:
        """Make a place the centre."""
        self.visited.add(self.centre)
        self.centre = place
        here = self.here
        self.say(f"  centre: error {here.error:.2g} in {here.cpu:.3g} s of CPU")

    def _compare_finalists(self, good: list[Place]) -> Trial | None:
        """Run the cheapest of the `good` places with several seeds, and make the best of them the centre.

        `good` starts with the centre or the cheapest place. Returns the cheapest trial whose mean error is at most
        the goal, and among equally cheap ones the one closest to the scene. Returns None if there is none.
        """
        most = MAX_FINALIST_COST * self.runner.trials[good[0]].cpu
        places = [place for place in dict.fromkeys(good) if self.runner.trials[place].cpu <= most][:MAX_FINALISTS]
        scene = tuple(0 for _ in self.knobs)  # finalists are compared with the unchanged scene
        self.runner.run(list(dict.fromkeys([*places, scene])), self.repeat)
        held = [t for t in map(self.trial_at, places) if t and t.error <= self.goal]
        if not held:
            return None
        least = min(t.cpu for t in held)
        best = min(
            (t for t in held if t.cpu <= (1.0 + MIN_GAIN) * least),
            key=lambda t: (_changed_knobs(scene, t.place), t.cpu),
        )
        self.centre = best.place
        return best


def _spend_slack(
    chosen: list[Option], options: list[list[Option]], slack: float, reach: int, knobs: Sequence[Knob]
) -> list[Option]:
    """Make knobs cheaper one by one, as long as the sum of dE stays below `slack`; return the options.

    The search with a single lambda changes two equal knobs only together, so that some slack may remain.
    """
    chosen = list(chosen)
    for k, each in enumerate(options):
        left = slack - sum(o.error for o in chosen) + chosen[k].error
        within = (o for o in each if knobs[k].choice or abs(o.rung - each[0].rung) <= reach)
        best = min((o for o in within if o.error <= left), key=lambda o: o.cost, default=chosen[k])
        chosen[k] = best if best.cost < chosen[k].cost - MIN_GAIN else chosen[k]
    return chosen


def _changed_knobs(scene: Place, place: Place) -> int:
    """Return the number of knobs in which two places differ."""
    return sum(rung != own for rung, own in zip(place, scene, strict=True))


def _ln(value: float) -> float:
    return math.log(max(value, 1e-300))

"""Search for the settings with the least CPU time at a given error, by local power laws of the knobs.

A knob is a parameter that the search varies. A grid point has an entry for each knob, 0 for the value in the scene. For
a number, an entry that is larger by UNITS_PER_RUNG means a value one rung finer; for a choice, the entry is the index
of a value. The search starts at a coarse point and moves a centre, the best point so far. For each knob k, `run_probes`
runs the points one rung from the centre (probes), and finds

    dE_k = ln(error of probe / error of centre),   dC_k = ln(CPU time of probe / CPU time of centre)

Between and beyond probes, error and CPU time are power laws of the knob, with a slightly curved dE, because the errors
of several knobs add up. Knobs are assumed independent, so that the point that minimises sum dC_k + lambda sum dE_k
follows knob by knob. lambda is the smallest value for which this point satisfies

    sum dE_k <= ln(goal / error of centre)                                                         (1)

If no point within MAX_SHIFT satisfies (1), lambda is the price of accuracy at the centre, d ln CPU / d ln(1/error) of
the best knob. The point found is run. If it is better than the centre, it becomes the next centre; if not, moves become
half as long. The search ends if no point is predicted to gain MIN_GAIN. Finally the best points are run with several
seeds; the result is the cheapest point whose mean error reaches the goal.

A gain must exceed twice the scatter between seeds. A knob without effect on error and cost therefore stays unchanged,
and a knob that only costs is made coarser. This module does not make runs itself; tests use synthetic results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from statistics import stdev
from typing import TYPE_CHECKING, NamedTuple

from discsim.study.trials import UNITS_PER_RUNG, GridPoint, Runner, Trial, finished_trial, finished_trials, with_rung

if TYPE_CHECKING:
    from discsim.study.knobs import Knob

MAX_SHIFT = 2 * UNITS_PER_RUNG  # largest change of a knob in a move
MIN_GAIN = 0.05  # smallest gain of a move in ln CPU
MIN_COST_NOISE = 0.07  # smallest noise of ln CPU that is assumed
FINER_NOISE_FACTOR = 4.0  # factor on the noise of ln CPU for a finer point that is cheaper, but not more accurate
MIN_ERROR_NOISE = 0.01  # smallest noise of ln error that is assumed, also if seeds do not scatter
CURVATURE = 1.3  # dE grows as distance^CURVATURE where it rises, distance^(1/CURVATURE) where it falls: errors add up
FIRST_SEEDS = 5  # seeds of the first point; their scatter is the noise
MAX_CHOICE_PRICE = math.log(2.0)  # a value of a choice is not probed again if its dC + lambda dE exceeds this
USUAL_GAIN = 0.5  # assumed gain in ln error per ln CPU before the first probes
MAX_TRIES, MAX_MOVES = 4, 40  # largest numbers of predicted points per move, and of moves
MAX_LAMBDA = 1e3  # largest lambda
MAX_RETRIES, AIM_FACTOR = 20, 0.95  # if a mean over seeds misses the goal: largest number of retries, factor on the aim
COST_FACTOR_LIMIT, EXTRA_SECONDS = 10.0, 0.5  # limit of a run: a factor on the CPU time of the centre, plus seconds
MAX_FINALIST_COST, MAX_FINALISTS = 1.3, 3  # finalists: largest ratio to the CPU time of the cheapest, largest number


class Option(NamedTuple):
    """An entry of a knob in a grid point, with the changes dE and dC of a move from the centre to this entry."""

    rung: int
    error: float  # dE
    cost: float  # dC


class Search:
    """A search for the cheapest grid point with at most the error `goal`.

    start: a point with coarse settings. runner: makes the runs. repeat: number of seeds of the final results. say:
    prints a line. The attribute `centre` is the best point so far, `centre_trial` its trial.
    """

    def __init__(
        self, knobs: Sequence[Knob], runner: Runner, goal: float, start: GridPoint, say: Callable[[str], None],
        repeat: int = 3,
    ) -> None:  # fmt: skip
        self.knobs, self.runner, self.goal, self.say, self.repeat = knobs, runner, goal, say, repeat
        self.aim = goal  # largest error of points that may be finalists; lowered if means over seeds exceed the goal
        self.centre = start
        self.error_noise = 0.0  # twice the scatter of ln error between seeds
        self.cost_noise = MIN_COST_NOISE  # twice the scatter of ln CPU
        self.seeds = 1  # seeds of each probe
        self.rate = USUAL_GAIN  # gain in ln error per ln CPU of the best knob, 1 / lambda
        self.visited: set[GridPoint] = set()  # earlier centres
        self.rejected_choices: set[tuple[int, int]] = set()  # (knob, rung) of choices that are not probed again

    def trial_at(self, point: GridPoint) -> Trial | None:
        """Return the trial of a grid point; None if it has no results of runs."""
        return finished_trial(self.runner.trials, point)

    @property
    def centre_trial(self) -> Trial:
        """The trial of the centre."""
        return self.runner.trials[self.centre]

    @property
    def margin(self) -> float:
        """The noise of ln error in the mean over the seeds of a probe; a smaller gain counts as 0."""
        return max(MIN_ERROR_NOISE, self.error_noise / math.sqrt(self.seeds))

    def run(self) -> Trial | None:
        """Search, and return the cheapest trial that reaches the goal; None if no trial does. Raises BudgetError."""
        if not self._run_start():
            return None
        if self.centre_trial.scatter > 0.0:
            self.runner.run([self.centre], FIRST_SEEDS)
        self.error_noise = self._noise_at_centre()
        times = [_ln(run.cpu) for run in self.centre_trial.runs]
        self.cost_noise = max(MIN_COST_NOISE, 2.0 * stdev(times) if len(times) > 1 else 0.0)
        for _ in range(MAX_RETRIES):
            self._move_to_minimum()
            if self.centre_trial.error > self.aim:
                break
            self._reset_knobs()
            found = self._compare_finalists([self.centre, *self._points_within_aim()])
            if found is not None:
                return found
            self.aim *= AIM_FACTOR
        self.aim = self.goal
        # Places whose error so far is below the goal.
        groups = [[point] for point in self._points_within_aim()[:MAX_TRIES]]
        return next((found for found in map(self._compare_finalists, groups) if found), None)

    def _run_start(self) -> bool:
        """Run the start, the first centre.

        As long as the start gives no result, halve the distance of its entries from 0, the scene. Returns False if even
        the scene itself gives no result.
        """
        while True:
            if self.runner.is_valid(self.centre):
                self.runner.run([self.centre], self.repeat)
                if self.trial_at(self.centre):
                    return True
            if not any(self.centre):
                return False
            self.centre = tuple(int(rung / 2) for rung in self.centre)

    def _points_within_aim(self) -> list[GridPoint]:
        """Return the points with results whose error is at most `aim`, the cheapest first."""
        done = sorted(finished_trials(self.runner.trials), key=lambda t: t.cpu)
        return [t.point for t in done if t.error <= self.aim]

    # Moves

    def _move_to_minimum(self) -> None:
        """Move the centre until no move gains enough, or MAX_MOVES times."""
        for _ in range(MAX_MOVES):
            self.run_probes()
            if self._move_once():
                self.seeds = 1
            elif self.centre_trial.error <= self.aim:
                return
            elif self._move_two_rungs():
                self.seeds = 1
            elif self.error_noise > MIN_ERROR_NOISE and self.seeds < self.repeat:
                self.seeds += 1  # more seeds reduce the noise, which may hide gains
            elif not self._refine_all():
                return

    def run_probes(self) -> None:
        """Run the probes, points that differ from the centre in one knob.

        A number differs by one rung, a choice by another of its values. Sets `rate` to the gain of the best knob. If a
        value of a choice proves too expensive, this value is not probed again.
        """
        near = list(self._probes(self.centre))
        self._measure_noise()
        self.runner.run(near, self.seeds, COST_FACTOR_LIMIT * self.centre_trial.cpu + EXTRA_SECONDS)
        rates = []
        for point in near:
            change = self._change_from_centre(point)
            if change and change.error < 0.0 < change.cost:
                rates.append(-change.error / change.cost)
        self.rate = min(max(rates, default=USUAL_GAIN), 4.0)
        for point in near:
            (knob, rung), change = self._changed_knob(point), self._change_from_centre(point)
            is_dear = change is None or change.cost + change.error / self.rate > MAX_CHOICE_PRICE
            if self.knobs[knob].is_choice and is_dear:
                self.rejected_choices.add((knob, rung))

    def _measure_noise(self) -> None:
        """Update the noise of the error with the scatter at the present centre.

        The new noise is a quadratic mean: of the scatter with weight 2/3, and of the previous noise with weight 1/3.
        The noise changes along the search, because finer settings scatter less.
        """
        if self.error_noise > 0.0:
            self.runner.run([self.centre], self.repeat)
            self.error_noise = math.sqrt((2.0 * self._noise_at_centre() ** 2 + self.error_noise**2) / 3.0)

    def _noise_at_centre(self) -> float:
        """Return twice the scatter of ln error between the seeds of the centre."""
        return 2.0 * self.centre_trial.scatter / max(self.centre_trial.error, 1e-300)

    def _probes(self, point: GridPoint) -> Iterator[GridPoint]:
        """Yield the points that `run_probes` probes around a point."""
        for k, knob in enumerate(self.knobs):
            either_side = (point[k] - UNITS_PER_RUNG, point[k] + UNITS_PER_RUNG)
            for rung in range(knob.lowest, knob.highest + 1) if knob.is_choice else either_side:
                there, is_open = with_rung(point, k, rung), (k, rung) not in self.rejected_choices
                if is_open and rung != point[k] and knob.lowest <= rung <= knob.highest and self.runner.is_valid(there):
                    yield there

    def _changed_knob(self, point: GridPoint) -> tuple[int, int]:
        """Return the index of the first knob in which a point differs from the centre, and the point's entry for it."""
        k = next(k for k, rung in enumerate(point) if rung != self.centre[k])
        return k, point[k]

    def _change_from_centre(self, point: GridPoint) -> Option | None:
        """Return dE and dC of a point relative to the centre; None if the point has no results of runs.

        A gain in error and a change of cost that are below the noise are set to 0.
        """
        there, here = self.trial_at(point), self.centre_trial
        if there is None:
            return None
        error, cost = _ln(there.error / here.error), _ln(there.cpu / here.cpu)
        error = 0.0 if -self.margin < error < 0.0 else error
        finer = any(r > own and not k.is_choice for r, own, k in zip(point, self.centre, self.knobs, strict=True))
        least = self.cost_noise * (FINER_NOISE_FACTOR if finer and error >= 0.0 and cost < 0.0 else 1.0)
        return Option(0, error, 0.0 if abs(cost) < least else cost)

    def _move_once(self) -> bool:
        """Move the centre to a better point: a predicted one, or else the best probe. Return whether it has moved.

        Predicted points are run until one is better than the centre, at most MAX_TRIES of them.
        """
        options, reach, missed = self._options_by_knob(), MAX_SHIFT, 0.0
        for _ in range(MAX_TRIES):
            target, change = self._predicted_point(options, reach, missed)
            if target == self.centre:
                break
            if self.trial_at(target) is None:
                self.runner.run([target], most=3.0 * self.centre_trial.cpu * math.exp(change.cost) + EXTRA_SECONDS)
            if self._is_better(target):
                self._set_centre(target)
                return True
            found = self.trial_at(target)
            if found is not None:
                missed = max(missed, _ln(found.error / self.centre_trial.error) - change.error)
            reach = max(1, reach // 2)
        better = [point for point in self._probes(self.centre) if self._is_better(point)]
        if better:
            self._set_centre(min(better, key=self._rank))
        return bool(better)

    def _options_by_knob(self) -> list[list[Option]]:
        """Return for each knob the values within MAX_SHIFT, with predicted changes; the centre's value is the first."""
        out = []
        for k, knob in enumerate(self.knobs):
            options = [Option(self.centre[k], 0.0, 0.0)]
            for point in self._probes(self.centre):
                rung, change = point[k], self._change_from_centre(point)
                if rung == self.centre[k] or change is None:
                    continue
                if knob.is_choice:
                    options.append(Option(rung, change.error, change.cost))
                    continue
                way = 1 if rung > self.centre[k] else -1
                for half in range(knob.stride, MAX_SHIFT + 1, knob.stride):
                    there = self.centre[k] + way * half
                    if knob.lowest <= there <= knob.highest:
                        share = half / UNITS_PER_RUNG
                        bent = share ** (CURVATURE if change.error > 0.0 else 1.0 / CURVATURE)
                        options.append(Option(there, change.error * bent, change.cost * share))
            out.append(options)
        return out

    def _predicted_point(self, options: list[list[Option]], reach: int, missed: float) -> tuple[GridPoint, Option]:
        """Return the point that minimises the cost under eq. (1), and its predicted change.

        The result is the centre if the predicted gain is too small.

        options: from `_options_by_knob`. reach: largest change of the entry of a number. missed: amount by which an
        earlier prediction of ln error was too small; this amount is added to the prediction.
        """
        options = [
            [o for o in each if knob.is_choice or abs(o.rung - each[0].rung) <= reach]
            for knob, each in zip(self.knobs, options, strict=True)
        ]
        slack = math.log(self.aim) - _ln(self.centre_trial.error) - missed
        most = math.inf if slack >= 0.0 else 1.0 / (0.8 * self.rate)  # slightly above the price of the best knob
        price = 0.02
        while True:
            chosen = [
                min(each, key=lambda o: o.cost + price * o.error + (1e-3 if o is not each[0] else 0.0))
                for each in options
            ]
            change = _sum_of_changes(chosen)
            if change.error <= slack or (price >= most and change.error < 0.0) or price >= MAX_LAMBDA:
                break
            price *= 1.2
        if slack >= 0.0:
            chosen = _spend_slack(chosen, options, slack)
            change = _sum_of_changes(chosen)
        point = tuple(o.rung for o in chosen)
        # Predictions are uncertain: a move must gain at least MIN_GAIN.
        worth = -change.cost if slack >= 0.0 else -change.cost - change.error * max(most, price)
        gains = worth > MIN_GAIN and self.runner.is_valid(point)
        return (point, change) if gains else (self.centre, Option(0, 0.0, 0.0))

    def _move_two_rungs(self) -> bool:
        """Run the point two rungs along the most promising knob, in case noise hides the gain of a single rung.

        If the error of this point is smaller, it becomes the centre. Returns whether it became the centre.
        """
        likely: list[tuple[float, GridPoint]] = []
        for point in self._probes(self.centre):
            found, (k, rung) = self.trial_at(point), self._changed_knob(point)
            there = with_rung(point, k, 2 * rung - self.centre[k])
            if found and not self.knobs[k].is_choice and self.knobs[k].lowest <= there[k] <= self.knobs[k].highest:
                gain, cost = -_ln(found.error / self.centre_trial.error), _ln(found.cpu / self.centre_trial.cpu)
                if gain > 0.0 and self.runner.is_valid(there):
                    likely.append((gain / max(cost, self.cost_noise), there))
        if not likely:
            return False
        best = max(likely)[1]
        self.runner.run([best], most=4.0 * COST_FACTOR_LIMIT * self.centre_trial.cpu + EXTRA_SECONDS)
        change = self._change_from_centre(best)
        if change is None or change.error >= 0.0 or best in self.visited:
            return False
        self._set_centre(best)
        return True

    def _refine_all(self) -> bool:
        """Run the point with all numbers one rung finer, in case no knob gains by itself.

        If the error of this point is smaller, it becomes the centre. Returns whether it became the centre.
        """
        finer = tuple(
            rung if knob.is_choice else min(knob.highest, rung + UNITS_PER_RUNG)
            for rung, knob in zip(self.centre, self.knobs, strict=True)
        )
        if finer == self.centre or not self.runner.is_valid(finer):
            return False
        self.runner.run([finer], most=4.0 * COST_FACTOR_LIMIT * self.centre_trial.cpu + EXTRA_SECONDS)
        found = self.trial_at(finer)
        if found is None or _ln(found.error / self.centre_trial.error) > -self.margin:
            return False
        self._set_centre(finer)
        return True

    def _reset_knobs(self) -> None:
        """Set knobs one by one to the value in the scene, if the error stays within `aim` at about the same cost."""
        for k in range(len(self.knobs)):
            if self.centre_trial.error > self.aim or self.centre[k] == 0:
                continue
            back = with_rung(self.centre, k, 0)
            if not self.runner.is_valid(back) or self._costs_more_towards_scene(k):
                continue
            more = max(2.0 * MIN_GAIN, self.cost_noise)
            self.runner.run([back], most=(1.0 + more) * self.centre_trial.cpu + EXTRA_SECONDS)
            found = self.trial_at(back)
            if found and found.error <= self.aim and _ln(found.cpu / self.centre_trial.cpu) < more:
                self._set_centre(back)

    def _costs_more_towards_scene(self, k: int) -> bool:
        """Return whether moving knob k by one rung towards the value in the scene costs more, beyond the noise."""
        way = UNITS_PER_RUNG if self.centre[k] < 0 else -UNITS_PER_RUNG
        change = self._change_from_centre(with_rung(self.centre, k, self.centre[k] + way))
        return not self.knobs[k].is_choice and change is not None and change.cost > max(2.0 * MIN_GAIN, self.cost_noise)

    # Comparison of points

    def _rank(self, point: GridPoint) -> tuple[int, float]:
        """Return a pair of numbers by which points are compared: the point with the smaller pair is better.

        (0, ln CPU time) if the error is at most `aim`; else (1, ln of the CPU time estimated for an error of `aim`);
        (2, inf) if the point has no results of runs.
        """
        found = self.trial_at(point)
        if found is None:
            return 2, math.inf
        if found.error <= self.aim:
            return 0, _ln(found.cpu)
        return 1, _ln(found.cpu) + _ln(found.error / self.aim) / (0.8 * self.rate)

    def _is_better(self, point: GridPoint) -> bool:
        """Return whether a point is better than the centre; errors that differ only by noise count as equal."""
        if point == self.centre or self.trial_at(point) is None:
            return False
        (level, now), (other, then) = self._rank(self.centre), self._rank(point)
        if other != level:
            return other < level
        change = self._change_from_centre(point)
        assert change is not None
        if level == 0:
            return then < now - MIN_GAIN and change.cost < 0.0
        # Never to a larger error: as the price of an error changes, the search could cycle.
        return (
            point not in self.visited
            and change.error <= MIN_ERROR_NOISE
            and change.cost + change.error / (0.8 * self.rate) < -MIN_GAIN
        )

    def _set_centre(self, point: GridPoint) -> None:
        """Move the centre to a point, and print its error and CPU time."""
        self.visited.add(self.centre)
        self.centre = point
        here = self.centre_trial
        self.say(f"  centre: error {here.error:.2g} in {here.cpu:.3g} s of CPU")

    def _compare_finalists(self, good: list[GridPoint]) -> Trial | None:
        """Run the cheapest of the points `good` with several seeds, and move the centre to the best of them.

        The first of `good` sets the limit of the cost. Returns the cheapest trial whose mean error is at most the goal,
        of equally cheap trials the one that changes the fewest knobs of the scene. Returns None if there is no such
        trial.
        """
        most = MAX_FINALIST_COST * self.runner.trials[good[0]].cpu
        points = [point for point in dict.fromkeys(good) if self.runner.trials[point].cpu <= most][:MAX_FINALISTS]
        scene = tuple(0 for _ in self.knobs)  # finalists are compared with the unchanged scene
        self.runner.run(list(dict.fromkeys([*points, scene])), self.repeat)
        held = [t for t in map(self.trial_at, points) if t and t.error <= self.goal]
        if not held:
            return None
        least = min(t.cpu for t in held)
        best = min(
            (t for t in held if t.cpu <= (1.0 + MIN_GAIN) * least),
            key=lambda t: (_changed_knobs(scene, t.point), t.cpu),
        )
        self.centre = best.point
        return best


def _sum_of_changes(chosen: list[Option]) -> Option:
    """Return the sums of dE and dC over one option per knob."""
    return Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))


def _spend_slack(chosen: list[Option], options: list[list[Option]], slack: float) -> list[Option]:
    """Replace options in `chosen`, one per knob, by cheaper ones while the sum of dE stays below `slack`; return them.

    This uses slack that remains because a single lambda changes two equal knobs only together.
    """
    chosen = list(chosen)
    for k, each in enumerate(options):
        left = slack - sum(o.error for o in chosen) + chosen[k].error
        best = min((o for o in each if o.error <= left), key=lambda o: o.cost, default=chosen[k])
        chosen[k] = best if best.cost < chosen[k].cost - MIN_GAIN else chosen[k]
    return chosen


def _changed_knobs(scene: GridPoint, point: GridPoint) -> int:
    """Return the number of knobs in which two points differ."""
    return sum(rung != own for rung, own in zip(point, scene, strict=True))


def _ln(value: float) -> float:
    return math.log(max(value, 1e-300))

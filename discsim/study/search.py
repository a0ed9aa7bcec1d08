"""Search for the least CPU time at a given error, from coarse settings, with local power laws of the knobs.

A place is a tuple with a rung for each knob, 0 for the scene's value. RUNG up is one step finer for a number. The
rungs of a choice are its values. At the centre every knob is probed one rung in each direction (`look`), which gives

    dE_k = ln(error / error of the centre),   dC_k = ln(CPU time / that of the centre)

Between and beyond probes both follow power laws of the knob; dE is slightly curved, because errors of several knobs
add up. Knobs are taken as independent. So the place with the least sum dC_k + lambda sum dE_k is found knob by knob,
with the least lambda for which

    sum dE_k <= ln(goal / error of the centre)                                                     (1)

If no place within reach satisfies (1), lambda is the price of accuracy at the centre: 1 / (gain of the best knob in
ln error per ln CPU). The place found with this lambda is run. If it is better than the centre, it becomes the next
centre; if not, the reach is halved. The search ends when no move is worth GAIN. Finally the best candidates are run
with several seeds, and their means decide.

A gain must exceed twice the scatter between seeds. A knob without effect therefore stays unchanged, and a knob that
only costs is lowered. This module does not make runs itself; tests use synthetic ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from statistics import stdev
from typing import NamedTuple

from discsim.study.trials import RUNG, Bench, Knob, Place, Trial

REACH = 2 * RUNG  # largest distance of a move along a knob
GAIN = 0.05  # least gain in ln CPU of a move
STEADY = 0.07  # least noise of ln CPU
CHEAPER_FINER = 4.0  # times the noise: a finer, no more accurate place is cheaper only by more than this
LEAST_MARGIN = 0.01  # noise of ln error without scatter between seeds
CURVED = 1.3  # dE grows as distance^CURVED where it rises, distance^(1/CURVED) where it falls: errors add up
SEEDS = 5  # seeds of the first place, whose scatter measures the noise
HOPELESS = math.log(2.0)  # ln price above which a choice is not probed again
USUAL_GAIN = 0.5  # gain in ln error per ln CPU before the first probes
TRIES, ROUNDS = 4, 40
DEAREST = 1e3  # largest lambda
RAISED, SHARPER = 20, 0.95  # how often the aim is lowered if means over seeds miss the goal; factor
CAP, SPARE = 10.0, 0.5  # a run is given up after CAP times the centre's CPU time plus SPARE seconds
NEAR, MOST_FINALISTS = 1.3, 3  # largest CPU time of finalists over the cheapest; their number


class Option(NamedTuple):
    """A rung of a knob, with its changes dE and dC from the centre."""

    rung: int
    error: float  # dE
    cost: float  # dC


class Search:
    """A search for the error `goal` from the coarse place `start`.

    `bench` makes the runs. `centre` is the best place so far.
    """

    def __init__(
        self,
        knobs: Sequence[Knob],
        bench: Bench,
        goal: float,
        start: Place,
        say: Callable[[str], None],
        repeat: int = 3,
    ) -> None:
        self.knobs, self.bench, self.goal, self.say, self.repeat = knobs, bench, goal, say, repeat
        self.aim = goal  # goal of single runs, lowered if means over seeds exceed the goal
        self.centre = start
        self.noise = 0.0  # twice the scatter of ln error between seeds
        self.steady = STEADY  # twice the scatter of ln CPU
        self.seeds = 1  # seeds of each probe
        self.rate = USUAL_GAIN
        self.been: set[Place] = set()  # earlier centres
        self.hopeless: set[tuple[int, int]] = set()

    def at(self, place: Place) -> Trial | None:
        """Return the trial of a place; None without runs."""
        trial = self.bench.trials.get(place)
        return trial if trial and trial.runs else None

    @property
    def here(self) -> Trial:
        """The trial of the centre."""
        return self.bench.trials[self.centre]

    @property
    def margin(self) -> float:
        """The noise of ln error of probes; smaller gains do not count."""
        return max(LEAST_MARGIN, self.noise / math.sqrt(self.seeds))

    def done(self) -> list[Trial]:
        """Return the trials with runs."""
        return [trial for trial in self.bench.trials.values() if trial.runs]

    def run(self) -> Trial | None:
        """Return the cheapest trial that reaches the goal; None if the search found none. Raises BudgetError."""
        if not self._begin():
            return None
        if self.here.scatter > 0.0:
            self.bench.run([self.centre], SEEDS)
        self.noise = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
        times = [_ln(run.cpu) for run in self.here.runs]
        self.steady = max(STEADY, 2.0 * stdev(times) if len(times) > 1 else 0.0)
        for _ in range(RAISED):
            self._descend()
            if self.here.error > self.aim:
                break
            self._plain()
            found = self._finals([self.centre, *self._good()])
            if found is not None:
                return found
            self.aim *= SHARPER
        self.aim = self.goal
        groups = [[place] for place in self._good()[:TRIES]]  # places whose error so far is below the goal
        return next((found for found in map(self._finals, groups) if found), None)

    def _begin(self) -> bool:
        """Run the start, or if it fails the place half way to the scene, and so on.

        Returns False if the scene itself gives no result.
        """
        while True:
            if self.bench.allowed(self.centre):
                self.bench.run([self.centre], self.repeat)
                if self.at(self.centre):
                    return True
            if not any(self.centre):
                return False
            self.centre = tuple(int(rung / 2) for rung in self.centre)

    def _good(self) -> list[Place]:
        """Return the places whose error is at most the aim, the cheapest first."""
        return [t.place for t in sorted(self.done(), key=lambda t: t.cpu) if t.error <= self.aim]

    # Moves

    def _descend(self) -> None:
        """Move the centre until no move gains enough."""
        for _ in range(ROUNDS):
            self.look()
            if self._step():
                self.seeds = 1
            elif self.here.error <= self.aim:
                return
            elif self._further():
                self.seeds = 1
            elif self.noise > LEAST_MARGIN and self.seeds < self.repeat:
                self.seeds += 1  # more seeds reduce the noise, which may hide gains
            elif not self._all_finer():
                return

    def look(self) -> None:
        """Probe every knob one rung in each direction, and every value of a choice."""
        near = list(self._near(self.centre))
        self._measure_noise()
        self.bench.run(near, self.seeds, CAP * self.here.cpu + SPARE)
        rates = []
        for place in near:
            change = self._change(place)
            if change and change.error < 0.0 < change.cost:
                rates.append(-change.error / change.cost)
        self.rate = min(max(rates, default=USUAL_GAIN), 4.0)
        for place in near:
            (knob, rung), change = self._moved(place), self._change(place)
            if self.knobs[knob].choice and (change is None or change.cost + change.error / self.rate > HOPELESS):
                self.hopeless.add((knob, rung))

    def _measure_noise(self) -> None:
        """Update the noise with the scatter at this centre, at a weight of 2/3; finer settings scatter less."""
        if self.noise > 0.0:
            self.bench.run([self.centre], self.repeat)
            own = 2.0 * self.here.scatter / max(self.here.error, 1e-300)
            self.noise = math.sqrt((2.0 * own**2 + self.noise**2) / 3.0)

    def _near(self, place: Place) -> Iterator[Place]:
        """Yield the allowed neighbours of a place that `look` probes."""
        for k, knob in enumerate(self.knobs):
            if knob.choice:
                rungs = [r for r in range(knob.lowest, knob.highest + 1) if (k, r) not in self.hopeless]
            else:
                rungs = [r for r in (place[k] - RUNG, place[k] + RUNG) if knob.lowest <= r <= knob.highest]
            for rung in rungs:
                there = (*place[:k], rung, *place[k + 1 :])
                if rung != place[k] and self.bench.allowed(there):
                    yield there

    def _moved(self, place: Place) -> tuple[int, int]:
        """Return the knob in which a place differs from the centre, and its rung."""
        k = next(k for k, rung in enumerate(place) if rung != self.centre[k])
        return k, place[k]

    def _change(self, place: Place) -> Option | None:
        """Return the change of error and cost from the centre, with changes below the noise set to 0."""
        there, here = self.at(place), self.here
        if there is None:
            return None
        error, cost = _ln(there.error / here.error), _ln(there.cpu / here.cpu)
        error = 0.0 if -self.margin < error < 0.0 else error
        finer = any(r > own and not k.choice for r, own, k in zip(place, self.centre, self.knobs, strict=True))
        least = self.steady * (CHEAPER_FINER if finer and error >= 0.0 and cost < 0.0 else 1.0)
        return Option(0, error, 0.0 if abs(cost) < least else cost)

    def _step(self) -> bool:
        """Run up to TRIES predicted places; return whether one of them, or a probe, became the new centre."""
        options, reach, missed = self._options(), REACH, 0.0
        for _ in range(TRIES):
            target, change = self._target(options, reach, missed)
            if target == self.centre:
                break
            if self.at(target) is None:
                self.bench.run([target], most=3.0 * self.here.cpu * math.exp(change.cost) + SPARE)
            if self._better(target):
                self._go(target)
                return True
            found = self.at(target)
            if found is not None:
                missed = max(missed, _ln(found.error / self.here.error) - change.error)
            reach = max(1, reach // 2)
        better = [place for place in self._near(self.centre) if self._better(place)]
        if better:
            self._go(min(better, key=self._merit))
        return bool(better)

    def _options(self) -> list[list[Option]]:
        """Return for each knob the rungs within REACH with their predicted changes."""
        out = []
        for k, knob in enumerate(self.knobs):
            options = [Option(self.centre[k], 0.0, 0.0)]
            for place in self._near(self.centre):
                rung, change = place[k], self._change(place)
                if rung == self.centre[k] or change is None:
                    continue
                if knob.choice:
                    options.append(Option(rung, change.error, change.cost))
                    continue
                way = 1 if rung > self.centre[k] else -1
                for half in range(knob.stride, REACH + 1, knob.stride):
                    there = self.centre[k] + way * half
                    if knob.lowest <= there <= knob.highest:
                        share = half / RUNG
                        bent = share ** (CURVED if change.error > 0.0 else 1.0 / CURVED)
                        options.append(Option(there, change.error * bent, change.cost * share))
            out.append(options)
        return out

    def _target(self, options: list[list[Option]], reach: int, missed: float) -> tuple[Place, Option]:
        """Return the place that minimises cost under eq. (1) within `reach`, and its predicted change.

        `missed` is added to the predicted ln error, after an earlier prediction that was too optimistic.
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
            if change.error <= slack or (price >= most and change.error < 0.0) or price >= DEAREST:
                break
            price *= 1.2
        if slack >= 0.0:
            chosen = _filled(chosen, options, slack, reach, self.knobs)
            change = Option(0, sum(o.error for o in chosen), sum(o.cost for o in chosen))
        place = tuple(o.rung for o in chosen)
        # Predictions are uncertain: a move must gain at least GAIN.
        worth = -change.cost if slack >= 0.0 else -change.cost - change.error * max(most, price)
        return (place, change) if worth > GAIN and self.bench.allowed(place) else (self.centre, Option(0, 0.0, 0.0))

    def _further(self) -> bool:
        """Run the most promising probe a rung further, if noise hides all gains.

        Returns whether that place is better; it is then the new centre.
        """
        likely: list[tuple[float, Place]] = []
        for place in self._near(self.centre):
            found, (k, rung) = self.at(place), self._moved(place)
            there = (*place[:k], 2 * rung - self.centre[k], *place[k + 1 :])
            if found and not self.knobs[k].choice and self.knobs[k].lowest <= there[k] <= self.knobs[k].highest:
                gain, cost = -_ln(found.error / self.here.error), _ln(found.cpu / self.here.cpu)
                if gain > 0.0 and self.bench.allowed(there):
                    likely.append((gain / max(cost, self.steady), there))
        if not likely:
            return False
        best = max(likely)[1]
        self.bench.run([best], most=4.0 * CAP * self.here.cpu + SPARE)
        change = self._change(best)
        if change is None or change.error >= 0.0 or best in self.been:
            return False
        self._go(best)
        return True

    def _all_finer(self) -> bool:
        """Run the place with all numbers a rung finer, if no knob gains by itself.

        Returns whether that place is better; it is then the new centre.
        """
        finer = tuple(
            rung if knob.choice else min(knob.highest, rung + RUNG)
            for rung, knob in zip(self.centre, self.knobs, strict=True)
        )
        if finer == self.centre or not self.bench.allowed(finer):
            return False
        self.bench.run([finer], most=4.0 * CAP * self.here.cpu + SPARE)
        found = self.at(finer)
        if found is None or _ln(found.error / self.here.error) > -self.margin:
            return False
        self._go(finer)
        return True

    def _plain(self) -> None:
        """Reset, one by one, knobs that differ from the scene without a gain."""
        for k in range(len(self.knobs)):
            if self.here.error > self.aim or self.centre[k] == 0:
                continue
            back = (*self.centre[:k], 0, *self.centre[k + 1 :])
            if not self.bench.allowed(back) or self._dear(k):
                continue
            more = max(2.0 * GAIN, self.steady)
            self.bench.run([back], most=(1.0 + more) * self.here.cpu + SPARE)
            found = self.at(back)
            if found and found.error <= self.aim and _ln(found.cpu / self.here.cpu) < more:
                self._go(back)

    def _dear(self, k: int) -> bool:
        """Return whether a probe one rung towards the scene costs more."""
        way = RUNG if self.centre[k] < 0 else -RUNG
        change = self._change((*self.centre[:k], self.centre[k] + way, *self.centre[k + 1 :]))
        return not self.knobs[k].choice and change is not None and change.cost > max(2.0 * GAIN, self.steady)

    # Comparison of places

    def _merit(self, place: Place) -> tuple[int, float]:
        """Return a pair to minimise: (0, ln CPU time) if the aim is reached.

        Otherwise (1, ln of the estimated CPU time to reach the aim); (2, inf) without runs.
        """
        found = self.at(place)
        if found is None:
            return 2, math.inf
        if found.error <= self.aim:
            return 0, _ln(found.cpu)
        return 1, _ln(found.cpu) + _ln(found.error / self.aim) / (0.8 * self.rate)

    def _better(self, place: Place) -> bool:
        """Return whether a place is worth a move; errors that differ by noise count as equal."""
        if place == self.centre or self.at(place) is None:
            return False
        (level, now), (other, then) = self._merit(self.centre), self._merit(place)
        if other != level:
            return other < level
        change = self._change(place)
        assert change is not None
        if level == 0:
            return then < now - GAIN and change.cost < 0.0
        # Never to a larger error: as the price of an error changes, the search could cycle.
        return (
            place not in self.been
            and change.error <= LEAST_MARGIN
            and change.cost + change.error / (0.8 * self.rate) < -GAIN
        )

    def _go(self, place: Place) -> None:
        """Make a place the centre."""
        self.been.add(self.centre)
        self.centre = place
        here = self.here
        self.say(f"  centre: error {here.error:.2g} in {here.cpu:.3g} s of CPU")

    def _finals(self, good: list[Place]) -> Trial | None:
        """Run the first of the `good` places with several seeds; return the cheapest whose mean reaches the goal.

        Returns None if no mean reaches the goal.
        """
        most = NEAR * self.bench.trials[good[0]].cpu
        places = [place for place in dict.fromkeys(good) if self.bench.trials[place].cpu <= most][:MOST_FINALISTS]
        scene = tuple(0 for _ in self.knobs)  # finalists are compared with the unchanged scene
        self.bench.run(list(dict.fromkeys([*places, scene])), self.repeat)
        held = [t for t in map(self.at, places) if t and t.error <= self.goal]
        if not held:
            return None
        least = min(t.cpu for t in held)
        best = min(
            (t for t in held if t.cpu <= (1.0 + GAIN) * least), key=lambda t: (_moved_from(scene, t.place), t.cpu)
        )
        self.centre = best.place
        return best


def _filled(
    chosen: list[Option], options: list[list[Option]], slack: float, reach: int, knobs: Sequence[Knob]
) -> list[Option]:
    """Return the options with remaining slack spent knob by knob: a single price cannot separate two equal knobs."""
    chosen = list(chosen)
    for k, each in enumerate(options):
        left = slack - sum(o.error for o in chosen) + chosen[k].error
        within = (o for o in each if knobs[k].choice or abs(o.rung - each[0].rung) <= reach)
        best = min((o for o in within if o.error <= left), key=lambda o: o.cost, default=chosen[k])
        chosen[k] = best if best.cost < chosen[k].cost - GAIN else chosen[k]
    return chosen


def _moved_from(scene: Place, place: Place) -> int:
    """Return the number of knobs in which two places differ."""
    return sum(rung != own for rung, own in zip(place, scene, strict=True))


def _ln(value: float) -> float:
    return math.log(max(value, 1e-300))

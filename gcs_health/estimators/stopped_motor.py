"""A motor that has stopped, from its speed against the others': a verdict of its own.

Its effectiveness cannot be seen, since h_i = 0. The rule: below 25 % of hover speed for more than
50 ms, while every other rotor turns above that and they average more than 60 %, in a flight that was
under way. A rotor that never turned, one that is commanded off or low, and the single-rotor excitations
of a hand throw are not failures; but one that fell behind the others while it was commanded to turn as
they do has failed, even if a fault-tolerant controller orders it off before it stands. Only a command that came
since it was slow tells: one before may be followed by the order that slowed it, where commands come seldom. Without
commands it must last longer: a hard roll or brake idles a rotor for a quarter of a second and more.

Source: sheet 1 section 7, step 8; the guards are this project's.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class StoppedConfig:
    """Thresholds of the rule."""

    stopped: float = 0.25  # of hover speed
    standing: float = 0.05  # of hover speed, where a loss elsewhere could idle this one unnamed
    others: float = 0.6  # of hover speed, mean of the others
    hold: float = 0.05  # s, where the commands say that it should turn
    hold_unasked: float = 0.4  # s, without commands: hard flying idles a rotor that long; this project
    asked: float = 0.5  # of the others' mean command; less is an order to turn slowly; this project
    as_others: float = 0.9  # of the others' mean command; this project
    more: float = 1.1  # likewise, of a controller that asks a rotor which fails for more; this project
    flying: float = 0.5  # s that the others must have flown before
    behind: float = (
        0.8  # of the others' mean speed; a motor that is commanded like them is not slower; this project
    )
    command_off: float = 0.02  # a command below this is an order to stand still


class StoppedMotor:
    """Fed the latest speeds with every rotor reading; names the rotor that stopped."""

    def __init__(self, rotors: int, config: StoppedConfig) -> None:
        self.config = config
        self.rotors = rotors
        self._turned = [False] * rotors
        self._low_since = [math.nan] * rotors
        self._flying_since = math.nan
        self._behind_since = [math.nan] * rotors  # the others
        self._fell = [False] * rotors  # behind the others, against its command
        self._some_behind = False
        self._commands_t = -math.inf
        self._all_turn = False  # every rotor reports, turns and was not low last time

    def feed(
        self,
        t: float,
        speeds: list[float],
        hover: float,
        commands: list[float],
        commands_t: float,
        judged: bool = True,
    ) -> int | None:
        """Take the latest speeds [rad/s], NaN = never reported; return a rotor that has stopped.

        `hover` [rad/s] may be infinite = not known. `commands` [-] are NaN where not known, and
        came at `commands_t`. `judged` = a lost propeller would have been named by now; if not, or if a rotor is
        silent, only standing still counts, since the controller idles the rotor opposite to a lost one.
        """
        c = self.config
        self._commands_t = commands_t
        total, least = sum(speeds), min(speeds)
        if least * len(speeds) < c.behind * total or self._some_behind:
            self._watch_falling(t, speeds, commands)
        if self._all_turn and least >= c.stopped * hover:  # by far the most frequent case
            if total > c.others * hover * len(speeds):
                if self._flying_since != self._flying_since:
                    self._flying_since = t
            else:
                self._flying_since = math.nan
            return None
        self._all_turn = False
        certain = judged and not any([speed != speed for speed in speeds])
        slow, total, count = self._sort(t, speeds, (c.stopped if certain else c.standing) * hover)
        if count < 3:
            return None
        if len(slow) == 1:
            total -= speeds[slow[0]]
            count -= 1
        if len(slow) > 1 or not total > c.others * hover * count:
            self._flying_since = math.nan
            return None
        if self._flying_since != self._flying_since:
            self._flying_since = t
        if not slow:
            self._all_turn = count == self.rotors
            return None
        return slow[0] if self._has_stopped(t, slow[0], commands) else None

    def _watch_falling(self, t: float, speeds: list[float], commands: list[float]) -> None:
        """Note rotors that fall behind the others while commanded as they are, and those that are back."""
        c = self.config
        total, count = sum(speeds), len(speeds)
        self._some_behind = False
        for i, speed in enumerate(speeds):
            mean = (total - speed) / (count - 1)
            if not speed < c.behind * mean:
                self._behind_since[i] = math.nan
                self._fell[i] = False
                continue
            self._some_behind = True
            if self._behind_since[i] != self._behind_since[i]:
                self._behind_since[i] = t
            told = self._asked(i, commands, c.as_others, self._behind_since[i])
            # or asked for more than the others: nobody means to slow it
            self._fell[i] |= bool(told or self._asked(i, commands, c.more))

    def _has_stopped(self, t: float, rotor: int, commands: list[float]) -> bool:
        """Whether the one slow rotor once turned, is to turn, and has been slow long enough in flight."""
        c = self.config
        if not self._turned[rotor]:
            return False
        if commands[rotor] < c.command_off and not self._fell[rotor]:
            return False
        asked = self._fell[rotor] or self._asked(rotor, commands, c.asked, self._low_since[rotor])
        if asked is False:  # None = nobody knows
            return False
        long_enough = t - self._low_since[rotor] > (c.hold if asked else c.hold_unasked)
        flew_before = self._low_since[rotor] - self._flying_since > c.flying
        return long_enough and flew_before

    def _asked(
        self, rotor: int, commands: list[float], least: float, since: float = -math.inf
    ) -> bool | None:
        """Whether a command after `since` [s] is `least` of the others' mean; None where commands do not tell."""
        others = sum(commands) - commands[rotor]
        share = commands[rotor] * (self.rotors - 1)
        if share != share or others != others:
            return None
        if share < least * others:
            return False
        return True if self._commands_t > since else None

    def _sort(self, t: float, speeds: list[float], low: float) -> tuple[list[int], float, int]:
        """Return the slow rotors, the sum of all speeds and how many report."""
        slow = []
        total = 0.0
        count = 0
        for i, speed in enumerate(speeds):
            if speed != speed:
                continue
            total += speed
            count += 1
            if speed < low:
                slow.append(i)
                if self._low_since[i] != self._low_since[i]:
                    self._low_since[i] = t
            else:
                self._turned[i] = True
                self._low_since[i] = math.nan
        return slow, total, count

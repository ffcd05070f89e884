"""What may pass from the registers to the machine, and when. Knows neither HAL nor Modbus.

    loaded ──► what LinuxCNC has as its offset is what the registers begin with, so nothing moves

                   machine on and homed,            heartbeat still
    ┌──────────┐   not in joint mode   ┌─────────┐      3 s       ┌─────────┐
    │  WAITS   │ ────────────────────► │ TAKING  │ ─────────────► │  HOLDS  │
    │ nothing  │ ◄──────────────────── │ follows │ ◄───────────── │ nothing │
    │  moves   │     otherwise         │         │   it counts    │  moves  │
    └──────────┘                       └─────────┘                └─────────┘
         ▲                                  ▲                          │ 10 s more: registers to zero
         │ machine off:                     │ at zero, and             ▼
         │ registers to zero                │ it counts           ┌─────────┐
         └── from every state               └──────────────────── │  RAMPS  │ count by count to zero
                                                                  └─────────┘

Only in TAKING is a new offset accepted (in HOLDS too, where the write counts). In every state a write is accepted that
leaves the offsets as the registers have them: so the heartbeat goes on, and the gateway can be told why it has to wait.

LinuxCNC adds up the changes of its counts and begins with none at every machine-on. So the counts are never set back:
`base` is what they were when its sum was zero, and a register is the difference. That way nothing that happens between
two looks at the machine can move an axis.
"""

from dataclasses import dataclass, field

BLOCK = 11
HEARTBEAT, CONTROL, VERSION, SEQUENCE, COMPLEMENT = 0, 1, 2, 3, 10
LAYOUT = 1
PLACES = {"x": 4, "y": 6, "z": 8}

MICROMETRE = 10
"""Counts."""

LOST_AFTER = 5
"""LinuxCNC takes a change in its next servo period; one that it has not taken after so many of them is lost."""

REFUSES_AFTER_A_GAP = 0.2
"""As long as it takes to answer, with a refusal, what was waiting, in seconds."""


@dataclass
class Axis:
    """One axis as the control has it, in counts of 0.1 µm."""

    applied: float = 0.0
    requested: float = 0.0
    machine: float = 0.0
    programmed: float = 0.0


@dataclass
class Machine:
    """One look at the control."""

    on: bool = False
    homed: bool = False
    joint_mode: bool = False
    limited: bool = False
    estop: bool = False
    running: bool = False
    spindle: float = 0.0
    servo: int = 0
    """How long the last servo period took: it changes with every one."""
    axes: dict = field(default_factory=dict)


@dataclass
class Rules:
    """What the integrator decides. Lengths in counts, times in seconds."""

    limit: int
    step: int
    watchdog: float
    hold: float
    ramp: float
    late: float


class Refused(Exception):
    """A write that changes nothing; the text says why."""


class Gate:
    """Holds the registers and the counts that LinuxCNC is to have."""

    def __init__(self, rules, machine, counts, now, say):
        self.rules, self.machine, self.counts, self.say = rules, machine, dict(counts), say
        self.words = [0] * BLOCK
        self.base = dict(counts)
        self.target = {axis: 0 for axis in counts}
        self.periods = 0
        self.next_count = now
        self.refused = 0
        self.complaint = None
        self.looked = now
        self.refuses_until = now
        # Never yet, unless there is an offset that somebody has to look after.
        self.beat = None
        self.ramping = self.cleared = self.expired = False
        self.state = None
        if machine.on:
            self.continue_from_the_control()
        if any(self.target.values()):
            self.beat = now
            say("loaded while offsets stand: " + self.offsets())
        self.look(machine, now)

    # What the machine does -----------------------------------------------------------------------------------------

    def look(self, machine, now):
        """To be called often, and before every answer."""
        self.notice_a_gap(now)
        was, self.machine = self.machine, machine
        if not machine.on:
            self.base = dict(self.counts)
            if was.on:
                self.clear()
            self.ramping = False
            self.periods = 0
        else:
            self.periods += machine.servo != was.servo
            self.compare_with_the_control()
        self.watch(now)
        self.advance(now)
        if machine.limited and not was.limited:
            self.say("an axis with its offset is at a soft limit (motion.eoffset-limited)")
        if was.limited and not machine.limited:
            self.say("no axis is at a soft limit any more")
        state = self.name()
        if state != self.state:
            self.state = state
            self.say(state)

    def notice_a_gap(self, now):
        gap, self.looked = now - self.looked, now
        if gap > self.rules.late:
            self.refuses_until = now + REFUSES_AFTER_A_GAP
            if self.beat is not None:
                self.beat += gap
            self.say(f"stood still for {gap:.1f} s: writes that came meanwhile are refused")

    def compare_with_the_control(self):
        """LinuxCNC drops changes while it is off or not homed; what it has is what counts."""
        if self.is_taken() or self.periods < LOST_AFTER:
            return
        self.clear()
        self.continue_from_the_control()
        self.say("the control has other offsets than it was given, as after machine off and on: now " + self.offsets())

    def continue_from_the_control(self):
        for axis, counts in self.counts.items():
            has = round(self.machine.axes[axis].requested)
            self.base[axis] = counts - has
            if not self.ramping:
                self.target[axis] = has
                self.words[PLACES[axis] : PLACES[axis] + 2] = words_of(has)

    def watch(self, now):
        silent = 0.0 if self.beat is None else now - self.beat
        self.expired = silent > self.rules.watchdog
        if not self.expired:
            self.cleared = False
        elif silent > self.rules.watchdog + self.rules.hold and not self.cleared:
            self.cleared = True
            self.clear()
            if self.stands():
                self.ramping = True
                self.next_count = now

    def advance(self, now):
        """Gives LinuxCNC the next change, where it has taken the last: a servo period that comes late finds one, not many."""
        if self.ramping and not self.stands():
            self.ramping = False
        if not self.follows() or not self.is_taken():
            return
        step = self.rules.step
        if self.ramping:
            if now < self.next_count:
                return
            # One at a time, whatever the clock says.
            self.next_count = max(self.next_count + 1 / self.rules.ramp, now)
            step = 1
        for axis in self.counts:
            move = max(-step, min(step, self.target[axis] - self.commanded(axis)))
            if move:
                self.counts[axis] += move
                self.periods = 0

    # What it knows -------------------------------------------------------------------------------------------------

    def commanded(self, axis):
        return self.counts[axis] - self.base[axis]

    def is_taken(self):
        return all(abs(self.machine.axes[axis].requested - self.commanded(axis)) < 0.5 for axis in self.counts)

    def stands(self):
        return any(self.commanded(axis) for axis in self.counts)

    def follows(self):
        return self.machine.on and self.machine.homed and not self.machine.joint_mode

    def taking(self):
        return self.follows() and not self.expired and not self.ramping

    def name(self):
        if self.machine.estop:
            return "emergency stop: the registers are zero"
        if not self.machine.on:
            return "machine off: the registers are zero"
        ramps = "ramping to zero, " if self.ramping else ""
        if not self.machine.homed:
            return ramps + "not homed: offsets wait"
        if self.machine.joint_mode:
            return ramps + "joint mode: offsets wait"
        if self.ramping:
            return "no heartbeat: the offsets go back to zero"
        if self.expired:
            return "no heartbeat: the offsets stay as they are" if self.stands() else "no heartbeat"
        return "takes offsets"

    def offsets(self):
        return ", ".join(f"{axis.upper()} {self.commanded(axis) / MICROMETRE:+.1f} µm" for axis in self.counts)

    def clear(self):
        self.words = [0] * BLOCK
        self.target = {axis: 0 for axis in self.counts}

    # What is written -----------------------------------------------------------------------------------------------

    def write(self, start, words, now):
        """Takes the whole block or raises Refused."""
        try:
            values = self.judge(start, words, now)
        except Refused as why:
            self.refused = (self.refused + 1) & 0xFFFF
            if str(why) != self.complaint:
                self.complaint = str(why)
                self.say(f"refused: {why}")
            raise
        self.complaint = None
        if self.beat is None or words[HEARTBEAT] != self.words[HEARTBEAT]:
            self.beat = now
        self.words = list(words)
        self.target = values
        self.watch(now)
        self.advance(now)

    def judge(self, start, words, now):
        if now < self.refuses_until:
            raise Refused("written while the component stood still")
        if start != 0 or len(words) != BLOCK:
            raise Refused(f"not the whole block: {len(words)} registers from {start}")
        if (words[COMPLEMENT] ^ sum(words[:COMPLEMENT])) & 0xFFFF != 0xFFFF:
            raise Refused("the complement does not fit")
        if words[VERSION] != LAYOUT:
            raise Refused(f"version {words[VERSION]} of the layout, this one is {LAYOUT}")
        if words[HEARTBEAT] > 0x7FFF:
            raise Refused(f"a heartbeat of {words[HEARTBEAT]}; it counts to 32767")
        last = self.words[SEQUENCE]
        if words[SEQUENCE] == 0 or last and words[SEQUENCE] != last % 0xFFFF + 1:
            raise Refused("not the next number of the sequence")
        beats = self.beat is None or words[HEARTBEAT] != self.words[HEARTBEAT]
        values = {}
        for axis, place in PLACES.items():
            value = signed(words[place : place + 2])
            if axis in self.counts:
                self.judge_offset(axis, value, beats)
                values[axis] = value
            elif value:
                raise Refused(f"{axis.upper()} is not among --axes")
        return values

    def judge_offset(self, axis, value, beats):
        stands, applied, letter = self.target[axis], self.machine.axes[axis].applied, axis.upper()
        if value == stands:
            return
        if not self.follows() or self.ramping:
            raise Refused(f"no new offset for {letter} now: {self.name()}")
        if self.expired and not beats:
            raise Refused(f"no new offset for {letter} without a heartbeat")
        if abs(value - stands) > self.rules.step:
            raise Refused(f"{letter} is to move further than --step at once")
        if abs(value) > self.rules.limit and abs(value) > abs(stands):
            raise Refused(f"{letter} is to go beyond --limit")
        # At a soft limit, or where the control is slow, it must not pile up what would come all at once.
        ahead = abs(value - applied)
        if ahead > 2 * self.rules.step and ahead > abs(stands - applied):
            raise Refused(f"{letter} does not follow: two steps ahead of what is applied")

    # What is read --------------------------------------------------------------------------------------------------

    def status(self):
        machine = self.machine
        return [
            machine.on, machine.homed, self.taking(), machine.limited,
            machine.estop, machine.running, self.expired, self.ramping,
        ]

    def inputs(self):
        machine = self.machine
        axes = [machine.axes.get(axis, Axis()) for axis in PLACES]
        # With the machine off LinuxCNC still shows the last ones, but the machine has none any more.
        shown = axes if machine.on else [Axis()] * len(axes)
        status = sum(bit << place for place, bit in enumerate(self.status()))
        words = [status, self.words[HEARTBEAT]]
        for values in (
            [axis.applied for axis in shown], [axis.requested for axis in shown],
            [axis.machine for axis in axes], [axis.programmed for axis in axes],
        ):
            for value in values:
                words += words_of(round(value))
        speed = max(-0x8000, min(0x7FFF, round(machine.spindle)))
        return words + [speed & 0xFFFF, self.refused, self.words[SEQUENCE]]


def words_of(value):
    value = max(-0x80000000, min(0x7FFFFFFF, value))
    return [value >> 16 & 0xFFFF, value & 0xFFFF]


def signed(words):
    value = words[0] << 16 | words[1]
    return value - 0x100000000 if value & 0x80000000 else value

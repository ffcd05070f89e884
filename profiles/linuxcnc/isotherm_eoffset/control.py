"""The control as seen through HAL: pins of ours, linked to those of LinuxCNC.

The component links its pins itself, for two reasons. A pin of LinuxCNC may be on a signal already, whose name only this
configuration knows. And it must be able to die: one that was killed stays in HAL with its pins, and its signals keep their
values, so the machine stands. The next one takes the place of the dead pin on the signal, with the same value.

In operation only linked pins are used. What looks a pin up by its name holds the lock of HAL for that time, and killed in
that moment would leave it locked for good.
"""

import subprocess

import hal

from .gate import Axis, Machine

NAME = "isotherm-eoffset"

FROM_THE_MACHINE = {
    "machine-on": (hal.HAL_BIT, "motion.motion-enabled"),
    "homed": (hal.HAL_BIT, "motion.is-all-homed"),
    "teleop-mode": (hal.HAL_BIT, "motion.teleop-mode"),
    "coord-mode": (hal.HAL_BIT, "motion.coord-mode"),
    "limited": (hal.HAL_BIT, "motion.eoffset-limited"),
    "servo-period": (hal.HAL_U32, "motion.servo.last-period"),
    "no-estop": (hal.HAL_BIT, "iocontrol.0.emc-enable-in"),
    "running": (hal.HAL_BIT, "halui.program.is-running"),
}
NOT_EVERYWHERE = {
    "no-estop": "status bit 4, emergency stop, stays 0",
    "running": "status bit 5, program running, stays 0; it needs HALUI = halui in [HAL]",
    "spindle-speed": "the spindle speed stays 0",
}


class Unusable(Exception):
    """This LinuxCNC cannot be worked with as it is; the text says why and what to do."""


class Pins:
    """All pins of HAL at one moment, as halcmd lists them."""

    def __init__(self):
        self.values, self.signals, self.owners = {}, {}, {}
        for line in halcmd("show", "pin"):
            owner, _, _, value, name, *link = line.split()
            self.values[name], self.owners[name] = value, owner
            if link:
                self.signals[name] = link[1]


class Control:
    """The machine's side of the component."""

    def __init__(self, axes, joints, spindle, unit, say):
        self.axes, self.unit, self.say = axes, unit, say
        self.name, dead = free_name()
        self.component = hal.component(self.name)
        self.before = Pins()
        for axis in axes:
            if f"axis.{axis}.eoffset-counts" not in self.before.values:
                raise Unusable(
                    f"there is no axis.{axis}.eoffset-counts: this machine has no axis {axis.upper()}, or motmod is not loaded yet"
                )
        self.let_go(dead)
        self.read, self.written = {}, {}
        for pin, (kind, source) in {**FROM_THE_MACHINE, "spindle-speed": (hal.HAL_FLOAT, spindle)}.items():
            self.take(pin, kind, source)
        for axis, joint in zip(axes, joints):
            self.take(f"{axis}-applied", hal.HAL_FLOAT, f"axis.{axis}.eoffset")
            self.take(f"{axis}-requested", hal.HAL_FLOAT, f"axis.{axis}.eoffset-request")
            self.take(f"{axis}-programmed", hal.HAL_FLOAT, f"axis.{axis}.pos-cmd")
            self.take(f"{axis}-machine", hal.HAL_FLOAT, f"joint.{joint}.pos-fb")
        for axis in axes:
            pin = f"axis.{axis}.eoffset-"
            scale = float(self.before.values[pin + "scale"])
            if scale and abs(scale / unit - 1) > 1e-6:
                raise Unusable(
                    f"{pin}scale is {scale:g} already, this component needs {unit:g}: "
                    "is --units right, and does nothing else use the offsets?"
                )
            self.give(f"{axis}-scale", hal.HAL_FLOAT, pin + "scale", unit)
            self.give(f"{axis}-enable", hal.HAL_BIT, pin + "enable", True)
            self.give(f"{axis}-counts", hal.HAL_S32, pin + "counts", int(self.before.values[pin + "counts"]))
        for pin in ("taking", "watchdog-expired", "ramping"):
            self.written[pin] = self.component.newpin(pin, hal.HAL_BIT, hal.HAL_OUT)
            # A lamp that hung on the dead one hangs on this one from now on.
            for name in dead:
                if signal := self.before.signals.get(f"{name}.{pin}"):
                    hal.connect(f"{self.name}.{pin}", signal)

    def ready(self):
        self.component.ready()

    def leave(self):
        self.component.exit()

    # In operation --------------------------------------------------------------------------------------------------

    def counts(self):
        return {axis: self.written[f"{axis}-counts"].get() for axis in self.axes}

    def look(self):
        values = {name: pin.get() for name, pin in self.read.items()}
        return Machine(
            on=values["machine-on"],
            homed=values["homed"],
            joint_mode=not (values["teleop-mode"] or values["coord-mode"]),
            limited=values["limited"],
            estop=not values.get("no-estop", True),
            running=values.get("running", False),
            spindle=values.get("spindle-speed", 0.0),
            servo=values["servo-period"],
            axes={
                axis: Axis(*(values[f"{axis}-{what}"] / self.unit for what in ("applied", "requested", "machine", "programmed")))
                for axis in self.axes
            },
        )

    def command(self, gate):
        for axis, counts in gate.counts.items():
            self.written[f"{axis}-counts"].set(counts)
        for pin, value in (("taking", gate.taking()), ("watchdog-expired", gate.expired), ("ramping", gate.ramping)):
            self.written[pin].set(value)

    # Links ---------------------------------------------------------------------------------------------------------

    def take(self, pin, kind, source):
        """A pin that reads one of LinuxCNC."""
        if source not in self.before.values:
            if pin not in NOT_EVERYWHERE:
                raise Unusable(f"there is no pin {source} in this LinuxCNC")
            self.say(f"there is no pin {source}: {NOT_EVERYWHERE[pin]}")
            return
        self.read[pin] = self.component.newpin(pin, kind, hal.HAL_IN)
        self.link(pin, kind, source)

    def give(self, pin, kind, sink, value):
        """A pin that drives one of LinuxCNC. It has its value before it is linked."""
        self.written[pin] = self.component.newpin(pin, kind, hal.HAL_OUT)
        self.written[pin].set(value)
        self.link(pin, kind, sink)

    def link(self, pin, kind, other):
        own = f"{self.name}.{pin}"
        signal = self.before.signals.get(other)
        if signal is None:
            signal = f"{NAME}-{pin}"
            # Its own pin first: so the signal has its value before the other one reads it.
            linked = not hal.new_sig(signal, kind) and not hal.connect(own, signal) and not hal.connect(other, signal)
        else:
            linked = not hal.connect(own, signal)
        if not linked:
            raise Unusable(
                f"{own} cannot be linked to {other} (signal {signal}): does something else drive it, or is HAL locked?"
            )

    def let_go(self, dead):
        """Takes the pins of components that have died off their signals; these keep their values."""
        for pin, owner in self.before.owners.items():
            if owner in dead and pin in self.before.signals:
                hal.disconnect(pin)


def free_name():
    """A name that no component has yet, and the dead ones among those that are called like this one."""
    names = {}
    for line in halcmd("show", "comp"):
        words = line.split()
        if words[2].startswith(NAME):
            names[words[2]] = int(words[3])
    for name, process in names.items():
        if is_alive(process):
            raise Unusable(f"{name} runs already, process {process}: end that one first")
    name, number = NAME, 2
    while name in names:
        name, number = f"{NAME}-{number}", number + 1
    return name, set(names)


def is_alive(process):
    """Its number may be another's by now."""
    try:
        with open(f"/proc/{process}/cmdline", "rb") as file:
            if b"isotherm-eoffset" not in file.read():
                return False
        with open(f"/proc/{process}/stat", encoding="utf-8", errors="replace") as file:
            return file.read().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False


def halcmd(*words):
    done = subprocess.run(["halcmd", "-s", *words], stdout=subprocess.PIPE, text=True, check=False, timeout=20)
    if done.returncode != 0:
        raise Unusable("halcmd does not answer: does LinuxCNC run?")
    return [line for line in done.stdout.splitlines() if line.strip()]

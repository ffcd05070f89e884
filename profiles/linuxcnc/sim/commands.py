"""What can be said to the simulated mill, one line each."""

import os
import shlex
import signal
import subprocess
import time

import hal
import linuxcnc
from simulation import Failed, reap

AXES = 3
# Seconds until a state of LinuxCNC is reached; on a busy computer it takes several.
PATIENCE = 60
COMMANDS = {}


def command(method):
    """The name of the method is that of the command, with `-` for `_`; its docstring the help."""
    COMMANDS[method.__name__.replace("_", "-")] = method
    return method


class Mill:
    """The simulated mill as somebody in front of it has it."""

    def __init__(self, simulation):
        self.simulation = simulation
        linuxcnc.nmlfile = os.path.join(simulation.directory, "mill.nml")
        self.task = linuxcnc.command()
        self.stat = linuxcnc.stat()
        self.errors = linuxcnc.error_channel()
        # To look at HAL from here; halcmd would be started each time.
        self.watcher = hal.component("headless")
        self.watcher.ready()
        self.ends = False
        self.looped = None
        self.sampler = None
        self.samples = None
        self.wait_for("no status of LinuxCNC", lambda stat: stat.joints == AXES)

    @command
    def help(self):
        """the commands"""
        texts = ((name, method.__doc__) for name, method in COMMANDS.items())
        return " | ".join(text if text.startswith(name) else f"{name}: {text}" for name, text in texts)

    @command
    def quit(self):
        """ends LinuxCNC and this program; so does the end of the standard input, where that is a pipe"""
        self.ends = True

    def leave(self):
        if self.sampler:
            self.sampler.terminate()
        self.watcher.exit()

    # The machine ---------------------------------------------------------------------------------------------------

    @command
    def on(self):
        """machine on"""
        self.set_state(linuxcnc.STATE_ON, lambda stat: stat.enabled, "the machine does not go on")

    @command
    def off(self):
        """machine off"""
        self.set_state(linuxcnc.STATE_OFF, lambda stat: not stat.enabled, "the machine does not go off")

    @command
    def estop(self):
        """emergency stop"""
        self.set_state(linuxcnc.STATE_ESTOP, lambda stat: stat.estop, "no emergency stop")

    @command
    def reset(self):
        """emergency stop released; the machine stays off"""
        self.set_state(linuxcnc.STATE_ESTOP_RESET, lambda stat: not stat.estop, "the emergency stop is not released")

    @command
    def home(self):
        """homes all axes and leaves joint mode"""
        self.set_mode(linuxcnc.MODE_MANUAL)
        self.task.teleop_enable(0)
        self.wait_for("no joint mode", lambda stat: stat.motion_mode == linuxcnc.TRAJ_MODE_FREE)
        self.task.home(-1)
        self.wait_for("not homed", lambda stat: all(stat.homed[:AXES]))
        self.teleop()

    @command
    def unhome(self):
        """forgets where the axes are; leaves the mill in joint mode"""
        self.joint()
        self.task.unhome(-1)
        self.wait_for("still homed", lambda stat: not any(stat.homed[:AXES]))

    @command
    def teleop(self):
        """manual mode that jogs axes; offsets act"""
        self.set_mode(linuxcnc.MODE_MANUAL)
        self.task.teleop_enable(1)
        self.wait_for("no teleop mode", lambda stat: stat.motion_mode == linuxcnc.TRAJ_MODE_TELEOP)

    @command
    def joint(self):
        """manual mode that jogs joints; offsets wait"""
        self.set_mode(linuxcnc.MODE_MANUAL)
        self.task.teleop_enable(0)
        self.wait_for("no joint mode", lambda stat: stat.motion_mode == linuxcnc.TRAJ_MODE_FREE)

    # Moves ---------------------------------------------------------------------------------------------------------

    @command
    def mdi(self, *words):
        """mdi BLOCK: runs one line of G-code and waits for its end"""
        self.set_mode(linuxcnc.MODE_MDI)
        self.task.mdi(" ".join(words))
        if self.task.wait_complete(60) != linuxcnc.RCS_DONE:
            raise Failed(self.complaint() or "the block did not end well")

    @command
    def run(self, file):
        """run FILE: runs a program again and again until `abort` or machine off (part.ngc is there)"""
        self.start_program(file)
        self.looped = file

    @command
    def run_once(self, file):
        """run-once FILE: runs a program, and does not wait for its end"""
        self.looped = None
        self.start_program(file)

    @command
    def pause(self):
        """feed hold of the program"""
        self.task.auto(linuxcnc.AUTO_PAUSE)
        self.wait_for("no pause", lambda stat: stat.paused)

    @command
    def resume(self):
        """goes on after `pause`"""
        self.task.auto(linuxcnc.AUTO_RESUME)
        self.wait_for("still paused", lambda stat: not stat.paused)

    @command
    def abort(self):
        """ends the program"""
        self.looped = None
        self.task.abort()
        self.wait_for("the program still runs", lambda stat: stat.interp_state == linuxcnc.INTERP_IDLE and stat.inpos)

    # Looking -------------------------------------------------------------------------------------------------------

    @command
    def get(self, pin):
        """get PIN: what a HAL pin, signal or parameter holds"""
        try:
            value = hal.get_value(pin)
        except RuntimeError as why:
            raise Failed(f"there is no {pin}") from why
        return str(value).upper() if isinstance(value, bool) else value

    @command
    def set(self, pin, value):
        """set PIN VALUE: sets a HAL pin that is not linked"""
        self.simulation.hal("setp", pin, value)

    @command
    def status(self):
        """what the machine does, in words"""
        self.stat.poll()
        now = self.stat
        return " ".join([
            "estop" if now.estop else "on" if now.enabled else "off",
            "homed" if all(now.homed[:AXES]) else "unhomed",
            {linuxcnc.TRAJ_MODE_FREE: "joint", linuxcnc.TRAJ_MODE_TELEOP: "teleop"}.get(now.motion_mode, "coordinated"),
            "idle" if now.interp_state == linuxcnc.INTERP_IDLE else "paused" if now.paused else "running",
        ])

    @command
    def errors_since(self):
        """what LinuxCNC complained of since the last time"""
        return self.complaint() or "none"

    @command
    def sample(self, what, file=None):
        """sample N FILE | sample start FILE | sample stop: records servo periods"""
        if what == "stop":
            return self.stop_sampler()
        if self.sampler:
            raise Failed("already recording")
        if file is None:
            raise Failed("which file?")
        count = [] if what == "start" else ["-n", str(int(what))]
        # halsampler prints itself what it is given; its own file option would leave the count of what was lost at its first line.
        self.samples = open(file, "w", encoding="ascii")
        self.sampler = subprocess.Popen(
            ["halsampler", *count], stdout=self.samples, stdin=subprocess.DEVNULL, env=self.simulation.environment
        )
        self.simulation.hal("setp", "sampler.0.enable", "1")
        if what != "start":
            self.sampler.wait()
            return self.stop_sampler()
        return None

    def stop_sampler(self):
        if not self.sampler:
            raise Failed("not recording")
        self.simulation.hal("setp", "sampler.0.enable", "0")
        if self.sampler.poll() is not None:
            # What came after the last line that was asked for would stand first in the next recording.
            rest = subprocess.Popen(["halsampler"], stdout=subprocess.DEVNULL, env=self.simulation.environment)
            self.empty()
            rest.terminate()
            rest.wait()
        else:
            self.empty()
            self.sampler.terminate()
            self.sampler.wait()
        self.sampler = None
        self.samples.close()
        return tidy(self.samples.name)

    def empty(self):
        end = time.monotonic() + PATIENCE
        while hal.get_value("sampler.0.curr-depth") and time.monotonic() < end:
            time.sleep(0.01)

    # The component -------------------------------------------------------------------------------------------------

    @command
    def kill_component(self):
        """ends the component without a chance to tidy up (SIGKILL)"""
        self.signal_component(signal.SIGKILL, ends=True)

    @command
    def stop_component(self):
        """ends the component in order (SIGTERM)"""
        self.signal_component(signal.SIGTERM, ends=True)

    @command
    def hang_component(self):
        """the component stands still (SIGSTOP)"""
        self.signal_component(signal.SIGSTOP)

    @command
    def resume_component(self):
        """the component goes on (SIGCONT)"""
        self.signal_component(signal.SIGCONT)

    @command
    def start_component(self):
        """loads the component anew, by the HAL file that an integrator uses"""
        if self.simulation.component():
            raise Failed("the component runs")
        self.simulation.load_component()

    def signal_component(self, kind, ends=False):
        process = self.simulation.component()
        if process is None:
            raise Failed("the component does not run")
        os.kill(process, kind)
        end = time.monotonic() + PATIENCE
        while ends and self.simulation.component() is not None:
            reap()
            if time.monotonic() > end:
                raise Failed("the component does not end")
            time.sleep(0.02)

    # What the commands are made of ---------------------------------------------------------------------------------

    def set_state(self, state, reached, otherwise):
        # LinuxCNC passes over a state while it still enters the one before; at a panel the key is pressed again.
        end = time.monotonic() + PATIENCE
        while True:
            self.task.state(state)
            self.task.wait_complete()
            try:
                return self.wait_for(otherwise, reached, seconds=2)
            except Failed:
                if time.monotonic() > end:
                    raise

    def set_mode(self, mode):
        # Refused as long as the last program is still coming to its end.
        end = time.monotonic() + PATIENCE
        while True:
            self.task.mode(mode)
            self.task.wait_complete()
            self.stat.poll()
            if self.stat.task_mode == mode:
                return
            if time.monotonic() > end:
                raise Failed(self.complaint() or "the mode does not change")
            time.sleep(0.05)

    def start_program(self, file):
        directory = self.simulation.directory
        self.set_mode(linuxcnc.MODE_AUTO)
        self.task.program_open(os.path.join(directory, os.path.expanduser(file)))
        self.task.wait_complete()
        self.task.auto(linuxcnc.AUTO_RUN, 0)
        self.wait_for("the program does not run", lambda stat: stat.interp_state != linuxcnc.INTERP_IDLE)

    def goes_on(self):
        """Called now and then: begins a looped program again."""
        if not self.looped:
            return
        self.stat.poll()
        if not self.stat.enabled:
            self.looped = None
        elif self.stat.interp_state == linuxcnc.INTERP_IDLE:
            self.start_program(self.looped)

    def wait_for(self, otherwise, reached, seconds=PATIENCE):
        end = time.monotonic() + seconds
        while True:
            try:
                self.stat.poll()
                if reached(self.stat):
                    return
            except linuxcnc.error:
                pass
            if time.monotonic() > end:
                raise Failed(self.complaint() or otherwise)
            time.sleep(0.01)

    def complaint(self):
        said = []
        while message := self.errors.poll():
            said.append(message[1].strip())
        return " / ".join(said)

    def answer(self, line):
        try:
            name, *arguments = shlex.split(line)
        except ValueError as why:
            return f"error {why}"
        if name not in COMMANDS:
            return f"error no command {name}; try help"
        try:
            said = COMMANDS[name](self, *arguments)
        except Failed as why:
            return f"error {one_line(why)}"
        except (TypeError, ValueError, OSError, linuxcnc.error, subprocess.SubprocessError) as why:
            return f"error {name}: {one_line(why)}"
        return f"ok {one_line(said)}" if said is not None else "ok"


def one_line(text):
    return " ".join(str(text).split())


def tidy(name):
    """Drops the word `overrun` that halsampler sets before the first line of all but the first recording."""
    with open(name, encoding="ascii") as file:
        lines = file.readlines()
    if lines and lines[0].startswith("overrun"):
        lines = lines[1:]
        with open(name, "w", encoding="ascii") as file:
            file.writelines(lines)
    lost = sum(line.startswith("overrun") for line in lines)
    return f"{len(lines) - lost} periods, {lost} times some were lost"

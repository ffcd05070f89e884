"""Starts LinuxCNC without a screen, in a directory of its own, and leaves nothing behind.

What the script `linuxcnc` does with a screen is done here by hand: io, halui, the HAL files, the task, `halcmd start`.
"""

import ctypes
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time

HERE = os.path.dirname(os.path.realpath(__file__))
COMPONENT = "isotherm-eoffset"
HAL_KEY = 0x48414C32
ANOTHER_UID = 65534
# Seconds until a part of LinuxCNC is up; on a busy computer it takes several.
PATIENCE = 60

PR_SET_CHILD_SUBREAPER = 36


class Failed(Exception):
    """Something did not work; the text says what."""


class Simulation:
    """One LinuxCNC with the simulated mill."""

    def __init__(self, arguments, port, with_component):
        if any(key == HAL_KEY for key, _ in shared("shm")):
            raise Failed("another LinuxCNC runs here; there can be one in each IPC namespace")
        # What the processes leave behind when they go into the background becomes a child of this one, and can be ended by its id.
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        self.before = {kind: shared(kind) for kind in ("shm", "sem")}
        self.directory = tempfile.mkdtemp(prefix="isotherm-mill-")
        self.ini = os.path.join(self.directory, "mill.ini")
        self.log = open(os.path.join(self.directory, "linuxcnc.log"), "w", encoding="utf-8")
        self.environment = dict(os.environ, INI_FILE_NAME=self.ini)
        try:
            self._lay_out(arguments, port, with_component)
            self._start()
        except BaseException:
            self.stop()
            raise

    def _lay_out(self, arguments, port, with_component):
        for name in os.listdir(HERE):
            if name.startswith("mill.") or name.endswith(".ngc"):
                shutil.copy(os.path.join(HERE, name), self.directory)
        with open(self.ini, encoding="utf-8") as file:
            lines = file.read().splitlines()
        if not with_component:
            lines = [line for line in lines if line != "HALFILE = isotherm.hal"]
        for place, line in enumerate(lines):
            if line.startswith("ARGUMENTS"):
                given = line.split("=", 1)[1] if arguments is None else arguments
                lines[place] = f"ARGUMENTS = {given.strip()} --address 127.0.0.1 --port {port}"
        with open(self.ini, "w", encoding="utf-8") as file:
            file.write("\n".join(lines) + "\n")
        parent = os.path.dirname(HERE)
        shutil.copy(os.path.join(parent, "isotherm.hal"), self.directory)
        # The component stays where it is: only what LinuxCNC writes to is copied.
        os.symlink(os.path.join(parent, COMPONENT), os.path.join(self.directory, COMPONENT))
        realtime = os.path.join(self.directory, "realtime")
        os.mkdir(realtime)
        self.environment["RTAPI_FIFO_PATH"] = os.path.join(realtime, "fifo")
        if os.getuid() == 0:
            # rtapi_app does not run for root: it is given a user of its own, who may write here.
            self.environment["RTAPI_UID"] = str(ANOTHER_UID)
            os.chmod(self.directory, 0o755)
            os.chown(realtime, ANOTHER_UID, -1)

    def _start(self):
        # It makes the buffers of NML, and goes into the background by itself.
        subprocess.run(["linuxcncsvr", "-ini", self.ini], cwd=self.directory, env=self.environment, check=True,
                       stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log, timeout=PATIENCE)
        self.hal("loadusr", "-Wn", "iocontrol", "io", "-ini", self.ini)
        self.hal("loadusr", "-Wn", "halui", "halui", "-ini", self.ini)
        with open(self.ini, encoding="utf-8") as file:
            files = [line.split("=")[1].strip() for line in file if line.startswith("HALFILE")]
        self.hal("loadrt", "tpmod")
        self.hal("loadrt", "homemod")
        for name in files:
            self.hal("-i", self.ini, "-f", name)
        # halcmd waits until the task is up, and the task until HAL runs.
        waiting = self.process("halcmd", "loadusr", "-Wn", "inihal", "milltask", "-ini", self.ini)
        self.hal("start")
        if waiting.wait(PATIENCE) != 0:
            raise Failed("milltask did not start: " + self.last_words())

    def process(self, *command):
        return subprocess.Popen(
            command, cwd=self.directory, env=self.environment, stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log
        )

    def hal(self, *command):
        """Runs halcmd and says what it says."""
        # Into a file: programs that halcmd loads keep its output open, and the end of a pipe would never come.
        with tempfile.TemporaryFile("w+") as said:
            done = subprocess.run(["halcmd", *command], cwd=self.directory, env=self.environment, check=False,
                                  stdin=subprocess.DEVNULL, stdout=said, stderr=self.log, timeout=PATIENCE)
            said.seek(0)
            text = said.read()
        if done.returncode != 0:
            raise Failed(f"halcmd {shlex.join(command)}: {self.last_words()}")
        return text

    def last_words(self):
        with open(self.log.name, encoding="utf-8", errors="replace") as file:
            lines = [line for line in file.read().split("\n") if line.strip() and not line.startswith("Running with")]
        return " / ".join(lines[-4:])

    # The component -------------------------------------------------------------------------------------------------

    def component(self, states=("ready", "initializing")):
        """The process id of the component that lives, or None."""
        for line in self.hal("-s", "show", "comp").splitlines():
            words = line.split()
            # id, type, name, process id, state
            if words and words[2].startswith(COMPONENT) and words[4] in states and is_alive(int(words[3])):
                return int(words[3])
        return None

    def load_component(self):
        self.hal("-i", self.ini, "-f", "isotherm.hal")
        end = time.monotonic() + PATIENCE
        while self.component(("ready",)) is None:
            if time.monotonic() > end:
                raise Failed("the component did not start: " + self.last_words())
            time.sleep(0.05)

    # The end -------------------------------------------------------------------------------------------------------

    def stop(self):
        for command in (("stop",), ("unload", "all")):
            try:
                self.hal(*command)
            except (Failed, OSError, subprocess.TimeoutExpired):
                pass
        end_children()
        for kind, flag in (("shm", "-m"), ("sem", "-s")):
            for _, number in shared(kind) - self.before[kind]:
                subprocess.run(["ipcrm", flag, str(number)], check=False, stderr=subprocess.DEVNULL)
        self.log.close()
        shutil.rmtree(self.directory, ignore_errors=True)


def shared(kind):
    """Keys and ids of the System V objects of this namespace."""
    with open(f"/proc/sysvipc/{kind}", encoding="ascii") as file:
        rows = [line.split() for line in file.readlines()[1:]]
    return {(int(row[0]) & 0xFFFFFFFF, int(row[1])) for row in rows}


def children():
    with open(f"/proc/self/task/{os.getpid()}/children", encoding="ascii") as file:
        return [int(word) for word in file.read().split()]


def reap():
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass


def end_children():
    """Asks every child to end, then those that became ours by it, and at last does not ask any more."""
    for kind, seconds in ((signal.SIGTERM, 5), (signal.SIGKILL, 2)):
        end = time.monotonic() + seconds
        asked = set()
        while time.monotonic() < end:
            reap()
            left = children()
            if not left:
                return
            for process in set(left) - asked:
                asked.add(process)
                os.kill(process, kind)
                os.kill(process, signal.SIGCONT)
            time.sleep(0.02)
    print(f"still running: {children()}", file=sys.stderr)


def is_alive(process):
    try:
        with open(f"/proc/{process}/stat", encoding="ascii", errors="replace") as file:
            return file.read().rsplit(")", 1)[1].split()[0] not in "ZX"
    except OSError:
        return False

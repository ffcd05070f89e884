"""A computer that is emulated by qemu, without KVM unless TEST_ACCEL=kvm says otherwise. Its steward carries out commands, and its power
can be cut."""

import base64
import os
import queue
import shutil
import socket
import subprocess
import threading
import time

# An emulated computer beside a busy test: nothing here is a matter of seconds.
PATIENCE = 600


class Computer:
    def __init__(self, directory, kernel, initrd, disk, parcel):
        self.directory, self.process = directory, None
        self.way = os.path.join(directory, "steward.sock")
        self.console = os.path.join(directory, "console")
        self.command = [
            "qemu-system-x86_64", "-machine", "pc", "-accel", os.environ.get("TEST_ACCEL", "tcg"), "-cpu", "Nehalem", "-m", "768",
            "-nodefaults", "-display", "none", "-no-reboot", "-kernel", kernel, "-initrd", initrd,
            "-append", "root=/dev/vda rw console=ttyS0 mitigations=off net.ifnames=0 module_blacklist=kvm,kvm_amd,kvm_intel,drm,floppy",
            "-serial", f"file:{self.console}", "-device", "virtio-rng-pci",
            "-drive", f"file={disk},if=virtio,format=raw,cache=writeback", "-drive", f"file={parcel},if=virtio,format=raw,readonly=on",
            "-netdev", "user,id=wire,restrict=off", "-device", "virtio-net-pci,netdev=wire",
            "-device", "virtio-serial-pci", "-chardev", f"socket,id=steward,path={self.way},server=on,wait=off",
            "-device", "virtserialport,chardev=steward,name=steward",
        ]

    def boot(self):
        """Switches it on; returns once its steward answers."""
        begun = time.monotonic()
        if os.path.exists(self.console):
            shutil.move(self.console, self.console + ".before")
        with open(os.path.join(self.directory, "qemu"), "ab") as said:
            self.process = subprocess.Popen(self.command, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        while True:
            try:
                self.socket = socket.socket(socket.AF_UNIX)
                self.socket.connect(self.way)
                break
            except OSError:
                if self.process.poll() is not None or time.monotonic() - begun > PATIENCE:
                    raise RuntimeError(f"qemu does not run: {open(os.path.join(self.directory, 'qemu')).read()}") from None
                time.sleep(0.1)
        self.answers = queue.Queue()
        threading.Thread(target=self.listen, args=(self.socket.makefile("r"), self.answers), daemon=True).start()
        self.heard(PATIENCE, "the computer to boot")
        return time.monotonic() - begun

    @staticmethod
    def listen(lines, answers):
        try:
            for line in lines:
                answers.put(line)
        except OSError:
            pass

    def heard(self, patience, what):
        try:
            return self.answers.get(timeout=patience)
        except queue.Empty:
            tail = open(self.console, errors="replace").read()[-3000:]
            raise RuntimeError(f"waited {patience} s for {what}; its console:\n{tail}") from None

    def tries(self, command, patience=PATIENCE):
        """Its exit code, and what it said."""
        self.asks(command)
        code, said = self.heard(patience, command).split(" ")
        return int(code), base64.b64decode(said).decode(errors="replace").rstrip("\n")

    def asks(self, command):
        """The answer is not waited for."""
        self.socket.sendall(base64.b64encode(command.encode()) + b"\n")

    def does(self, command, patience=PATIENCE):
        """What it said; it must have worked."""
        code, said = self.tries(command, patience)
        if code != 0:
            raise AssertionError(f"`{command}` ended with {code}:\n{said}")
        return said

    def is_cut_off(self):
        """As when its power fails: what it has not given to its disk is gone. What a disk forgets that was not asked to keep it is not
        tried: this one keeps all that it was given."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.socket.close()
            self.process = None

"""What the tests share: names of services, and the command `linkwatch` as a process."""

import os
import pathlib
import signal
import subprocess
import sysconfig
import time

import pytest

COMMAND = pathlib.Path(sysconfig.get_path("scripts")) / "linkwatch"

# Time limit of a wait that ends much earlier unless something failed.
PATIENCE = 60


def until(what, done):
    """Waits until `done` returns something, and returns it."""
    start = time.monotonic()
    while not (found := done()):
        assert time.monotonic() - start < PATIENCE, f"waited too long for {what}"
        time.sleep(0.01)
    return found


class Process:
    """A process with its output in files. It is killed when the test ends."""

    def __init__(self, args, folder, name):
        self.out, self.err = (folder / f"{name}.{stream}" for stream in ("out", "err"))
        with open(self.out, "wb") as out, open(self.err, "wb") as err:
            self.process = subprocess.Popen(
                [str(arg) for arg in args],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                # Ignored, and inherited, if the tests run in the background of a shell.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            )

    def signal(self, number):
        self.process.send_signal(number)

    def stop(self):
        """Sends SIGSTOP, and waits until the process has stopped."""
        self.signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED | os.WNOWAIT)

    def kill(self):
        """Sends SIGKILL, and waits until the process has ended."""
        self.process.kill()
        self.process.wait(PATIENCE)

    def end(self):
        """Waits for the end. Returns the exit code, stdout and stderr."""
        code = self.process.wait(PATIENCE)
        return code, self.out.read_text(), self.err.read_text()


@pytest.fixture
def service(request):
    return f"linkwatch-python-{os.getpid()}-{request.node.name[:40]}"


@pytest.fixture
def start(tmp_path):
    """Returns a function that starts the command, or another program."""
    started = []

    def start(*args, program=(COMMAND,)):
        started.append(Process([*program, *args], tmp_path, f"process-{len(started)}"))
        return started[-1]

    yield start
    for process in started:
        process.kill()

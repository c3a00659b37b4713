"""Publishes rings that OpenMM simulates to `linkwatch watch`, from Python.

    pip install iceoryx2==0.9.3 openmm numpy
    linkwatch watch &
    python examples/rings.py                 # a chain of linked rings: intact
    python examples/rings.py --pull          # two rings are pulled apart by force: abort
    python examples/rings.py --pull --roll-back
    python examples/rings.py --step 0.04     # a time step that is too large: NaN

`Client` is written from docs/reference/bus.md alone, and can be copied into other simulators. The
rings are bead-spring rings (Kremer and Grest 1990), so the curves are polylines through the beads.
"""

import argparse
import ctypes
import random
import time

import iceoryx2 as iox2
import numpy as np
import openmm as mm
from openmm import unit

VERSION = 8
FRAME_MAGIC = int.from_bytes(b"LWFRAME\0", "little")
VERDICT_MAGIC = int.from_bytes(b"LWVERDI\0", "little")
LOCKSTEP, END, ANNOUNCE, UNFINISHED = 1, 2, 4, 8
KINDS = ("hello", "verdict", "goodbye")
VERDICTS = ("intact", "changed", "contact", "undecided", "stale", "rejected")
POLYLINE = 0
NO_FRAME = 2**64 - 1


def fields(text):
    """Returns the fields of a structure, from lines of a type and names, as in `u32 i j`."""
    types = {
        "u8": ctypes.c_uint8,
        "u32": ctypes.c_uint32,
        "u64": ctypes.c_uint64,
        "i32": ctypes.c_int32,
        "i64": ctypes.c_int64,
        "f64": ctypes.c_double,
    }
    found = []
    for line in text.strip().splitlines():
        kind, *names = line.split()
        kind, _, length = kind.partition("*")
        kind = types[kind] * int(length) if length else types[kind]
        found += [(name, kind) for name in names]
    return found


class Wire(ctypes.Structure):
    """A structure that both sides know under the same name."""

    @classmethod
    def type_name(cls):
        return f"linkwatch.{cls.__name__}"


class FrameHeader(Wire):
    _fields_ = fields(
        """
        u64 magic
        u32 version flags
        u64 session seq baseline
        f64 time
        u64 n_points
        u32 n_curves basis coordinate_bytes cuts layout names_bytes
        f64 time_step
        u32 cell_vectors reserved
        f64*3 cell_origin
        f64*9 cell
        """
    )


class Verdict(Wire):
    _fields_ = fields(
        """
        u64 magic
        u32 version kind
        u64 session seq
        f64 time
        u32 verdict abort lost gained changed defects events finding i j defect_kind
        u32*2 segments
        u32 has_place reason_len unresolved appeared gone findings recovered
        i64 expected found
        f64*3 point
        f64 distance lengths extent
        u64 verified skipped rejected check_ns last_intact
        f64 safe_fraction
        i32*3 image
        u8*180 reason
        """
    )

    def __str__(self):
        text = f"frame {self.seq} at {self.time:g} s: {VERDICTS[self.verdict]}"
        if self.finding:
            second = "" if self.j == 0xFFFFFFFF else f" and {self.j}"
            text += f", first at curves {self.i}{second}"
        if self.finding == 1:
            text += f": linking number was {self.expected}, is {self.found}"
        return text + (f": {self.words()}" if self.reason_len else "")

    def words(self):
        return bytes(self.reason)[: self.reason_len].decode()


class Client:
    """One session: the same curves in every frame, and frames numbered from 0."""

    def __init__(self, counts, coordinates=np.float32, service="linkwatch", lockstep=False):
        self.counts = np.asarray(counts, np.int32)
        self.coordinates = np.dtype(coordinates)
        self.lockstep = LOCKSTEP if lockstep else 0
        self.session = random.randrange(1, 2**64)
        self.seq = self.cuts = self.aborts_from = 0
        table = self.counts.tobytes()
        self.table = table + bytes(-len(table) % 64)
        self.points = int(np.abs(self.counts).sum())
        self.bytes = len(self.table) + 3 * self.points * self.coordinates.itemsize

        iox2.set_log_level_from_env_or(iox2.LogLevel.Error)
        off = iox2.SignalHandlingMode.Disabled
        node = iox2.NodeBuilder.new().signal_handling_mode(off).create(iox2.ServiceType.Ipc)
        name = lambda part: node.service_builder(iox2.ServiceName.new(f"{service}/{part}"))
        lock = name("simulator").request_response(ctypes.c_uint64, ctypes.c_uint64)
        lock = lock.max_servers(1).max_clients(1).open_or_create()
        self.lock = lock.server_builder().create()  # fails if another simulator has it
        frames = (
            name("frames")
            .publish_subscribe(iox2.Slice[ctypes.c_uint8])
            .user_header(FrameHeader)
            .payload_alignment(iox2.Alignment.new(64))
            .max_publishers(3)
            .max_subscribers(4)
            .subscriber_max_buffer_size(2)
            .subscriber_max_borrowed_samples(4)
            .history_size(2)
            .enable_safe_overflow(True)
            .open_or_create()
        )
        verdicts = (
            name("verdicts")
            .publish_subscribe(Verdict)
            .max_publishers(2)
            .max_subscribers(4)
            .subscriber_max_buffer_size(64)
            .subscriber_max_borrowed_samples(2)
            .history_size(1)
            .enable_safe_overflow(True)
            .open_or_create()
        )
        self.subscriber = verdicts.subscriber_builder().create()
        self.notifier = name("frames").event().open_or_create().notifier_builder().create()
        self.listener = name("verdicts").event().open_or_create().listener_builder().create()
        self.publisher = (
            frames.publisher_builder()
            .initial_max_slice_len(self.bytes)
            .allocation_strategy(iox2.AllocationStrategy.PowerOfTwo)
            .backpressure_strategy(iox2.BackpressureStrategy.DiscardData)
            .create()
        )
        self.node = node  # last, so that it is freed after its ports

    def send(self, length, flags=0, seconds=0.0, positions=None):
        sample = self.publisher.loan_slice_uninit(length)
        frame = positions is not None
        sample.user_header().contents = FrameHeader()
        header = sample.user_header().contents
        header.magic, header.version = FRAME_MAGIC, VERSION
        header.flags, header.session = flags | self.lockstep, self.session
        header.seq, header.time, header.cuts = self.seq, seconds, self.cuts
        header.n_points = self.points if frame else 0
        header.n_curves = len(self.counts) if frame else 0
        header.basis, header.coordinate_bytes = POLYLINE, self.coordinates.itemsize
        if frame:
            start = sample.payload().data_ptr
            ctypes.memmove(start, self.table, len(self.table))
            data = np.ascontiguousarray(positions, self.coordinates)
            assert data.size == 3 * self.points, "another number of points"
            ctypes.memmove(start + len(self.table), data.ctypes.data, data.nbytes)
        sample.assume_init().send()
        self.notifier.notify()

    def publish(self, seconds, positions):
        self.send(self.bytes, 0, seconds, positions)
        self.seq += 1
        return self.seq - 1

    def poll(self):
        """Returns the next message about this session, or None."""
        while (sample := self.subscriber.receive()) is not None:
            message = Verdict.from_buffer_copy(sample.payload().contents)
            sample.delete()
            if (message.magic, message.version) != (VERDICT_MAGIC, VERSION):
                raise RuntimeError(f"a verdict of layout {message.version}, expected {VERSION}")
            if message.session == self.session:
                message.abort &= message.seq >= self.aborts_from
                return message
        return None

    def wait(self, wanted, seconds):
        """Returns the first message for which `wanted` is true, or None after `seconds`."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            while (message := self.poll()) is not None:
                if wanted(message):
                    return message
            self.publisher.update_connections()
            self.listener.timed_wait_all(iox2.Duration.from_millis(10))
        return None

    def wait_for_watcher(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.send(0, ANNOUNCE)
            if self.wait(lambda message: True, 0.1):
                return True
        return False

    def resume(self):
        """Clears the abort after a roll back, and marks the next frame as a jump."""
        self.aborts_from = self.seq
        self.cuts += 1

    def finish(self, seconds):
        self.send(0, END)
        return self.wait(lambda message: KINDS[message.kind] == "goodbye", seconds)


RINGS, BEADS = 6, 40
STEPS_A_FRAME, FRAMES = 50, 200
STATES = 5  # frames between two states to roll back to
BOLTZMANN = 0.00831446261815324  # kJ/mol/K: temperature 1 in the units of the model


def start():
    """Returns a chain of rings, each linked with the next one."""
    radius = 0.97 / (2 * np.sin(np.pi / BEADS))
    angle = 2 * np.pi * np.arange(BEADS) / BEADS
    rings = np.zeros((RINGS, BEADS, 3))
    for k, ring in enumerate(rings):
        ring[:, 0] = radius * np.cos(angle) + 1.2 * radius * k
        ring[:, 1 + k % 2] = radius * np.sin(angle)
    return rings.reshape(-1, 3)


def simulation(step):
    """Returns bonded beads that repel one another; the first ring may be pulled away."""
    system = mm.System()
    bonds = mm.HarmonicBondForce()
    beads = mm.CustomNonbondedForce("strength*(1+cos(3.14159265*min(1,r/1.12)))")
    beads.addGlobalParameter("strength", 100.0)
    beads.setNonbondedMethod(mm.CustomNonbondedForce.CutoffNonPeriodic)
    beads.setCutoffDistance(1.12)
    pull = mm.CustomExternalForce("pull*x")
    pull.addGlobalParameter("pull", 0.0)
    for k in range(RINGS * BEADS):
        system.addParticle(1.0)
        beads.addParticle([])
        if k < BEADS:
            pull.addParticle(k, [])
        a, b = k, k // BEADS * BEADS + (k + 1) % BEADS
        bonds.addBond(a, b, 0.97, 1000.0)
        beads.addExclusion(a, b)
    for force in (bonds, beads, pull):
        system.addForce(force)
    integrator = mm.LangevinMiddleIntegrator(1 / BOLTZMANN, 0.5, step)
    integrator.setRandomNumberSeed(1)
    context = mm.Context(system, integrator, mm.Platform.getPlatformByName("Reference"))
    context.setPositions(start())
    return context


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--service", default="linkwatch")
    parser.add_argument("--step", type=float, default=0.005, help="time step")
    parser.add_argument("--pull", action="store_true", help="pull a ring with weak repulsion")
    parser.add_argument("--roll-back", action="store_true", help="on abort, restore and go on")
    parser.add_argument("--lockstep", action="store_true", help="wait for each verdict")
    args = parser.parse_args()

    context = simulation(args.step)
    if args.pull:
        context.setParameter("strength", 1.0)
        context.setParameter("pull", 2.0)
    client = Client([-BEADS] * RINGS, service=args.service, lockstep=args.lockstep)
    if not client.wait_for_watcher(5):
        print("no watcher: run `linkwatch watch`")
    states = []
    while client.seq < FRAMES:
        if client.seq % STATES == 0:
            states.append((client.seq, context.createCheckpoint()))
        context.getIntegrator().step(STEPS_A_FRAME)
        state = context.getState(getPositions=True)
        positions = state.getPositions(asNumpy=True).value_in_unit(unit.nanometer)
        seq = client.publish(state.getTime().value_in_unit(unit.second), positions)
        verdict = lambda message: KINDS[message.kind] == "verdict" and message.seq == seq
        last = client.wait(verdict, 5) if args.lockstep else client.poll()
        if args.lockstep and last is None:
            print(f"frame {seq}: no verdict in time")
        if last is None or not last.abort:
            continue
        print(last)
        if not args.roll_back:
            break
        # A state is that before the frame of its number.
        intact = -1 if last.last_intact == NO_FRAME else last.last_intact
        states = [s for s in states if s[0] <= intact + 1]
        context.loadCheckpoint(states[-1][1])
        context.setParameter("strength", 100.0)
        context.setParameter("pull", 0.0)
        client.resume()
    last = client.finish(5)
    if last:
        print(f"{last.verified} frames verified, {last.skipped} skipped, {last.rejected} rejected")


if __name__ == "__main__":
    main()

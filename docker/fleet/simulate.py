#!/usr/bin/env python3
"""As many messages as so many gateways publish, against a broker, and what becomes of them.

    python3 docker/fleet/simulate.py --gateways 200 --for 60 localhost:1883

Each is a connection of its own, as isotherm's [mqtt] makes it (MQTT 3.1.1, a will, values retained and sent at most once, events at least
once). Once a second every value of it is another one, which is more than machines do: ten signals, two axes, two outputs; an event a
minute. One reader takes all of it. Nothing but Python is needed. --pid is the broker's, where it runs here: its time and memory are told then.
"""

import argparse
import asyncio
import datetime
import json
import os
import random
import struct
import time

CONNECT, CONNACK, PUBLISH, PUBACK, SUBSCRIBE, SUBACK = 1, 2, 3, 4, 8, 9


def text(value):
    data = value.encode()
    return struct.pack("!H", len(data)) + data


def packet(kind, flags, body):
    length, left = b"", len(body)
    while True:
        left, digit = divmod(left, 128)
        length += bytes([digit | (0x80 if left else 0)])
        if not left:
            return bytes([kind << 4 | flags]) + length + body


async def next_packet(reader):
    first = (await reader.readexactly(1))[0]
    length, shift = 0, 0
    while True:
        digit = (await reader.readexactly(1))[0]
        length |= (digit & 0x7F) << shift
        shift += 7
        if not digit & 0x80:
            return first >> 4, first & 0x0F, await reader.readexactly(length)


async def connect(arguments, name, will=None):
    host, port = arguments.broker.rsplit(":", 1)
    reader, writer = await asyncio.open_connection(host, int(port))
    body = text("MQTT") + bytes([4, 0x02 | (0x2C if will else 0)]) + struct.pack("!H", 60) + text(name)
    if will:
        body += text(will[0]) + text(will[1])
    writer.write(packet(CONNECT, 0, body))
    kind, _, answer = await next_packet(reader)
    assert kind == CONNACK and answer[1] == 0, f"the broker refuses {name}: {answer}"
    return reader, writer


def publish(topic, value, qos=0, number=0):
    body = text(topic) + (struct.pack("!H", number) if qos else b"") + json.dumps(value).encode()
    return packet(PUBLISH, (qos << 1) | (0 if qos else 1), body)


class Counts:
    def __init__(self):
        self.sent = self.sent_bytes = self.acknowledged = self.events = self.late = 0
        self.received, self.delays = 0, []


async def gateway(arguments, number, counts, begin):
    name = f"sim-{number}"
    top = f"isotherm/{name}"
    state = json.dumps({"state": "offline"})
    reader, writer = await connect(arguments, f"isotherm-{name}", (f"{top}/state", state))

    async def acknowledged():
        try:
            while True:
                kind, _, _ = await next_packet(reader)
                counts.acknowledged += kind == PUBACK
        except (asyncio.IncompleteReadError, ConnectionError):
            pass

    listening = asyncio.create_task(acknowledged())
    due = begin + random.random()
    for second in range(arguments.seconds):
        await asyncio.sleep(max(0.0, due - time.time()))
        counts.late += time.time() - due > 0.5
        due += 1.0
        at = datetime.datetime.now(datetime.UTC).isoformat().replace("+00:00", "Z")
        value = lambda: round(random.gauss(20.0, 3.0), 2)
        messages = [
            publish(f"{top}/signal/t{n}", {"at": at, "value": value(), "unit": "degC", "quality": "good", "reason": ""})
            for n in range(10)
        ]
        for axis in "xz":
            um = {key: value() for key in ("cz_um", "raw_um", "verified_um", "expected_um", "limit_um", "correction_um", "residual_um")}
            flags = {"armed": True, "warned": False, "tripped": False, "extrapolating": False}
            messages.append(publish(f"{top}/axis/{axis}", {"at": at, "state": "active", "why": "", "model": "spindle", **flags, **um}))
            messages.append(publish(f"{top}/output/cnc_{axis}", {"at": at, "value": value(), "unit": "µm", "state": "verified"}))
        if second % 60 == number % 60:
            event = {"at": at, "kind": "state", "level": "info", "text": "axis z: compensating", "data": {"axis": "z"}}
            messages.append(publish(f"{top}/event", event, qos=1, number=second % 65535 + 1))
            counts.events += 1
        data = b"".join(messages)
        writer.write(data)
        counts.sent += len(messages)
        counts.sent_bytes += len(data)
        await writer.drain()
    await asyncio.sleep(5)
    listening.cancel()
    writer.close()


async def listen(arguments, counts):
    reader, writer = await connect(arguments, "fleet-reader")
    writer.write(packet(SUBSCRIBE, 2, struct.pack("!H", 1) + text("isotherm/+/signal/+") + b"\0" + text("isotherm/+/axis/+") + b"\0"
                        + text("isotherm/+/output/+") + b"\0" + text("isotherm/+/event") + b"\1"))
    begun = time.time()
    while True:
        kind, flags, body = await next_packet(reader)
        if kind != PUBLISH:
            continue
        length = struct.unpack("!H", body[:2])[0]
        number, at = b"", 2 + length
        if flags >> 1 & 3:
            number, at = body[at : at + 2], at + 2
            writer.write(packet(PUBACK, 0, number))
        taken = datetime.datetime.fromisoformat(json.loads(body[at:])["at"]).timestamp()
        # What it kept of a run before is none of this one.
        if taken >= begun:
            counts.received += 1
            counts.delays.append(time.time() - taken)


def broker_costs(pid):
    fields = open(f"/proc/{pid}/stat").read().rsplit(") ", 1)[1].split()
    ticks = int(fields[11]) + int(fields[12])
    resident = next(line for line in open(f"/proc/{pid}/status") if line.startswith("VmRSS"))
    return ticks / os.sysconf("SC_CLK_TCK"), int(resident.split()[1]) / 1024


async def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("broker", help="host:port, without TLS")
    parser.add_argument("--gateways", type=int, default=200)
    parser.add_argument("--for", type=int, default=60, dest="seconds")
    parser.add_argument("--pid", type=int)
    arguments = parser.parse_args()
    counts = Counts()
    reading = asyncio.create_task(listen(arguments, counts))
    await asyncio.sleep(0.5)
    before = broker_costs(arguments.pid) if arguments.pid else None
    begin = time.time() + 2.0
    await asyncio.gather(*(gateway(arguments, number, counts, begin) for number in range(arguments.gateways)))
    reading.cancel()
    delays = sorted(counts.delays)
    of = lambda share: 1000 * delays[min(len(delays) - 1, int(share * len(delays)))]
    print(f"{arguments.gateways} gateways, {arguments.seconds} s: {counts.sent} messages, {counts.sent / arguments.seconds:.0f} a second,"
          f" {counts.sent_bytes / arguments.seconds / 1000:.0f} kB a second")
    print(f"the reader got {counts.received}, {counts.sent - counts.received} are missing;"
          f" of {counts.events} events {counts.acknowledged} were acknowledged")
    print(f"delay until the reader had it: half within {of(0.5):.1f} ms, 99 of 100 within {of(0.99):.1f} ms, all within {of(1.0):.1f} ms")
    print(f"seconds in which a gateway here was late by more than half of one: {counts.late}")
    if before:
        spent, resident = broker_costs(arguments.pid)
        spent -= before[0]
        print(f"the broker: {spent:.1f} s of processor time, {100 * spent / arguments.seconds:.1f} % of a core; {resident:.1f} MB")


asyncio.run(main())

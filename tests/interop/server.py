"""A machine's Modbus devices as pymodbus serves them, for tests of the gateway.

Over TCP; with the arguments `tls DIRECTORY` inside TLS, with the certificates in there; with `rtu-over-tcp` or `ascii-over-tcp` as frames of RTU or ASCII, with `rtu` or `ascii` on a serial port: two pseudo-terminals with a
wire of 9600 baud between them.

Prints `listening PORT`, with `rtu` and `ascii` the path of the port. Then, line by line from stdin:
  set UNIT TABLE ADDRESS WORD...   answers `> ok`
  get UNIT TABLE ADDRESS COUNT     answers `> WORD...`
TABLE is input, holding or discrete. Ends with its stdin.
"""

import asyncio
import os
import ssl
import sys
import threading
import time
import tty

from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer, ModbusTcpServer, ModbusTlsServer
from pymodbus.simulator import DataType, SimData, SimDevice

READ = {"discrete": 2, "holding": 3, "input": 4}
REGISTERS = 200
BAUD = 9600
# Start, eight data bits, one stop bit.
CHARACTER = 10 / BAUD


def device(unit):
    def registers():
        return [SimData(0, count=REGISTERS, values=0, datatype=DataType.REGISTERS)]

    def bits():
        return [SimData(0, count=REGISTERS, values=False, datatype=DataType.BITS)]

    return SimDevice(unit, simdata=(bits(), bits(), registers(), registers()))


async def answer(server, line):
    verb, unit, table, address, *rest = line.split()
    unit, address, function = int(unit), int(address), READ[table]
    if verb == "set":
        values = [int(word) for word in rest]
        if table == "discrete":
            values = [bool(value) for value in values]
        await server.async_setValues(unit, function, address, values)
        return "ok"
    values = await server.async_getValues(unit, function, address, int(rest[0]))
    return " ".join(str(int(value)) for value in values)


def port():
    """A serial port: the wire's end of it, and its path."""
    end, terminal = os.openpty()
    tty.setraw(terminal)
    # Kept open, so that the wire's end never breaks.
    return end, os.ttyname(terminal)


def wire(source, sink):
    """Carries one character after the other, each as long as it takes."""
    free = 0.0
    while True:
        for character in os.read(source, 256):
            free = max(free, time.monotonic()) + CHARACTER
            time.sleep(max(0.0, free - time.monotonic()))
            os.write(sink, bytes([character]))


async def serve(kind, directory=None):
    devices = [device(unit) for unit in (1, 2, 3, 4)]
    framers = {"rtu": FramerType.RTU, "ascii": FramerType.ASCII}
    if kind in framers:
        (ours, path), (theirs, other) = port(), port()
        for ends in ((ours, theirs), (theirs, ours)):
            threading.Thread(target=wire, args=ends, daemon=True).start()
        server = ModbusSerialServer(devices, framer=framers[kind], port=path, baudrate=BAUD)
        await server.serve_forever(background=True)
        return server, other
    if kind == "tls":
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(f"{directory}/device.pem", f"{directory}/device.key")
        context.load_verify_locations(f"{directory}/ca.pem")
        context.verify_mode = ssl.CERT_REQUIRED
        # With the header of Modbus TCP, as the specification has it; pymodbus's own TLS framer leaves it out.
        server = ModbusTlsServer(devices, framer=FramerType.SOCKET, address=("127.0.0.1", 0), sslctx=context)
        await server.serve_forever(background=True)
        return server, server.transport.sockets[0].getsockname()[1]
    framer = framers.get(kind.removesuffix("-over-tcp"), FramerType.SOCKET)
    server = ModbusTcpServer(devices, framer=framer, address=("127.0.0.1", 0))
    await server.serve_forever(background=True)
    return server, server.transport.sockets[0].getsockname()[1]


async def main():
    server, where = await serve(*sys.argv[1:] or ["tcp"])
    print("listening", where, flush=True)
    stdin = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin)
    while line := (await stdin.readline()).decode():
        print(">", await answer(server, line), flush=True)
    await server.shutdown()


asyncio.run(main())

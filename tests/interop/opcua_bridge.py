"""Modbus devices as nodes of an OPC UA server that is not ours (asyncua): what is read of a node is read of its register at that moment,
what is written into it is written there.

    opcua_bridge.py DEVICE=PORT … -- DEVICE/TABLE/REGISTER/TYPE/ORDER …

Each of the latter is the name of a node, in the namespace 2. The port of the server is printed."""

import asyncio
import socket
import struct
import sys

from asyncua import Server, ua

between = sys.argv.index("--")
ports = dict(argument.split("=") for argument in sys.argv[1:between])
READS = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
KINDS = {"bool": ua.VariantType.Boolean, "i16": ua.VariantType.Int16, "i32": ua.VariantType.Int32}
NUMBERS = {"i16": ">h", "i32": ">i"}


class Device:
    """Unit 1 at a port, asked one thing at a time."""

    def __init__(self, port):
        self.socket = socket.create_connection(("127.0.0.1", int(port)))
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def ask(self, question):
        self.socket.sendall(struct.pack(">HHHB", 1, 0, len(question) + 1, 1) + question)
        head = self.take(7)
        answer = self.take(struct.unpack(">HHHB", head)[2] - 1)
        if answer[0] != question[0]:
            raise ua.uaerrors.BadDeviceFailure()
        return answer

    def take(self, count):
        taken = b""
        while len(taken) < count:
            more = self.socket.recv(count - len(taken))
            if not more:
                raise ua.uaerrors.BadNoCommunication()
            taken += more
        return taken


class Cell:
    """What a node stands for."""

    def __init__(self, name, devices):
        device, table, register, self.kind, self.order = name.split("/")
        self.device, self.table, self.register = devices[device], table, int(register)

    def variant(self, value):
        return ua.Variant(value, KINDS[self.kind])

    def read(self):
        count = 2 if self.kind == "i32" else 1
        answer = self.device.ask(struct.pack(">BHH", READS[self.table], self.register, count))
        if self.kind == "bool":
            return bool(answer[2] & 1)
        return struct.unpack(NUMBERS[self.kind], self.ordered(answer[2:]))[0]

    def write(self, value):
        data = self.ordered(struct.pack(NUMBERS[self.kind], value))
        self.device.ask(struct.pack(">BHHB", 16, self.register, len(data) // 2, len(data)) + data)

    def ordered(self, data):
        return data[2:] + data[:2] if self.order == "lsw-first" else data


async def main():
    devices = {name: Device(port) for name, port in ports.items()}
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    space = await server.register_namespace("urn:test")
    cells = {}
    for name in sys.argv[between + 1 :]:
        cell = Cell(name, devices)
        node = await server.nodes.objects.add_variable(ua.NodeId(name, space), name, cell.variant(cell.read()))
        cells[node.nodeid] = cell
    service = server.iserver.attribute_service
    read, write = service.read, service.write

    def asked(params):
        found = read(params)
        for place, one in enumerate(params.NodesToRead):
            if one.NodeId in cells and one.AttributeId == ua.AttributeIds.Value:
                cell = cells[one.NodeId]
                found[place] = ua.DataValue(cell.variant(cell.read()))
        return found

    async def written(params, *rest, **more):
        if not all(one.NodeId in cells for one in params.NodesToWrite):
            return await write(params, *rest, **more)
        for one in params.NodesToWrite:
            cells[one.NodeId].write(one.Value.Value.Value)
        return [ua.StatusCode(ua.StatusCodes.Good) for _ in params.NodesToWrite]

    service.read, service.write = asked, written
    async with server:
        print(server.bserver._server.sockets[0].getsockname()[1], flush=True)
        await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)


asyncio.run(main())

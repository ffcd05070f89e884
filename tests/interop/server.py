"""A machine's Modbus TCP devices as pymodbus serves them, for tests of the gateway.

Prints `listening PORT`. Then, line by line from stdin:
  set UNIT TABLE ADDRESS WORD...   answers `> ok`
  get UNIT TABLE ADDRESS COUNT     answers `> WORD...`
TABLE is input, holding or discrete. Ends with its stdin.
"""

import asyncio
import sys

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

READ = {"discrete": 2, "holding": 3, "input": 4}
REGISTERS = 200


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


async def main():
    server = ModbusTcpServer([device(unit) for unit in (1, 2, 3, 4)], address=("127.0.0.1", 0))
    await server.serve_forever(background=True)
    print("listening", server.transport.sockets[0].getsockname()[1], flush=True)
    stdin = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(stdin), sys.stdin)
    while line := (await stdin.readline()).decode():
        print(">", await answer(server, line), flush=True)
    await server.shutdown()


asyncio.run(main())

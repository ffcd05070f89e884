"""pymodbus's client, for tests of the virtual machine.

Takes HOST:PORT, or the path of a serial port of 9600 baud. Then, line by line from stdin:
  read UNIT TABLE ADDRESS COUNT     answers `> VALUE...`, or `> exception CODE`
  write UNIT ADDRESS WORD           function 06: answers `> ok`, or `> exception CODE`
  write UNIT ADDRESS WORD WORD...   function 16
TABLE is input, holding, discrete or coil. Prints `ready` first. Ends with its stdin.
"""

import sys

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

if sys.argv[1].startswith("/"):
    client = ModbusSerialClient(sys.argv[1], baudrate=9600, retries=0)
else:
    host, port = sys.argv[1].split(":")
    client = ModbusTcpClient(host, port=int(port), retries=0)
if not client.connect():
    sys.exit(f"no connection to {sys.argv[1]}")
READ = {
    "input": client.read_input_registers,
    "holding": client.read_holding_registers,
    "discrete": client.read_discrete_inputs,
    "coil": client.read_coils,
}
print("ready", flush=True)

for line in sys.stdin:
    verb, unit, *rest = line.split()
    unit = int(unit)
    if verb == "read":
        table, address, count = rest[0], int(rest[1]), int(rest[2])
        reply = READ[table](address, count=count, device_id=unit)
        if not reply.isError():
            values = reply.registers if table in ("input", "holding") else reply.bits[:count]
            print(">", " ".join(str(int(value)) for value in values), flush=True)
            continue
    else:
        address, words = int(rest[0]), [int(word) for word in rest[1:]]
        if len(words) == 1:
            reply = client.write_register(address, words[0], device_id=unit)
        else:
            reply = client.write_registers(address, words, device_id=unit)
    print(f"> exception {reply.exception_code}" if reply.isError() else "> ok", flush=True)
